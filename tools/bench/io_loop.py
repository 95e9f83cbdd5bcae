"""`trocar bench io`: the I/O loop on emulated boards: latency, period, datagrams, and the rate it can keep.

One to five PSMs (2 to 10 boards) in one io process, powered, homed and holding; everything as `trocar up` starts it.
With two cores io has the first one, the emulator and the arm processes share the second; with more, arms run on any.
The figures without a number are for four PSMs: 8 boards, 28 axes.

By turns: native and numpy (`numpy_…`; `native_ratio` is numpy / native from reply to write), the largest and the
smallest robot (`ratio_10_vs_2`, also from reply to write), and the same datagrams between two C programs (`baseline_…`,
tools/bench/baseline.c), the limit of this machine. In turns, io sleeps while it waits for the reply; a write then wakes
the emulator, which is most of the time. (Where io spins, a robot of two boards writes before the emulator sleeps, one
of ten does not.) A rate counts as kept when at most half a point more of its deadlines is missed than the C programs
miss.
"""

from __future__ import annotations

import copy
import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml

from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.bench.measuring import by_turns, cpu_model, cpu_s, home_all, percentiles, without_native
from trocar.tools.inspect.processes import ProcessStatus, statuses
from trocar.tools.output.errors import Problem
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

PSMS = 4
SIZES = (1, 2, 4, 5)  # PSMs, of two boards each
SECONDS = 5.0
SUSTAINED_S = 10.0
WINDOWS = 3  # to keep a rate in: a virtual machine is stopped for milliseconds now and then
LOOK_S = 0.05
MORE_MISSED = 0.005
USUAL_HZ = 1500
FIRST_HZ, STEP_HZ, MAX_HZ = 3000, 500, 8000
NAMED_HZ = {1500: "1k5", 3000: "3k", 4500: "4k5", 6000: "6k"}
TURNS = 3  # of native and numpy
ARMS_ON_TWO = "arm.period_s=0.005"  # where there are two cores arms share one with the boards, also those on numpy
SLOW_ARMS = "arm.period_s=0.005"  # they hold; the rate to find is that of io
FIRST_BOARD = 6  # boards of the demo's PSM; copies begin at board 0
SOURCE = PROJECT_CONFIGS
LOOPBACK = Path("/proc/net/dev")
CPU = "cpu_us_without_wait"
WAIT_US = 50.0  # from query to read, without sleeping; the wait for eight boards by the rule
BASELINE = Path(__file__).with_name("baseline.c")
REPLY_BYTES, WRITE_BYTES = 1092, 218  # of eight QLA1 of Rev 8
WAIT_NS, SPIN_NS = 50_000, 50_000
AWAKE = ("io.spin_us=0", f"io.query_wait_us={WAIT_US}", "arm.period_s=0.002")
"""So that CPU time is work, except for that wait, and arms on numpy have enough time."""


