"""State of the processes of a system, from their control pages and the supervisor's record."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from trocar.procs.document.process import ALWAYS, ELSEWHERE, Process, processes_of
from trocar.procs.node.realtime import NO_FIFO, NOT_LOCKED, ORDINARY
from trocar.procs.tables.lifecycle import is_meant
from trocar.procs.tables.manifest import FILTERS, IN_TIME, THIRD_PARTY, late_s
from trocar.shm.memory.segment import Segment, SegmentError, names_of, segment_name, start_time
from trocar.shm.system import directory
from trocar.shm.time.clock import boottime_ns, monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.system_time import SystemTime
from trocar.tools.inspect.replayed import is_replay, recorded_clock
from trocar.tools.output.printing import counted, number, plain
from trocar.tools.systems.find import alive, is_simulated
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
OF_THE_SYSTEM = ("document", "faults")  # segments that the supervisor has for all
GONE = "gone from shared memory"
PAGE_GONE = f"its control page is {GONE}"
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
        return self.lives and not self.word and not self.problem.endswith(GONE)

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
    ledger, rows = _ledger(system), _rows(system)
    simulated = is_simulated(system)
    there = names_of(system)
    ours = [] if recorded_clock(system) else [row.name for row in rows.values() if row.start != ELSEWHERE]
    found = []
    for name in dict.fromkeys((SUPERVISOR, *directory.instances(system), *ours)):
        reported = _reported(system, name)
        known = {"kind": reported.get("kind") or (rows[name].kind if name in rows else ""), **ledger.get(name, {})}
        try:
            page = ControlPage(system, name)
        except SegmentError as error:
            lost = PAGE_GONE if (system, name, "control") not in there else str(error)
            found.append(_without_page(name, known, lost))
            continue
        with contextlib.closing(page):
            lost = _lost_of(page, [what for _, instance, what in there if instance == name])
            process = _life(name, page, known, simulated, rows.get(name), lost)
            found.append(dataclasses.replace(process, simulation=str(reported.get("simulation", ""))))
    if found[0].state != "RUNNING":  # it is being stopped as a whole
        return found
    slow, speed = _waited_for(system) if simulated else ("", 1.0)
    found = _in_slow_time(found, slow, speed) if slow else found
    return [dataclasses.replace(one, problem=STOPPED) if _is_stopped(one, rows) else one for one in found]


def _lost_of(page: ControlPage, there: Collection[str]) -> str:
    """Segments named in its control page that are not `there` any more, in words; empty: none."""
    if is_replay(page.segment.header.info):
        return ""
    wanted = page.segment.header.info.get("wanted")
    topics = {str(name).partition("/")[0] for name in wanted} if isinstance(wanted, list) else set()
    topics |= {"mailbox"} if "audit" in topics else set()
    topics |= set(OF_THE_SYSTEM) if page.instance == SUPERVISOR else set()
    lost = sorted(topics - set(there))
    return f"its {', '.join(lost)} {'is' if len(lost) == 1 else 'are'} {GONE}" if lost else ""


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
        if speed >= SLOW_TIME or time.is_held or times < NEARLY_ALWAYS * LOOKS:
            return "", 1.0
        return name, speed
    return "", 1.0


def _is_stopped(one: ProcessStatus, rows: Mapping[str, Process]) -> bool:
    """Whether an operator has stopped the process, and the system lacks it."""
    return one.exit_reason.partition(":")[0] == STOPPED and one.lifecycle == "STOPPED" and not one.problem and (
        one.name in rows and rows[one.name].start == ALWAYS)


def _without_page(name: str, known: dict[str, Any], lost: str) -> ProcessStatus:
    return ProcessStatus(name, SUPERVISOR if name == SUPERVISOR else str(known["kind"]), "UNKNOWN", problem=lost,
                         restarts=int(known.get("restarts", 0)), exit_reason=str(known.get("exit_reason", "")),
                         lives=False, endings=known.get("endings", ()))


def _rows(system: str) -> dict[str, Process]:
    """The configuration of each process; empty if it is unreadable."""
    try:
        return {row.name: row for row in processes_of(directory.document(system))}
    except (SegmentError, ValueError):
        return {}


def _reported(system: str, name: str) -> dict[str, Any]:
    """Its state record's header data; any content is possible."""
    try:
        with Segment(segment_name(system, name, "state")) as segment:
            return dict(segment.header.info)
    except (SegmentError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _ledger(system: str) -> dict[str, dict[str, Any]]:
    """The supervisor's record of each instance."""
    try:
        reader = directory.reader(system, SUPERVISOR, "state", SUPERVISOR, often=False)
    except SegmentError:
        return {}
    with contextlib.closing(reader):
        if not reader.newest():
            return {}
        names = ("instance", "kind", "lifecycle", "restarts", "exit_reason")
        columns = {name: plain(reader.field(name)) for name in names}
        ended = endings(reader.last(ALL))
    rows = [dict(zip(names, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    return {str(row["instance"]): {**row, "endings": ended.get(str(row["instance"]), ())} for row in rows
            if row["instance"]}


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


def _life(name: str, page: ControlPage, ledger: dict[str, Any], simulated: bool, row: Process | None, lost: str
          ) -> ProcessStatus:
    kind = SUPERVISOR if name == SUPERVISOR else str(ledger.get("kind", ""))
    state, lives_on = page.state, alive(page.segment.identity())
    lifecycle, exit_reason = str(ledger.get("lifecycle", "")), str(ledger.get("exit_reason", ""))
    counts = {count: page.get(count) for count in COUNTS}
    statistics = {which: {part: float(page.get(f"{which}_{part}")) for part in PARTS} for which in STATISTICS}
    statistics = {which: parts for which, parts in statistics.items() if parts["max"] > 0.0 and lives_on}
    period, work = statistics.get("period"), statistics.get("work")
    beat = int(page.get("heartbeat_ns"))
    is_theirs = kind in THIRD_PARTY and (row is None or row.start == ELSEWHERE)
    shown = SHOWN_OF_OTHERS.get(state, state) if is_theirs else state
    shown = lifecycle if lifecycle in ENDING or (lifecycle, shown) == ("STOPPED", "CREATED") else shown
    known = row or Process(name, kind, 0.0)
    problem = lost or _problem(known, state, lives_on, page, simulated, exit_reason, lifecycle)
    return ProcessStatus(
        name=name, kind=kind, state=DEAD.upper() if problem == DEAD else shown, pid=int(page.get("pid")),
        rate_hz=1.0 / period["avg"] if period and period["avg"] > 0.0 else None,
        period_p99_s=period["p99"] if period else None, work_p99_s=work["p99"] if work else None,
        **counts,
        restarts=int(ledger.get("restarts", 0)), exit_reason=exit_reason,
        scheduling=str(plain(page.get("policy"))),
        silent_s=(monotonic_ns() - beat) * 1e-9 if beat else None,
        computes=str(plain(page.get("computes"))), lifecycle=lifecycle, endings=ledger.get("endings", ()),
        host=row.host if row is not None else "",
        listen=row.listen if row is not None else (), cpus=row.cpus if row is not None else (),
        after=row.after if row is not None else (),
        problem=problem, statistics=statistics, lives=lives_on,
        restarted_s=_restarted_s(page, ledger) if lives_on and exit_reason and not is_meant(exit_reason) else None,
    )


def _restarted_s(page: ControlPage, ledger: dict[str, Any]) -> float | None:
    """How long its process runs, where that is one that was started again, a short while ago."""
    began = start_time(int(page.get("pid")))
    age_s = boottime_ns() * 1e-9 - began / TICKS
    return age_s if began and ledger.get("restarts") and age_s < RECENT_S else None


def _problem(row: Process, state: str, lives_on: bool, page: ControlPage, simulated: bool, exit_reason: str,
             lifecycle: str) -> str:
    if state == "FAILED" and (lives_on or lifecycle in ("STOPPED", "")):
        return f"{FAILED}: {plain(page.get('error'))}"
    if not lives_on and (lifecycle == "RESTARTING" or (lifecycle == "RUNNING" and state in ("CREATED", "FAILED"))):
        return ""
    if not lives_on:
        ended_by_itself = lifecycle == "STOPPED" and row.on_exit == "restart" and not is_meant(exit_reason)
        if exit_reason and (state == "CREATED" or (state == "STOPPED" and ended_by_itself)):
            return f"{NOT_RUNNING}: {exit_reason}"
        return DEAD if row.kind == SUPERVISOR or state in ("STARTING", "RUNNING", "STOPPING") else ""
    if state == "RUNNING" and _stalled(row, page, simulated):
        return SILENT if row.kind in THIRD_PARTY else STALLED
    if state != "RUNNING":
        return ""
    return str(plain(page.get("error"))) or ("" if simulated else _slow(row, page))


def _slow(row: Process, page: ControlPage) -> str:
    """On the wall clock: it runs at less than half of its rate."""
    period_s = float(page.get("period_avg")) if row.kind in PACED else 0.0
    if row.period_s <= 0.0 or period_s <= SLOW * row.period_s:
        return ""
    return f"runs at {1 / period_s:.4g} Hz instead of {1 / row.period_s:.4g}: this machine is too slow (trocar doctor)"


def _stalled(row: Process, page: ControlPage, simulated: bool) -> bool:
    """Whether a process is silent for longer than allowed, also at a second look: one late cycle is no stall."""
    try:
        # In simulated time all wait for a process that has no core, so it may be silent for longer.
        late_ns = max(late_s(row), SIMULATED_LATE_S if simulated else 0.0) * 1e9
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
            str(process.restarts),
            process.problem)


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
