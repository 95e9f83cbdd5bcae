"""All of a host as it is between two runs: its loops and handles as objects, its segments as bytes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from procs.host.objects import RememberedObjects
from shm.segment import Segment, names_of, segment_name


class HostMemory:
    """The segments of a host, attached: all but the document, which nobody writes any more."""

    def __init__(self, system: str) -> None:
        """SegmentError: it is not kept by this process."""
        self.segments: list[Segment] = []
        for _, instance, what in names_of(system):
            if what != "document":
                self.segments.append(Segment(segment_name(system, instance, what), write=True))

    def close(self) -> None:
        """Unmap."""
        for segment in self.segments:
            segment.close()


class HostSnapshot:
    """What `Host.snapshot` gives and `Host.restore` takes; of this host alone, and good as long as that is open."""

    def __init__(self, memory: HostMemory, roots: Mapping[str, object], handles: Sequence[object]) -> None:
        """UnknownTypeError: something in `roots` or `handles` cannot be put back."""
        self.memory, self.handles = memory, tuple(handles)
        """Clients and readers that are part of it."""
        self._objects = RememberedObjects({**roots, "handles": self.handles})
        self._bytes = [(segment.view, bytes(segment.view)) for segment in memory.segments]
        self.put_back()  # sets and dicts, too, are now as they will be after each restore

    def put_back(self) -> None:
        """For the host."""
        for view, said in self._bytes:
            view[:] = said
        self._objects.put_back()
