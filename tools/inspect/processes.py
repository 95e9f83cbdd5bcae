"""State of the processes of a system, from their control pages and the supervisor's record."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from trocar.procs.crtk.reported import supervised
from trocar.procs.document.bridges import reached_at
from trocar.procs.document.process import ALWAYS, ELSEWHERE, Process, processes_of
from trocar.procs.node.realtime import NO_FIFO, NOT_LOCKED, ORDINARY
from trocar.procs.tables.lifecycle import is_meant
from trocar.procs.tables.manifest import FILTERS, IN_TIME, THIRD_PARTY, silence_s
from trocar.shm.memory.parts import removed_words
from trocar.shm.memory.segment import SegmentError, names_of, start_time
from trocar.shm.system import directory
from trocar.shm.time.clock import boottime_ns, monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.system_time import SystemTime
from trocar.tools.inspect.replayed import recorded_clock
from trocar.tools.output.printing import counted, number, plain
from trocar.tools.systems.find import alive, is_simulated, state_info
from trocar.tools.systems.processes import SUPERVISOR

DEAD, FAILED, NOT_RUNNING = "dead", "failed", "not running"  # problems
SILENT, STALLED, STOPPED = "silent", "stalled", "stopped"
SIMULATED_LATE_S = 2.0
LOOK_AGAIN_S = 0.02
PACED = (IN_TIME - {SUPERVISOR}) | {FILTERS}
SLOW = 2.0  # times its period, on the average: its results are then not as designed
TRIES = 5
RECENT_S = 10.0  # for this long after an automatic restart a process does not count as well
KEPT = 20  # endings of one instance; the supervisor keeps its last 256 changes of all
ALL = 1 << 16  # records: more than any ring has
NOT_ATTACHED, DETACHED = "NOT ATTACHED", "DETACHED"
SHOWN_OF_OTHERS = {"CREATED": NOT_ATTACHED, "RUNNING": "ATTACHED", "STOPPED": DETACHED}
COLUMNS = ("process", "state", "pid", "Hz", "p99 ms", "work ms", "missed", "restarts", "problem")
RIGHT = ("pid", "Hz", "p99 ms", "work ms", "missed", "restarts")
BEGINNING = ("CREATED", "STARTING", "RESTARTING", "FAILED")  # failed: the supervisor may not know yet
SENTENCES = {DEAD: "{} is dead", STALLED: "{} is stalled", SILENT: "{} is silent", FAILED: "{} failed",
             NOT_RUNNING: "{} is not running", STOPPED: "{} is stopped"}
"""For problems that are a word; all others are a process's own report."""
TICKS = os.sysconf("SC_CLK_TCK")
SAYS_WHY = FAILED, NOT_RUNNING, STOPPED
ENDING = ("STOPPING", "RESTARTING")  # the process may not have received it yet
COUNTS = ("cycles", "missed", "overruns", "pauses")
STATISTICS = ("period", "work", "latency")
PARTS = ("avg", "std", "min", "max", "p99")
PAGE_GONE = "its control page is gone from shared memory"
SLOW_TIME = 0.02
"""Simulated over real time; a busy machine alone does not make it so slow."""
STANDS_S = 0.5
LOOKS = 20
EVERY_S = 0.01
NEARLY_ALWAYS = 0.8


