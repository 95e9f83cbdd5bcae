"""The processes of a system: started fresh, watched, restarted by their policy, stopped step by step."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from procs import lifecycle
from procs.document.system import Process
from procs.manifest import proc
from shm.clock import monotonic_ns
from shm.control_page import ControlPage

ROOT = Path(__file__).resolve().parents[2]
HEALTHY_NS = 10_000_000_000


@dataclass(slots=True)
class Child:
    """One instance as the supervisor sees it; all times monotonic ns."""

    system: str
    row: Process
    page: ControlPage
    log: Path
    state: str = lifecycle.STOPPED
    popen: subprocess.Popen[bytes] | None = None
    restarts: int = 0
    failures: int = 0  # deaths without a healthy while in between
    reason: str = ""
    started_ns: int = 0
    restart_at_ns: int = 0  # 0: no restart planned
    kill_at_ns: int = 0  # 0: nobody waits for its end
    given_up: bool = field(default=False)
    hung_s: float = 0.0  # so long it was silent when we killed it

    @property
    def pid(self) -> int:
        """Process id, 0 when none runs."""
        return self.popen.pid if self.popen is not None else 0

    @property
    def ready(self) -> bool:
        """Setup has succeeded and the process runs."""
        return self.popen is not None and self.page.state == "RUNNING"

    def start(self) -> None:
        """Begin a process, if the lifecycle allows it now."""
        begins = lifecycle.starts_process(self.state, lifecycle.START)
        self.state = lifecycle.after(self.state, lifecycle.START)
        if begins:
            self._spawn()

    def _spawn(self) -> None:
        self.page.show("CREATED")
        self.started_ns, self.restart_at_ns = monotonic_ns(), 0
        command = [sys.executable, "-m", proc(self.row.kind).module, "--system", self.system, "--name", self.row.name]
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # no thread pools in control code
        with self.log.open("ab") as log:
            self.popen = subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                env={**os.environ, **threads},
            )

    def ask_to_stop(self) -> None:
        """SIGTERM."""
        self.state = lifecycle.after(self.state, lifecycle.STOP)
        self.restart_at_ns = 0
        if self.popen is not None:
            self.popen.send_signal(signal.SIGTERM)
            self.popen.send_signal(signal.SIGCONT)  # a stopped process must wake to end

    def kill(self) -> None:
        """SIGKILL."""
        if self.popen is not None:
            self.popen.kill()

    def kill_hung(self, silent_s: float) -> None:
        """It lives, but does not go on: kill it; the policy for deaths decides about the next one."""
        self.hung_s = silent_s
        self.kill()

    def kill_when_due(self) -> None:
        """Kill what was asked to end and does not."""
        if self.kill_at_ns and monotonic_ns() >= self.kill_at_ns:
            self.kill_at_ns = 0
            self.kill()

    def reap(self) -> str:
        """Notice that the process ended; returns how, in words, or an empty string."""
        if self.popen is None or self.popen.poll() is None:
            return ""
        code = self.popen.returncode
        self.kill_at_ns = 0
        self.popen = None
        asked = self.state != lifecycle.RUNNING
        begins = lifecycle.starts_process(self.state, lifecycle.QUIT)
        self.state = lifecycle.after(self.state, lifecycle.QUIT)
        hung = f"hung for {self.hung_s:.1f} s, killed" if self.hung_s else ""
        self.reason = "stopped" if asked and code == 0 else hung or _in_words(code, self.page)
        self.hung_s = 0.0
        if begins:
            self._spawn()
        elif not asked:
            self._plan_restart()
        return self.reason

    def _plan_restart(self) -> None:
        now = monotonic_ns()
        self.failures = 1 if now - self.started_ns > HEALTHY_NS else self.failures + 1
        if self.row.on_exit != "restart" or not proc(self.row.kind).restart:
            return
        if self.failures > self.row.restart_limit:
            self.given_up = True
            self.reason += f"; given up after {self.row.restart_limit} restarts"
            return
        wait_s = self.row.backoff_s * 2 ** (self.failures - 1)
        self.restart_at_ns = now + round(wait_s * 1e9)

    def restart_when_due(self) -> bool:
        """Carry out a planned restart; True when a process was started."""
        if not self.restart_at_ns or monotonic_ns() < self.restart_at_ns:
            return False
        self.restarts += 1
        self.start()
        return True


def _in_words(code: int, page: ControlPage) -> str:
    if code < 0:
        try:
            return f"killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"killed by signal {-code}"
    reported = bytes(page.field("error")[()]).rstrip(b"\0").decode(errors="replace")
    return f"exit code {code}" + (f": {reported}" if reported else "")
