"""`trocar bench system [SYSTEM]`: a whole system at work: rates, missed deadlines and CPU time of every process.

The system is started as `trocar up` does it (`up_s`), and all arms are homed. An operator is emulated at every console;
each teleoperation must follow once. There are three windows of `--seconds` each: the arms hold
(`cpu_percent_rest`), the selected teleoperations follow masters that hold (`cpu_percent_following`), and the masters
move all the time; all other figures are those of the last window. Masters without a robot (KINEMATIC) are moved by
joint setpoints of ours, 200 a second; our own CPU time is `bench` among the processes and no part of the total.

`cpu_percent_boards` is that of emulated boards, which a real robot does not need; it is no part of the figures of the
first two windows. `io_rate_hz` and `io_missed_percent` are those of the worst io; missed are deadlines that passed
without a cycle, of all deadlines. CPU time is the kernel's count for a process in the window; 100 % is one core.
`arm_period_p99_us` is that of the worst arm that follows or is followed, in the last second. `pss_mb` is the memory of
the supervisor and all its processes, a page that n processes share counted as 1/n in each; `locked_mb` is the locked
memory of all processes (VmLck); shared memory counts for the supervisor, which locks it.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trocar.procs.tables.bring_up import DISABLED
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.events import ERROR, WARNING
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.measuring import FULL, cpu_s, home_all, pss_mb, seconds_since
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.following import beats
from trocar.tools.examples.operator_sim import OperatorSim, Sway, seats
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.watch import Watch, powered_names
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import counted, number, plain, table
from trocar.tools.systems.find import instances_of_kind, system_file
from trocar.tools.systems.processes import SUPERVISOR
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

SECONDS = 20.0
SETTLE_S = 1.0  # after homing, until arms rest
MOVES_HZ = 200.0
REPORTED = 1024  # newest events of a process that are looked at
KEPT_TEXTS = 5
FIFO_SHARE = Path("/proc/sys/kernel/sched_rt_runtime_us")


def run(file: Path = FULL, paths: tuple[Path, ...] = (), boards: str = "", seconds: float = SECONDS,
        sets: tuple[str, ...] = ()) -> dict[str, Any]:
    """Measure."""
    name = f"bench-system-{os.getpid()}"
    begin = monotonic_ns()
    with up_meanwhile(StartRequest(system_file(file, paths), name, boards, paths, (*sets, "clock=wall"))):
        up_s, begin = seconds_since(begin), monotonic_ns()
        refusals = home_all(name)
        homed_s = seconds_since(begin)
        pause(SETTLE_S)
        costs = {"up_s": up_s, "cpu_percent_rest": _cpu_percent(name, seconds)}
        with seats(name) as taken:
            for seat in taken:
                seat.begin()
                seat.wait()
            followed = [teleop for seat in taken for teleop in seat.try_all()]
            costs["cpu_percent_following"] = _cpu_percent(name, seconds)
            found = _measure(name, taken, seconds)
        with contextlib.suppress(Problem):
            bring_all(name, (), DISABLED)
    return {**found, "figures": {**costs, **found["figures"]}, "conditions": {
        "system": str(file), "boards": boards or "as the file says", "seconds": seconds, "homed_after_s": homed_s,
        "homing_failed_before": refusals, "teleops_tried": followed, "sets": list(sets),
        "fifo_share_us": FIFO_SHARE.read_text(encoding="utf-8").strip() if FIFO_SHARE.exists() else ""}}


@dataclass(frozen=True, slots=True)
class Mark:
    """The counters of one process: `cycles` at its last beat, `cpu_s` at the time of looking."""

    beat_ns: int
    look_ns: int
    kind: str
    pid: int
    cycles: int
    missed: int
    overruns: int
    cpu_s: float
    scheduling: str
    locked_mb: float = 0.0


class SystemReport:
    """Warnings and errors of one process from now on."""

    def __init__(self, system: str, name: str) -> None:
        self._ring: RingReader = directory.reader(system, name, "events")
        self._since = self._ring.head

    def count(self, severity: int) -> tuple[int, list[str]]:
        """Number of events, and the newest different texts."""
        kept = self._ring.last(REPORTED)
        texts = [str(plain(bytes(text))) for text in
                 kept["text"][(kept["sequence"] > self._since) & (kept["severity"] == severity)]]
        return len(texts), list(dict.fromkeys(reversed(texts)))[:KEPT_TEXTS]

    def close(self) -> None:
        """Unmap."""
        self._ring.close()


def _measure(system: str, taken: list[OperatorSim], seconds: float) -> dict[str, Any]:
    chosen = [teleop for seat in taken for teleop in seat.expected()]
    with contextlib.ExitStack() as stack:
        sways = [Sway(system, name) for name in _kinematic(system, [m for teleop in chosen for m in teleop.masters])]
        names = [process.name for process in statuses(system) if process.kind != "supervisor"]
        reported = {name: SystemReport(system, name) for name in names}
        for close in (*(sway.close for sway in sways), *(each.close for each in reported.values())):
            stack.callback(close)
        before, begin, used = marks(system), monotonic_ns(), cpu_s(os.getpid())
        untaken = swing(sways, seconds)
        after, passed_s = marks(system), (monotonic_ns() - begin) * 1e-9
        rows = [row(name, before[name], after[name]) for name in after if name in before]
        bench = {"name": "bench", "kind": "bench", "cpu_percent": (cpu_s(os.getpid()) - used) / passed_s * 100.0}
        arms = [arm for teleop in chosen for arm in (*teleop.masters, teleop.slave)]
        worst_s = max((_period_p99_s(system, arm) for arm in arms), default=0.0)
        following = [teleop.name for teleop in chosen if teleop.is_following]
        missing = [teleop.reported for teleop in chosen if not teleop.is_following]
        errors = {name: each.count(ERROR) for name, each in reported.items()}
        warnings = {name: each.count(WARNING) for name, each in reported.items()}
        homed = [name for name in powered_names(system) if _shows(system, name, "is_homed")]
        (supervisor,) = (process.pid for process in statuses(system) if process.name == SUPERVISOR)
    return {
        "figures": {**figures(rows), "arm_period_p99_us": worst_s * 1e6, "pss_mb": pss_mb(supervisor),
                    "arms": len(homed), "teleops": len(following),
                    "errors": sum(count for count, _ in errors.values()),
                    "warnings": sum(count for count, _ in warnings.values())},
        "homed": homed, "following": following, "processes": [*rows, bench],
        "reported": {name: [*errors[name][1], *warnings[name][1]] for name in reported
                     if errors[name][0] + warnings[name][0]},
        "problems": [*_problems(system, homed, missing, errors, before, after),
                     *(f"{name} did not take {count} of the goals that it was sent" for name, count in untaken)],
    }


def _cpu_percent(system: str, seconds: float) -> float:
    """CPU time of all processes but emulated boards in a window in which we send nothing; 100: one core."""
    before = marks(system)
    pause(seconds)
    after = marks(system)
    rows = [row(name, before[name], after[name]) for name in after if name in before]
    return float(figures(rows)["cpu_percent_without_boards"])


def swing(sways: Sequence[Sway], seconds: float) -> list[tuple[str, int]]:
    """Move masters for this long; returns those that refused goals, with counts: a stalled master does not end it."""
    untaken = dict.fromkeys((sway.name for sway in sways), 0)
    for k in beats(MOVES_HZ, round(seconds * MOVES_HZ), [0]):
        for sway in sways:
            try:
                sway.step(k / MOVES_HZ)
            except MailboxFull:
                untaken[sway.name] += 1
    return [(name, count) for name, count in untaken.items() if count]


def marks(system: str) -> dict[str, Mark]:
    """Present figures of every process of a system."""
    found = {}
    for process in statuses(system):
        page = ControlPage(system, process.name)
        beat_ns, cycles = int(page.get("heartbeat_ns")), int(page.get("cycles"))
        found[process.name] = Mark(beat_ns, monotonic_ns(), process.kind, process.pid, cycles, int(page.get("missed")),
                                   int(page.get("overruns")), cpu_s(process.pid), process.scheduling,
                                   _locked_mb(process.pid))
        page.close()
    return found


def row(name: str, before: Mark, after: Mark) -> dict[str, Any]:
    """Figures of one process in a window; one that restarted meanwhile counts as if started at its begin."""
    if before.pid != after.pid:
        before = Mark(before.beat_ns, before.look_ns, after.kind, after.pid, 0, 0, 0, 0.0, after.scheduling)
    beats_s, passed_s = (max(1, then - was) * 1e-9 for was, then in
                         ((before.beat_ns, after.beat_ns), (before.look_ns, after.look_ns)))
    cycles, missed = after.cycles - before.cycles, after.missed - before.missed
    return {
        "name": name, "kind": after.kind, "rate_hz": cycles / beats_s,
        "missed_percent": missed / max(1, missed + cycles) * 100.0, "missed": missed,
        "overruns": after.overruns - before.overruns, "cpu_percent": (after.cpu_s - before.cpu_s) / passed_s * 100.0,
        "scheduling": after.scheduling, "locked_mb": after.locked_mb,
    }


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of all processes together."""
    ios = [each for each in rows if each["kind"] == "io"]
    worst: dict[str, float] = {
        f"{kind}_missed_percent": max((each["missed_percent"] for each in rows if each["kind"] == kind), default=0.0)
        for kind in ("arm", "teleop")
    }
    return {
        "io_rate_hz": min((each["rate_hz"] for each in ios), default=0.0),
        "io_missed_percent": max((each["missed_percent"] for each in ios), default=0.0),
        "cpu_percent_total": sum(each["cpu_percent"] for each in rows),
        "cpu_percent_without_boards": sum(each["cpu_percent"] for each in rows if each["kind"] != "boards"),
        "cpu_percent_boards": sum(each["cpu_percent"] for each in rows if each["kind"] == "boards"), **worst,
        "locked_mb": sum(each["locked_mb"] for each in rows),
    }