@dataclass(frozen=True, slots=True)
class PastProcess:
    """One that has ended: its number, when that was seen by the system's clock, and how, in words."""

    pid: int
    stamp_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class ProcessStatus:
    """One process: figures are of its last full second, counts since its start; `problem` is empty when all is well.

    `statistics` are avg, std, min, max and p99, in s, of its period, its work and, for io, its latency from the boards'
    reply to the next write; unmeasured ones are absent. `pauses`: number of restarts after a stall. For a third-party
    program `state` is NOT ATTACHED, ATTACHED or DETACHED; for a crashed process, DEAD. `simulation` is KINEMATIC for an
    arm without a robot, and for the process that emulates it.
    """

    name: str
    kind: str
    state: str
    pid: int = 0
    rate_hz: float | None = None
    period_p99_s: float | None = None
    work_p99_s: float | None = None
    cycles: int = 0
    missed: int = 0
    overruns: int = 0
    pauses: int = 0
    restarts: int = 0
    exit_reason: str = ""
    scheduling: str = ""
    silent_s: float | None = None
    problem: str = ""
    statistics: dict[str, dict[str, float]] = field(default_factory=dict)
    simulation: str = ""
    lifecycle: str = ""
    """STOPPED, RUNNING, STOPPING or RESTARTING: the supervisor's goal for it (procs/tables/lifecycle.py)."""
    endings: tuple[PastProcess, ...] = ()
    """The processes that it had before, as far as the supervisor's records go back."""
    cpus: tuple[int, ...] = ()
    """Its configured processors; none: any. `scheduling` gives the result."""
    listen: tuple[str, ...] = ()
    """Its addresses for connections; a connection starts it if it runs on demand."""
    computes: str = ""
    """`native`, or `numpy: ` and why, of processes that compute for many axes."""
    after: tuple[str, ...] = ()
    """Processes that it needs."""
    host: str = ""
    """The host process that contains it."""
    restarted_s: float | None = None
    """Time since its automatic restart after it had ended by itself; None: none, or RECENT_S and more ago."""
    lives: bool = True
    """Its process exists; if not, all data about it is `silent_s` old."""

    @property
    def typed(self) -> str:
        """The name to type for starting or restarting it, and for its log."""
        return self.host or self.name

    @property
    def begins(self) -> bool:
        """Whether the process is not up yet, but will be."""
        return self.state in BEGINNING and self.lifecycle != "STOPPED" and bool(self.lifecycle or self.lives)

    @property
    def begins_again(self) -> bool:
        """Whether it is not up yet after it has ended by itself."""
        return self.begins and bool(self.exit_reason) and not is_meant(self.exit_reason)

    @property
    def moves_the_robot(self) -> bool:
        """Whether arms cannot move as they should without the process; other processes record, show, or forward."""
        return self.kind in (SUPERVISOR, "", *IN_TIME, *THIRD_PARTY)

    @property
    def word(self) -> str:
        """Its problem as a key of SENTENCES; empty: none, or its own report, which may begin with such a word."""
        word = self.problem.partition(":")[0]
        is_report = self.lives and self.state == "RUNNING" and word != self.problem
        return word if word in SENTENCES and not is_report else ""

    @property
    def works(self) -> bool:
        """Whether it works, if slowly or with a problem that it reports itself."""
        return self.lives and not self.word

    @property
    def said(self) -> str:
        """Its problem in a sentence; empty: it has none."""
        word = self.word
        said = SENTENCES.get(word, "{}: ").format(self.name) + self.problem[len(word):] if self.problem else ""
        is_of_this_end = not self.lives and self.lifecycle != "RUNNING"  # else of an earlier process
        ended = f" ({self.exit_reason})" if self.exit_reason and is_of_this_end and word not in SAYS_WHY else ""
        return f"{said}{ended}" if said else ""


def statuses(system: str) -> list[ProcessStatus]:
    """Every process of a system, the supervisor first, also one without its control page."""
    ledger, rows, simulated = _ledger(system), _rows(system), is_simulated(system)
    ours = [] if recorded_clock(system) else [row.name for row in rows.values() if row.start != ELSEWHERE]
    found = [_read(system, name, rows.get(name), ledger.get(name, {}), simulated)
             for name in dict.fromkeys((SUPERVISOR, *directory.instances(system), *ours))]
    found[0] = dataclasses.replace(found[0], problem=found[0].problem or removed_words(system))
    if found[0].state != "RUNNING":  # it is being stopped as a whole
        return found
    slow, speed = _waited_for(system) if simulated else ("", 1.0)
    found = _in_slow_time(found, slow, speed) if slow else found
    return [dataclasses.replace(one, problem=STOPPED) if _is_stopped(one, rows) else one for one in found]


