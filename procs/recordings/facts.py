"""What a recording says about itself: of which system it is, by which versions, on which machine. No secrets."""

from __future__ import annotations

import gzip
import platform
from collections.abc import Mapping
from typing import Final

import numpy as np

from procs.recordings import names
from procs.version import VERSION
from shm import directory
from shm.clock import local_ns, monotonic_ns
from shm.lockstep import SCHEMA as PAGE
from shm.lockstep import clock_page
from shm.segment import SegmentError
from shm.system_time import SystemTime

JSON_GZIP: Final = "application/gzip"


def facts_of(system: str, kind: str, name: str = "", reason: str = "", **more: str) -> dict[str, Mapping[str, str]]:
    """Metadata of a recording of this `kind` (procs/recordings/names.py), made now; its `clock` may be unknown, ""."""
    try:
        with SystemTime(system) as time:
            clock = time.clock
    except SegmentError:
        clock = ""
    return {names.SYSTEM: {
        "format": names.FORMAT, "kind": kind, "name": name, "reason": reason, "system": system, "clock": clock, **more,
        "trocar": VERSION, "python": platform.python_version(), "numpy": np.__version__, "kernel": platform.release(),
        "machine": platform.machine(), "host": platform.node()}}


def document_of(system: str) -> list[tuple[str, str, bytes]]:
    """The frozen configuration as an attachment; none where it cannot be read."""
    try:
        return [(names.DOCUMENT, JSON_GZIP, gzip.compress(directory.document(system), mtime=0))]
    except (SegmentError, ValueError):
        return []


def local_offset_ns(system: str) -> int:
    """What is added to a stamp of this system to get the time of day, ns; also of one that is dead."""
    try:
        page = clock_page(system)
    except SegmentError:
        return local_ns() - monotonic_ns()
    try:
        first, words = page.header.first, page.words()
        now, local = (int(words[(first + PAGE.offset(field)) // 8]) for field in ("now_ns", "local_ns"))
    finally:
        page.close()
    return local - now
