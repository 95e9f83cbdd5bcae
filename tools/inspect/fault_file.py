"""Where the recorder has put what led to a fault."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing

from trocar.procs.document.recorder import NAME
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.tools.output.printing import plain


def fault_recording(system: str, faults_ns: Iterable[int]) -> str:
    """The file of one of these faults, which began then (monotonic); empty: there is none, or none yet."""
    try:
        with closing(directory.reader(system, NAME, "state", NAME, often=False)) as state:
            if not state.newest():
                return ""
            first_ns, last_ns = (int(state.field(name)[()]) for name in ("fault_first_ns", "fault_last_ns"))
            path = str(plain(state.field("fault_path").item()))
    except SegmentError:
        return ""
    return path if any(first_ns <= at_ns <= last_ns for at_ns in faults_ns if at_ns) else ""
