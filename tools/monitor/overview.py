"""The header of every page: system, supervision, clock, and the first step to take."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from trocar.procs.document.process import CALIBRATION_MODE
from trocar.shm.memory.segment import SegmentError, segment_name, status_of
from trocar.shm.time.control_page import silence_s
from trocar.shm.time.system_time import SystemTime
from trocar.tools.inspect.processes import STALLED, ProcessStatus, statuses
from trocar.tools.inspect.replayed import clock_in_words
from trocar.tools.inspect.standing import Standing, first_thing, in_a_line, standings, system_remarks
from trocar.tools.output.printing import span
from trocar.tools.systems.find import is_up
from trocar.tools.systems.processes import SUPERVISOR


@dataclass(frozen=True, slots=True)
class Overview:
    """`supervisor` is RUNNING, dead or gone (memory removed); `dead_s`: since the last heartbeat of a dead one."""

    system: str
    supervisor: str
    dead_s: float | None
    clock: str
    processes: tuple[ProcessStatus, ...] = ()
    standings: tuple[Standing, ...] = ()
    calibrating: bool = False

    @property
    def lives(self) -> bool:
        """Whether the system has a supervisor, so that the display is current."""
        return self.supervisor == "RUNNING"

    @property
    def stalled_s(self) -> float | None:
        """Time since the last heartbeat of a supervisor that lives, but is stalled; None: it is not."""
        return next((one.silent_s for one in self.processes if one.name == SUPERVISOR and one.problem == STALLED), None)

    @property
    def words(self) -> str:
        """The supervisor, in words."""
        if self.lives:
            return "supervisor runs" if self.stalled_s is None else f"supervisor stalled for {span(self.stalled_s)}"
        if self.supervisor == "gone":
            return "is down, its memory removed: waiting until it is up again"
        since = f" for {span(self.dead_s)}" if self.dead_s is not None else ""
        return f"supervisor dead{since}: left in shared memory"

    @property
    def silences(self) -> dict[str, float]:
        """For crashed or stopped processes the time since their last heartbeat, s."""
        return {one.name: one.silent_s for one in self.processes
                if one.silent_s is not None and (one.problem == "dead" or one.state in ("STOPPED", "FAILED"))}

    @property
    def first(self) -> str:
        """All well, or the first step to take."""
        if self.supervisor == "gone":
            return f"first: trocar up starts {self.system}"
        return in_a_line(self.processes, self.standings)

    @property
    def remark(self) -> str:
        """What holds for the whole system until it is restarted; empty: nothing."""
        return CALIBRATION_MODE if self.calibrating else ""

    @property
    def is_well(self) -> bool:
        """Whether no step is required."""
        return self.lives and not first_thing(self.processes, self.standings)


def overview(system: str) -> Overview:
    """The current overview; for a system whose memory is gone only that."""
    if not identity_of(system):
        return Overview(system, "gone", None, "")
    processes = tuple(statuses(system))
    found = tuple(standings(system, processes))
    clock, calibrating = "", system_remarks(system)[0]
    with contextlib.suppress(SegmentError), SystemTime(system) as time:
        clock = clock_in_words(system, time)
    if is_up(system):
        return Overview(system, "RUNNING", None, clock, processes, found, calibrating)
    return Overview(system, "dead", silence_s(system, SUPERVISOR), clock, processes, found, calibrating)


def identity_of(system: str) -> tuple[int, ...]:
    """Identity of the files with the system's memory; a restarted system has others. Empty: there are none."""
    for what in ("document", "control"):
        with contextlib.suppress(OSError):
            status = status_of(segment_name(system, SUPERVISOR, what))
            return status.st_dev, status.st_ino
    return ()
