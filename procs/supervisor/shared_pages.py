"""Memory that the processes of a system share, locked once for all: code of libraries, and all segments.

A page locked by one process stays resident for all that map it, so it suffices that the supervisor, which outlives
all others, locks them. A page that must be read from disk would stop a loop for milliseconds, and just in rarely used
code: the reaction to a fault.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from trocar.procs.node.realtime import LOCKED, NOT_LOCKED, regions
from trocar.shm.memory.segment import names_of, path_of, segment_name

MAP_LOCKED: Final = 0x2000
FAILED: Final = ctypes.c_void_p(-1).value


def lock_shared(system: str, pids: Iterable[int], beat: Callable[[], object]) -> str:
    """Lock all segments of a system, and the code that these processes have mapped, until we end.

    `beat` is called before each file. Returns the result in words.
    """
    wanted: dict[Path, int] = {}
    for pid in pids:
        for file, end in _code(pid).items():
            wanted[file] = max(end, wanted.get(file, 0))
    for path in (path_of(segment_name(*parts)) for parts in names_of(system)):
        with contextlib.suppress(OSError):
            wanted[path] = path.stat().st_size
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long)
    refused = []
    for file, size in wanted.items():
        beat()
        if size and not _locked(libc, file, size):
            refused.append(file)
    return NOT_LOCKED if refused else LOCKED


def _code(pid: int) -> dict[Path, int]:
    """Code files that a process has mapped, with the end of the mapping; empty if it has ended or is not readable."""
    try:
        found = [region for region in regions(pid) if region.file.startswith("/")]
    except OSError:
        return {}
    code = {region.file for region in found if "x" in region.rights}
    return {Path(file): max(region.offset + region.size for region in found if region.file == file) for file in code}


def _locked(libc: ctypes.CDLL, file: Path, size: int) -> bool:
    try:
        with file.open("rb") as opened:
            place = libc.mmap(None, size, mmap.PROT_READ, mmap.MAP_SHARED | MAP_LOCKED, opened.fileno(), 0)
    except OSError:  # replaced or removed since it was mapped
        return True
    return bool(place != FAILED)
