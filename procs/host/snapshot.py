"""All of a host as it is between two runs: its loops and handles as objects, its segments as bytes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

from trocar.procs.host.objects import RememberedObjects, UnknownTypeError
from trocar.shm.memory.segment import Segment, names_of, segment_name

PAGE: Final = 4096
ZEROS: Final = bytes(PAGE)


class HostMemory:
    """The segments of a host, attached: all but the document, which nobody writes any more."""

    def __init__(self, system: str) -> None:
        """SegmentError: it is not kept by this process."""
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
    """What `Host.snapshot` gives and `Host.restore` takes; of this host alone, and good as long as that is open."""

    def __init__(self, memory: HostMemory, roots: Mapping[str, object], handles: Sequence[object]) -> None:
        """UnknownTypeError: something in `roots` or `handles` cannot be put back, or is of another system."""
        self.memory, self.handles = memory, tuple(handles)
        """Clients and readers that are part of it."""
        self._objects = RememberedObjects({**roots, "handles": self.handles})
        if others := sorted(self._objects.segments - memory.names):
            raise UnknownTypeError(f"{others[0]} is of another system, which is not taken back")
        self._bytes = [part for segment in memory.segments for part in _parts(segment.view)]
        self.put_back()  # sets and dicts, too, are now as they will be after each restore

    def put_back(self) -> None:
        """For the host."""
        for view, said in self._bytes:
            view[:] = said
        self._objects.put_back()


def _parts(view: memoryview) -> list[tuple[memoryview, bytes]]:
    """A segment and what it says, in parts: those of zeros, which are most of a mailbox, take no memory until read."""
    starts = range(0, len(view), PAGE)
    parts = []
    for is_zero, run in itertools.groupby(starts, lambda start: view[start : start + PAGE].tobytes() == ZEROS):
        pages = list(run)
        part = view[pages[0] : pages[-1] + PAGE]
        parts.append((part, bytes(len(part)) if is_zero else bytes(part)))
    return parts