def run(window_s: float = SECONDS, sustained_s: float = SUSTAINED_S, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Measure."""
    figures: dict[str, Any] = {}
    cores = sorted(psutil.Process().cpu_affinity() or [])
    placed = (f"io.cpu={cores[0]}", f"emulation.cpu={cores[1]}") if len(cores) > 1 else ()
    if len(cores) == 2:
        placed = (*placed, f"arm.cpu={cores[1]}", ARMS_ON_TWO)
    with own_folder(f"bench-io-{os.getpid()}") as folder:
        for psms in sizes:
            found = _measure(write_system(folder, psms), window_s, *placed)
            figures |= {key if psms == PSMS else f"{key}_{2 * psms}": value for key, value in found.items()
                        if key != CPU}
        figures |= _of_sizes(folder, sizes, window_s, *placed)
        file = write_system(folder, PSMS)
        figures |= _by_turns(file, window_s, *placed)
        baseline = Baseline(folder)
        client, server = (cores[0], cores[1]) if len(cores) > 1 else (-1, -1)
        if not baseline.why_not:
            awake = baseline.run(USUAL_HZ, window_s, client, server, spin_ns=0)
            figures |= {f"baseline_{CPU}": awake.cpu_us, "baseline_read_to_write_us_p50": awake.reply_to_write_us_p50,
                        "baseline_read_to_write_us_p99": awake.reply_to_write_us_p99}
        missed_by_c = cache(lambda hz: baseline.run(hz, sustained_s, client, server).missed)
        beyond: dict[str, str] = {}

        def more_missed(hz: float) -> tuple[float, float]:
            missed, why = part_missed(lambda: _part_missed(file, sustained_s, f"io.period_s={1.0 / hz}", SLOW_ARMS,
                                                           *placed))
            if why:
                beyond[f"{hz:g}"] = why
            return missed, 0.0 if baseline.why_not else missed_by_c(hz)

        tried = sustained(more_missed)
        tried |= {hz: more_missed(hz) for hz in NAMED_HZ if hz not in tried}
    for hz, name in NAMED_HZ.items():
        figures[f"missed_percent_{name}"] = 100.0 * tried[hz][0]
        if not baseline.why_not:
            figures[f"baseline_missed_percent_{name}"] = 100.0 * tried[hz][1]
    figures["max_rate_hz"] = max((hz for hz, (missed, allowed) in tried.items() if missed <= allowed + MORE_MISSED),
                                 default=0)
    conditions = {
        "boards": [2 * psms for psms in sizes], "seconds": window_s, "sustained_s": sustained_s,
        "missed_at_hz": {str(hz): round(missed, 6) for hz, (missed, _) in sorted(tried.items())},
        "baseline": baseline.why_not or "tools/bench/baseline.c", "turns": TURNS,
        "beyond_this_machine_hz": beyond, "windows": WINDOWS,
        "state": "every arm homed and holding; for max_rate_hz arms at 200 Hz",
        "placed": list(placed), "cpu": cpu_model(), "bus": "emulated boards on loopback UDP",
    }
    return {"figures": figures, "conditions": conditions}


@dataclass(frozen=True, slots=True)
class BaselineRun:
    """Fraction of missed deadlines, time from a reply to the next write, CPU time of a cycle without WAIT_NS."""

    missed: float
    reply_to_write_us_p50: float
    reply_to_write_us_p99: float
    cpu_us: float


class Baseline:
    """The compiled program; `why_not` gives the reason if it is missing."""

    def __init__(self, folder: Path) -> None:
        """Compiles into `folder`."""
        self._program = folder / "baseline"
        command = [os.environ.get("CC", "cc"), "-O2", "-Wall", "-Wextra", str(BASELINE), "-o", str(self._program)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
            self.why_not = done.stderr.strip() if done.returncode else ""
        except (OSError, subprocess.TimeoutExpired) as error:
            self.why_not = str(error)

    def run(self, hz: float, seconds: float, client_core: int, server_core: int, spin_ns: int = SPIN_NS) -> BaselineRun:
        """At `hz`, on these cores (-1: any)."""
        given = [round(hz), max(1, round(seconds)), client_core, server_core, REPLY_BYTES, WRITE_BYTES, WAIT_NS,
                 spin_ns]
        done = subprocess.run([self._program, *map(str, given)], capture_output=True, text=True, timeout=seconds + 60,
                              check=True)
        cycles, missed, p50, p99, cpu_ns = map(int, done.stdout.split())
        return BaselineRun(missed / max(1, missed + cycles), p50 * 1e-3, p99 * 1e-3, cpu_ns * 1e-3)


def _by_turns(file: Path, seconds: float, *placed: str) -> dict[str, float]:
    """Medians of native and of numpy, and io's cost without waiting."""
    def measure() -> dict[str, float]:
        return _measure(file, seconds, *AWAKE, *placed)

    def measure_numpy() -> dict[str, float]:
        with without_native():
            return measure()

    found = by_turns(TURNS, {"": measure, "numpy_": measure_numpy})
    numpy = {f"numpy_{key}": found["numpy_"][key] for key in ("read_to_write_us_p50", "read_to_write_us_p99", CPU)}
    return {"native_ratio": numpy["numpy_read_to_write_us_p50"] / found[""]["read_to_write_us_p50"],
            CPU: found[""][CPU], **numpy}


def _of_sizes(folder: Path, sizes: tuple[int, ...], seconds: float, *placed: str) -> dict[str, float]:
    """Time of the largest robot from reply to write, relative to the smallest."""
    largest, smallest = max(sizes), min(sizes)

    def measure(psms: int) -> dict[str, float]:
        return _measure(write_system(folder, psms), seconds, *AWAKE, *placed)

    found = by_turns(TURNS, {str(psms): partial(measure, psms) for psms in (largest, smallest)})
    return {f"ratio_{2 * largest}_vs_{2 * smallest}": found[str(largest)]["read_to_write_us_p50"]
            / found[str(smallest)]["read_to_write_us_p50"]}


def sustained(measure: Callable[[float], tuple[float, float]]) -> dict[int, tuple[float, float]]:
    """Part of the deadlines missed, and missed by the C programs, at every rate tried [Hz].

    Upwards while the first is kept, else downwards.
    """
    tried: dict[int, tuple[float, float]] = {}
    hz = FIRST_HZ
    while 0 < hz <= MAX_HZ and hz not in tried:
        tried[hz] = missed, allowed = measure(hz)
        hz += STEP_HZ if missed <= allowed + MORE_MISSED else -STEP_HZ
    return tried


def part_missed(measure: Callable[[], float]) -> tuple[float, str]:
    """Fraction of missed deadlines; for a robot that cannot be measured 1.0, and the reason."""
    try:
        return measure(), ""
    except Problem as problem:
        return 1.0, str(problem)


def write_system(folder: Path, psms: int) -> Path:
    """A system file with this many copies of the demo's PSM, each on two boards of its own."""
    robot = yaml.safe_load((SOURCE / "io" / "PSM1-demo.yaml").read_text())
    arms = []
    for i in range(psms):
        name, copied = f"PSM{i + 1}", copy.deepcopy(robot)
        copied["robots"][0]["name"] = name
        for part in (*copied["robots"][0]["actuators"], *copied.get("digital_inputs", [])):
            part["board_id"] += 2 * i - FIRST_BOARD
        for each in copied.get("digital_inputs", []):
            each["name"] = each["name"].replace("PSM1", name)
        for chip in copied.get("dallas_chips", []):
            chip["board_id"] += 2 * i - FIRST_BOARD
            chip["name"] = chip["name"].replace("PSM1", name)
        (folder / f"io-{name}.yaml").write_text(yaml.safe_dump(copied))
        arms.append({"name": name, "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": "arms/PSM1-demo.yaml",
                     "IO_file": f"io-{name}.yaml", "PID_file": "pid/PSM.yaml"})
    system = {"$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "udp"}], "arms": arms,
              "trocar": {"boards": "emulated"}}
    file = folder / "system-bench.yaml"
    file.write_text(yaml.safe_dump(system))
    return file


@contextmanager
def _homed(file: Path, *sets: str) -> Iterator[str]:
    """The name of a system that is up and homed."""
    request = StartRequest(file, f"bench-io-{os.getpid()}", "emulated", sets=(*sets, "clock=wall"))
    with up_meanwhile(request) as background:
        home_all(background.system)
        yield background.system


def _measure(file: Path, seconds: float, *sets: str) -> dict[str, float]:
    with _homed(file, *sets) as system:
        return _watch(system, seconds)


def _part_missed(file: Path, seconds: float, *sets: str) -> float:
    """Part of the deadlines that io misses, in the first window in which it keeps nearly all, else the best one."""
    least = 1.0
    with _homed(file, *sets) as system:
        for _ in range(WINDOWS):
            before = _io(system)
            pause(seconds)  # without looking at its records: copying them on the other core costs io time, too
            after = _io(system)
            missed, cycles = after.missed - before.missed, after.cycles - before.cycles
            least = min(least, missed / max(1, missed + cycles))
            if least < MORE_MISSED:
                break
        return least


def _watch(system: str, seconds: float) -> dict[str, float]:
    with closing(directory.reader(system, "IO1", "state")) as reader:
        _look(reader)
        first, begin, missed, life = int(reader.field("cycle")), reader.stamp_ns, _io(system).missed, reader.epoch
        packets, pid = _packets(), _io(system).pid
        used_s = cpu_s(pid)
        seen = begin
        latencies, stamps = [], []
        end = monotonic_ns() + round(seconds * 1e9)
        while monotonic_ns() < end:
            pause(LOOK_S)
            rows = reader.since(seen + 1)
            seen = int(rows[-1]["stamp_ns"]) if len(rows) else seen
            rows = rows[rows["valid"]]
            latencies.append(rows["write_ns"] - rows["recv_ns"])
            stamps.append(rows["stamp_ns"])
        if not sum(len(rows) for rows in stamps):
            raise Problem("io got no good sample from the emulated boards; is the machine busy? (trocar logs)")
        _look(reader)
        if reader.epoch != life:
            raise Problem("io stalled and restarted during the measurement; is the machine busy? (trocar logs)")
        packets, used_s = _packets() - packets, cpu_s(pid) - used_s
        cycles, span = int(reader.field("cycle")) - first, reader.stamp_ns - begin
        latency, stamp = np.concatenate(latencies) * 1e-3, np.unique(np.concatenate(stamps))
        return {
            **percentiles("read_to_write_us", latency, 50, 99),
            **percentiles("period_us", np.diff(stamp), 50, 99, unit=1e-3),
            "rate_hz": cycles / span * 1e9,
            CPU: used_s * 1e6 / max(1, cycles) - WAIT_US,
            "missed_deadlines": _io(system).missed - missed,
            "packets_per_cycle": round(packets / max(1, cycles), 1),
            "bad_reads": int(reader.field("bad_reads")),
            "cycles": cycles,
            "boards": len(reader.info["robots"]) * 2,
            "axes": int(reader.field("position").size),
        }


def _look(reader: RingReader) -> None:
    if not reader.newest():
        raise Problem(f"io's state cannot be read: {reader.problem or 'it has shown none'}; see trocar logs")


def _packets() -> int:
    """Packets that went over the loopback interface so far: boards on loopback are its only busy user here."""
    for line in LOOPBACK.read_text(encoding="utf-8").splitlines():
        name, _, counts = line.partition(":")
        if name.strip() == "lo":
            return int(counts.split()[1])
    return 0


def _io(system: str) -> ProcessStatus:
    return next(process for process in statuses(system) if process.name == "IO1")
