"""Snapshots of a host between two runs: loops and handles as objects, segments as bytes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

from trocar.procs.host.objects import RememberedObjects, UnknownTypeError
from trocar.shm.memory.segment import Segment, names_of, segment_name

PAGE: Final = 4096
ZEROS: Final = bytes(PAGE)


class HostMemory:
    """The attached segments of a host: all except the document, which no longer changes."""

    def __init__(self, system: str) -> None:
        """Attach to all segments; SegmentError if they are not in this process."""
        self.segments: list[Segment] = []
        self.names: set[str] = set()
        for _, instance, what in names_of(system):
            name = segment_name(system, instance, what)
            self.names.add(name)
            if what != "document":
                self.segments.append(Segment(name, write=True))

    def close(self) -> None:
        """Unmap."""
        for segment in self.segments:
            segment.close()


class HostSnapshot:
    """A snapshot from `Host.snapshot` for `Host.restore`; only for this host, and as long as it is open."""

    def __init__(self, memory: HostMemory, roots: Mapping[str, object], handles: Sequence[object]) -> None:
        """UnknownTypeError: an object in `roots` or `handles` cannot be restored, or belongs to another system."""
        self.memory, self.handles = memory, tuple(handles)
        """Clients and readers in the snapshot."""
        self._objects = RememberedObjects({**roots, "handles": self.handles})
        if others := sorted(self._objects.segments - memory.names):
            raise UnknownTypeError(f"{others[0]} is of another system, which is not taken back")
        self._bytes = [part for segment in memory.segments for part in _parts(segment.view)]
        self.put_back()  # so that sets and dicts are ordered now as after each restore

    def put_back(self) -> None:
        """Restore bytes and objects, as part of `Host.restore`."""
        for view, said in self._bytes:
            view[:] = said
        self._objects.put_back()


def _parts(view: memoryview) -> list[tuple[memoryview, bytes]]:
    """A segment's content in parts: those of zeros, the larger part of a mailbox, take no memory until read."""
    starts = range(0, len(view), PAGE)
    parts = []
    for is_zero, run in itertools.groupby(starts, lambda start: view[start : start + PAGE].tobytes() == ZEROS):
        pages = list(run)
        part = view[pages[0] : pages[-1] + PAGE]
        parts.append((part, bytes(len(part)) if is_zero else bytes(part)))
    return parts
