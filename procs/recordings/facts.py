"""Metadata of a recording: its system, versions of software, and machine. No secrets."""

from __future__ import annotations

import gzip
import platform
from collections.abc import Mapping
from typing import Final

import numpy as np

from trocar.procs.machine.version import VERSION
from trocar.procs.recordings import names
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.time.lockstep import SCHEMA as PAGE
from trocar.shm.time.lockstep import clock_page
from trocar.shm.time.system_time import SystemTime

JSON_GZIP: Final = "application/gzip"


def facts_of(system: str, kind: str, name: str = "", reason: str = "", **more: str) -> dict[str, Mapping[str, str]]:
    """Metadata of a recording of this `kind` (procs/recordings/names.py) that begins now; `clock` "" if unknown."""
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
    """The frozen configuration as an attachment; empty if it cannot be read."""
    try:
        return [(names.DOCUMENT, JSON_GZIP, gzip.compress(directory.document(system), mtime=0))]
    except (SegmentError, ValueError):
        return []


def local_offset_ns(system: str) -> int:
    """Offset from stamps of this system to the time of day, ns; also for a dead system."""
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