def _read(system: str, name: str, row: Process | None, ledger: Mapping[str, Any], simulated: bool) -> ProcessStatus:
    reported = state_info(system, name)
    kind = ledger.get("kind") or reported.get("kind") or (row.kind if row is not None else "")
    row = dataclasses.replace(row or Process(name, "", 0.0, start=ELSEWHERE),
                              kind=SUPERVISOR if name == SUPERVISOR else str(kind))
    try:
        page = ControlPage(system, name)
    except SegmentError as error:
        lost = PAGE_GONE if (system, name, "control") not in names_of(system) else str(error)
        return ProcessStatus(name, row.kind, "UNKNOWN", problem=lost, restarts=int(ledger.get("restarts", 0)),
                             exit_reason=str(ledger.get("exit_reason", "")), endings=ledger.get("endings", ()),
                             lives=False)
    with contextlib.closing(page):
        look = _Look(page, row, ledger, simulated, alive(page.segment.identity()))
        return _status(look, str(reported.get("simulation", "")))


def _in_slow_time(found: list[ProcessStatus], slow: str, speed: float) -> list[ProcessStatus]:
    """With the problem of the process that time waits for; while it is silent, time stands, and nothing has a rate."""
    silent_s = next((one.silent_s or 0.0 for one in found if one.name == slow), 0.0)
    said = f"its cycles take so long that simulated time runs at {speed:.3f} of real time"
    if silent_s > STANDS_S:
        said = f"silent for {silent_s:.1f} s; simulated time waits for it"
        found = [dataclasses.replace(one, rate_hz=None) if one.kind in PACED else one for one in found]
    return [dataclasses.replace(one, problem=said) if one.name == slow and not one.problem else one for one in found]


def _waited_for(system: str) -> tuple[str, float]:
    """The process whose cycles almost stop time, and the speed of time; "": none, or time is held.

    Looks for 0.2 s, if the last second was slow.
    """
    with contextlib.suppress(SegmentError), SystemTime(system) as time, contextlib.ExitStack() as held:
        if time.speed >= SLOW_TIME or time.is_held:
            return "", 1.0
        pages = {name: held.enter_context(contextlib.closing(ControlPage(system, name))) for name in time.members}
        awake: Counter[str] = Counter()
        begin_ns, begin_real_ns = time.now_ns(), monotonic_ns()
        for _ in range(LOOKS):
            pause(EVERY_S)
            awake.update(name for name, page in pages.items() if not page.get("wakeup"))
        speed = (time.now_ns() - begin_ns) / (monotonic_ns() - begin_real_ns)
        ((name, times),) = awake.most_common(1) or [("", 0)]
        if speed < SLOW_TIME and not time.is_held and times >= NEARLY_ALWAYS * LOOKS:
            return name, speed
    return "", 1.0


def _is_stopped(one: ProcessStatus, rows: Mapping[str, Process]) -> bool:
    """Whether an operator has stopped the process, and the system lacks it."""
    return one.exit_reason.partition(":")[0] == STOPPED and one.lifecycle == "STOPPED" and not one.problem and (
        one.name in rows and rows[one.name].start == ALWAYS)


def _rows(system: str) -> dict[str, Process]:
    """The configuration of each process; empty if it is unreadable."""
    try:
        text = directory.document(system)
        reached = reached_at(text)
        return {row.name: dataclasses.replace(row, listen=row.listen or reached.get(row.name, ()))
                for row in processes_of(text)}
    except (SegmentError, ValueError):
        return {}


