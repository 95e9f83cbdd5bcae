"""Where the recorder has put what it kept of the last fault."""

from __future__ import annotations

from contextlib import closing

from procs.document.recorder import NAME
from shm import directory
from shm.ring import RingReader
from shm.segment import SegmentError
from tools.printing import plain


def fault_recording(system: str) -> str:
    """The file of the last fault; empty: there is none, or no recorder."""
    try:
        with closing(directory.reader(system, NAME, "state", often=False)) as state:
            return fault_path(state)
    except SegmentError:
        return ""


def fault_path(state: RingReader) -> str:
    """The same of the recorder's state."""
    return str(plain(state.field("fault_path").item())) if state.newest() else ""
