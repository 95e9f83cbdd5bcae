"""CPU time of other processes."""

from __future__ import annotations

import subprocess
import sys

from trocar.shm.time.clock import monotonic_ns
from trocar.tools.bench.measuring import cpu_s

PROGRAM = "import sys\nfor line in sys.stdin: sum(range(100_000)); print(flush=True)"
TICK_S = 0.01


def test_less_than_a_tick_is_seen_and_who_is_gone_has_none() -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdin is not None and other.stdout is not None
        steps = []
        for _ in range(10):
            before, begin = cpu_s(other.pid), monotonic_ns()
            other.stdin.write(b"\n")
            other.stdin.flush()
            other.stdout.readline()
            steps.append(cpu_s(other.pid) - before)
            assert 0.0 < steps[-1] < (monotonic_ns() - begin) * 1e-9 + TICK_S
        assert any(step % TICK_S for step in steps)
        other.stdin.close()
        other.wait()
        assert cpu_s(other.pid) == 0.0