def _ledger(system: str) -> dict[str, dict[str, Any]]:
    """The supervisor's record of each instance."""
    with contextlib.suppress(SegmentError), contextlib.closing(
            directory.reader(system, SUPERVISOR, "state", SUPERVISOR, often=False)) as reader:
        ended = endings(reader.last(ALL))
        return {name: {**row, "endings": ended.get(name, ())} for name, row in
                supervised(reader, "kind", "lifecycle", "restarts", "exit_reason").items()}
    return {}


def endings(records: NDArray[Any]) -> dict[str, tuple[PastProcess, ...]]:
    """Of each instance, oldest first, at most KEPT.

    `records` are those of the supervisor's topic `state`, oldest first. A process has ended where the next record has
    another process for its instance, or none.
    """
    found: dict[str, list[PastProcess]] = {}
    pids: dict[str, int] = {}
    for record in records:
        stamp_ns = int(record["stamp_ns"])
        columns = (plain(record[field]) for field in ("instance", "pid", "exit_reason"))
        for name, pid, text in zip(*columns, strict=True):
            before, pids[name] = pids.get(name, 0), int(pid)
            if before and before != pid:
                found.setdefault(name, []).append(PastProcess(before, stamp_ns, text))
    return {name: tuple(rows[-KEPT:]) for name, rows in found.items()}


@dataclass(frozen=True, slots=True)
class _Look:
    """One look at a process: its control page, configuration and record in the supervisor, and whether it lives."""

    page: ControlPage
    row: Process
    ledger: Mapping[str, Any]
    simulated: bool
    lives: bool

    @property
    def lifecycle(self) -> str:
        return str(self.ledger.get("lifecycle", ""))

    @property
    def exit_reason(self) -> str:
        return str(self.ledger.get("exit_reason", ""))

    @property
    def state(self) -> str:
        """As `status` shows it."""
        state, lifecycle = self.page.state, self.lifecycle
        if self.row.kind in THIRD_PARTY and self.row.start == ELSEWHERE:
            state = SHOWN_OF_OTHERS.get(state, state)
        return lifecycle if lifecycle in ENDING or (lifecycle, state) == ("STOPPED", "CREATED") else state

    @property
    def restarted_s(self) -> float | None:
        """How long the process runs, if the supervisor started it again a short while ago; else None."""
        if not self.lives or not self.exit_reason or is_meant(self.exit_reason):
            return None
        began = start_time(int(self.page.get("pid")))
        age_s = boottime_ns() * 1e-9 - began / TICKS
        return age_s if began and self.ledger.get("restarts") and age_s < RECENT_S else None

    def problem(self) -> str:
        state = self.page.state
        if state == "FAILED" and (self.lives or self.lifecycle in ("STOPPED", "")):
            return f"{FAILED}: {plain(self.page.get('error'))}"
        if not self.lives:
            return self._end(state)
        if state != "RUNNING":
            return ""
        if _stalled(self.row, self.page, self.simulated):
            return SILENT if self.row.kind in THIRD_PARTY else STALLED
        return str(plain(self.page.get("error"))) or ("" if self.simulated else _slow(self.row, self.page))

    def _end(self, state: str) -> str:
        """Of a process that does not live."""
        if self.lifecycle == "RESTARTING" or (self.lifecycle == "RUNNING" and state in ("CREATED", "FAILED")):
            return ""
        by_itself = self.lifecycle == "STOPPED" and self.row.on_exit == "restart" and not is_meant(self.exit_reason)
        if self.exit_reason and (state == "CREATED" or (state == "STOPPED" and by_itself)):
            return f"{NOT_RUNNING}: {self.exit_reason}"
        return DEAD if self.row.kind == SUPERVISOR or state in ("STARTING", "RUNNING", "STOPPING") else ""


