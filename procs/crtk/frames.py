"""In which frame a pose or a twist is told."""

from __future__ import annotations

from collections.abc import Callable

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.topics import TopicEntry
from trocar.shm.ring.ring import RingReader


def frame_name(entry: TopicEntry, ring: RingReader) -> Callable[[], str]:
    """The frame of a view on `ring`: always called the same, or as the record last read says. Empty: it has none."""
    what = entry.name.removeprefix(f"{entry.instance}/")
    base = "Cart" if entry.row >= 0 else f"{entry.instance}_base"
    fixed = base if "local/" in what or what.startswith("spatial/") else entry.instance if "body/" in what else ""
    if fixed or entry.kind not in ("cp", "cv") or "reference_frame" not in (ring.dtype.names or ()):
        return lambda: fixed
    cell = ring.field("reference_frame")
    cell = cell[entry.row : entry.row + 1].reshape(()) if entry.row >= 0 else cell
    return lambda: str(plain(cell.item()))