def show(result: dict[str, Any]) -> None:
    """Further results for people."""
    rows = [(each["name"], number(each.get("rate_hz")), number(each.get("missed_percent"), ".2f"),
             str(each.get("overruns", "–")), number(each["cpu_percent"]), number(each.get("locked_mb")),
             each.get("scheduling", ""))
            for each in result["processes"]]
    columns = ("process", "Hz", "missed %", "overruns", "CPU %", "locked MB", "scheduling")
    table("bench system: processes", columns, rows, columns[1:6])
    print(f"homed: {', '.join(result['homed'])}\nfollowing: {', '.join(result['following'])}")
    for name, texts in result["reported"].items():
        for text in texts:
            print(f"{name} reported: {text}")


def _problems(system: str, homed: list[str], missing: list[str], errors: dict[str, tuple[int, list[str]]],
              before: dict[str, Mark], after: dict[str, Mark]) -> list[str]:
    printed = [f"{name} is not homed" for name in powered_names(system) if name not in homed] + missing
    printed += [f"{name} reported {counted(count, 'error')}: {texts[0]}"
                for name, (count, texts) in errors.items() if count]
    restarted = [name for name in after if name in before and before[name].pid != after[name].pid]
    return printed + [f"{name} was restarted" for name in restarted]


def _kinematic(system: str, masters: list[str]) -> list[str]:
    """Of some masters those without a robot, each once."""
    arms = set(instances_of_kind(system, "arm"))
    return [name for name in dict.fromkeys(masters) if name in arms and _shows(system, name, "simulated")]


def _shows(system: str, name: str, flag: str) -> bool:
    with Watch(system, name) as watch:
        return watch.look() and watch.flag(flag)


def _period_p99_s(system: str, arm: str) -> float:
    with contextlib.closing(ControlPage(system, arm)) as page:
        return float(page.get("period_p99"))


def _locked_mb(pid: int) -> float:
    """Locked memory of a process as the kernel counts it against its limit; 0 when it is gone."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) * 1024e-6 for line in lines if line.startswith("VmLck:")), 0.0)
