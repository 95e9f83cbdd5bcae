"""`trocar status`: the processes of a system, its arms, teleoperations and consoles, and what to do first."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress

from trocar.procs.document.process import CALIBRATION_MODE
from trocar.procs.document.recorder import NAME as RECORDER
from trocar.procs.node.realtime import lacking, refused
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.system_time import WALL, SystemTime
from trocar.tools.inspect import standing
from trocar.tools.inspect.processes import COLUMNS, RIGHT, ProcessStatus, cells, remarks, statuses
from trocar.tools.inspect.replayed import clock_in_words, recorded_clock
from trocar.tools.inspect.standing import first_thing, in_a_line, standings, system_remarks
from trocar.tools.output.printing import emit, plain, table, tell
from trocar.tools.systems.find import chosen_system
from trocar.tools.verbs.options import JsonOption, SystemOption

RIGHTS = "{}; trocar doctor names the remedy"


def status(as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Show processes, arms, teleoperations and consoles, and the next thing to do.

    The first table shows the rate, missed deadlines, restarts and last exit of each process. The second table shows the
    state of each arm. If an arm is in FAULT or waits for something, status gives the reason. The last line says "all
    well", or names the first thing to do. Exit code 1: a process has a problem, or an arm or teleoperation is in FAULT.

    Example: trocar status --json
    """
    name = chosen_system(system)
    processes = statuses(name)
    found = standings(name, processes)
    first = first_thing(processes, found)
    is_fault = any(one.is_fault for one in found)
    recorded = _fault_recording(name, [one.since_ns for one in found]) if is_fault else ""
    with SystemTime(name) as time:
        clock, speed, reported = recorded_clock(name) or time.clock, time.speed, clock_in_words(name, time)
    is_calibrating, shortage = system_remarks(name)
    policies = {process.name: process.scheduling for process in processes} if clock == WALL else {}
    if as_json:
        emit({"system": name, "clock": clock, "speed": speed,
              "processes": [dataclasses.asdict(process) for process in processes],
              "standings": [dataclasses.asdict(one) for one in found], "rights": lacking(policies), "first": first,
              "recorded": recorded, "shortage": shortage, "calibration_mode": is_calibrating})
    else:
        notes = [*map(RIGHTS.format, refused(policies)), *([shortage] if shortage else []),
                 *([CALIBRATION_MODE] if is_calibrating else [])]
        _print(f"system {name}, clock {reported}", processes, found, notes)
        if recorded:
            tell(f"a recording of the time before it: {recorded}")
        tell(in_a_line(processes, found))
    return int(is_fault or any(process.problem or process.begins_again for process in processes))


def _print(title: str, processes: Sequence[ProcessStatus], found: Sequence[standing.Standing],
           notes: Sequence[str]) -> None:
    table(title, COLUMNS, [cells(process) for process in processes], RIGHT)
    said = [f"{process.name}: {text}" for process in processes if (text := remarks(process))]
    for text in (*said, *notes):
        tell(text)
    if said or notes:
        tell("")
    table("", standing.COLUMNS, [standing.cells(one) for one in found])


def _fault_recording(system: str, faults_ns: Iterable[int]) -> str:
    """The file of one of these faults, which began then (monotonic); empty: there is none, or none yet."""
    with suppress(SegmentError), closing(directory.reader(system, RECORDER, "state", RECORDER, often=False)) as state:
        if state.newest():
            first_ns, last_ns = (int(state.field(name)[()]) for name in ("fault_first_ns", "fault_last_ns"))
            if any(first_ns <= at_ns <= last_ns for at_ns in faults_ns if at_ns):
                return str(plain(state.field("fault_path").item()))
    return ""
