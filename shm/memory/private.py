"""Systems that only this process has: their segments have no names in /dev/shm, and are gone with the process.

Each segment is anonymous memory (memfd). Each attachment opens it again through /proc/self/fd, so that claims, which
are tied to the open file, work as they do between processes. A forked child has the segments that existed at the fork.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

OURS: Final = Path("/proc/self/fd")
_systems: dict[str, dict[str, int]] = {}


def keep(system: str) -> None:
    """From now on, until `forget`, segments of this system are ours alone; KeyError when they are already."""
    if system in _systems:
        raise KeyError(system)
    _systems[system] = {}


def forget(system: str) -> None:
    """Release all its memory; no effect if there is none."""
    for fd in _systems.pop(system, {}).values():
        os.close(fd)


def is_kept(system: str) -> bool:
    """Whether segments of this system are ours alone."""
    return system in _systems


def segments(system: str | None = None) -> list[str]:
    """Names of all segments of a private system, or of all of them."""
    kept = [_systems.get(system, {})] if system is not None else list(_systems.values())
    return [name for files in kept for name in files]


def path(name: str) -> Path | None:
    """Path for opening a segment; None: it is not private."""
    files = _files(name)
    return None if files is None or name not in files else OURS / str(files[name])


def belongs(name: str) -> bool:
    """Whether the segment of this name is, or would be, private."""
    return _files(name) is not None


def create(name: str) -> int:
    """An empty segment; returns its descriptor, owned by the caller. FileExistsError if it exists."""
    files = _files(name)
    if files is None:
        raise KeyError(name)
    if name in files:
        raise FileExistsError(name)
    files[name] = os.memfd_create(name[1:])
    return os.dup(files[name])


def unlink(name: str) -> None:
    """Remove the segment; processes that have it attached keep it. No effect if there is none."""
    files = _files(name) or {}
    if name in files:
        os.close(files.pop(name))


def _files(name: str) -> dict[str, int] | None:
    return _systems.get(name.split("~", 2)[1]) if _systems else None