def _status(look: _Look, simulation: str) -> ProcessStatus:
    page, row, problem = look.page, look.row, look.problem()
    measured = {which: {part: float(page.get(f"{which}_{part}")) for part in PARTS} for which in STATISTICS}
    measured = {which: parts for which, parts in measured.items() if parts["max"] > 0.0 and look.lives}
    period, work, beat = measured.get("period"), measured.get("work"), int(page.get("heartbeat_ns"))
    return ProcessStatus(
        name=row.name, kind=row.kind, state=DEAD.upper() if problem == DEAD else look.state, pid=int(page.get("pid")),
        rate_hz=1.0 / period["avg"] if period and period["avg"] > 0.0 else None,
        period_p99_s=period["p99"] if period else None, work_p99_s=work["p99"] if work else None,
        **{count: page.get(count) for count in COUNTS},
        restarts=int(look.ledger.get("restarts", 0)), exit_reason=look.exit_reason,
        scheduling=str(plain(page.get("policy"))), silent_s=(monotonic_ns() - beat) * 1e-9 if beat else None,
        problem=problem, statistics=measured, simulation=simulation, lifecycle=look.lifecycle,
        endings=look.ledger.get("endings", ()), cpus=row.cpus, listen=row.listen,
        computes=str(plain(page.get("computes"))), after=row.after, host=row.host, restarted_s=look.restarted_s,
        lives=look.lives)


def _slow(row: Process, page: ControlPage) -> str:
    """On the wall clock: it misses more than half of its deadlines."""
    period_s = float(page.get("period_avg")) if row.kind in PACED else 0.0
    rests = page.get("interval_missed") < page.get("interval_cycles")
    if row.period_s <= 0.0 or period_s <= SLOW * row.period_s or rests:
        return ""
    return f"runs at {1 / period_s:.4g} Hz instead of {1 / row.period_s:.4g}: this machine is too slow (trocar doctor)"


def _stalled(row: Process, page: ControlPage, simulated: bool) -> bool:
    """Whether a process is silent for longer than allowed, also at a second look: one late cycle is no stall."""
    try:
        # In simulated time all wait for a process that has no core, so it may be silent for longer.
        late_ns = max(silence_s(row), SIMULATED_LATE_S if simulated else 0.0) * 1e9
    except KeyError:
        return False
    beat = int(page.get("heartbeat_ns"))
    if not beat or monotonic_ns() - beat <= late_ns:
        return False
    for _ in range(TRIES):
        pause(LOOK_AGAIN_S)
        if int(page.get("heartbeat_ns")) != beat:
            return False
    return True


def cells(process: ProcessStatus) -> tuple[str, ...]:
    """A process as a row of a table with COLUMNS; times are the 99 % ones of period and work."""
    in_ms = [number(None if s is None else s * 1e3, ".3f") for s in (process.period_p99_s, process.work_p99_s)]
    name = f"{process.name} {process.simulation}".rstrip()
    return (name, process.state, str(process.pid or "–"), number(process.rate_hz), *in_ms, str(process.missed),
            str(process.restarts), process.problem)


def remarks(process: ProcessStatus) -> str:
    """Further remarks on a process: kinematic only, scheduling granted, last end."""
    parts = [f"{process.simulation}, there is no robot"] if process.simulation else []
    granted = [word for word in process.scheduling.split(", ") if word not in (NO_FIFO, NOT_LOCKED, ORDINARY, "")]
    parts += [", ".join(granted)] if granted else []
    parts += [f"listens at {' and '.join(process.listen)}"] if process.listen else []
    parts += [process.computes] if process.computes not in ("", "native") else []
    latency = process.statistics.get("latency")
    if latency:
        in_us = {part: latency[part] * 1e6 for part in PARTS}
        parts.append("reply to write {avg:.0f} ± {std:.0f} µs, {min:.0f} to {max:.0f}, p99 {p99:.0f}".format(**in_us))
    parts += [f"stalled {counted(process.pauses, 'time')}"] if process.pauses else []
    return "; ".join(parts + ([f"last ended: {process.exit_reason}"] if process.exit_reason else []))
