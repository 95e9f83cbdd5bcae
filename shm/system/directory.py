"""The directory: which systems are up, their content, and how a name becomes an attached ring. The frozen document of a
system is in a segment of its own, written once by the supervisor before anything starts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from trocar.shm.memory.layout import LayoutError, Schema, schema_from_json, schema_of
from trocar.shm.memory.parts import LIST, parts_of
from trocar.shm.memory.segment import Make, Segment, SegmentError, create, names_of, segment_name
from trocar.shm.ring.ring import HEAD, RingReader, RingWriter, attach
from trocar.shm.topics import TOPICS, Topic

RING = "ring"
HISTORY_S: Final = 1.87
"""Time that rings of periodic records keep: 1.5 s before a fault, the 0.3 s after which its recording begins, and
0.07 s for two periods of the recorder and the copies (of the 21 rings of a full robot in 0.02 s of CPU time)."""
KINEMATIC_HISTORY_S: Final = 0.7
"""The same in a system without boards, where a robot cannot be damaged and a container is the usual place."""
MIN_HISTORY_S: Final = 0.2
"""Below it a system does not start: readers of all records, which look every 20 to 100 ms, would lose some."""
MIN_SLOTS: Final = 256
"""For rings that commands make their instances write more often than at their rate."""


def topic_of(kind: str, name: str) -> Topic:
    """The row of the topic table that instances of `kind` write under `name`; KeyError when there is none."""
    for topic in TOPICS:
        if topic.name == name and topic.writer in (kind, "*"):
            return topic
    raise KeyError(f"{kind} writes no topic {name}")


def systems() -> list[str]:
    """Names of all systems with a document in shared memory, up or left over."""
    return sorted({s for s, instance, what in names_of() if (instance, what) == ("supervisor", "document")})


def instances(system: str) -> list[str]:
    """Instances with a control page, the supervisor first."""
    names = [i for _, i, what in parts_of(system) if what == "control"]
    return sorted(names, key=lambda n: (n != "supervisor", n))


def rings(system: str) -> list[tuple[str, str]]:
    """All rings of a system as (instance, topic)."""
    plain = {"control", "mailbox", "clock", "document", "faults"}
    return [(i, what) for _, i, what in parts_of(system) if what not in plain]


def create_ring(
    system: str, instance: str, topic: Topic, dims: Mapping[str, int], info: Mapping[str, Any], make: Make = create,
    history_s: float = HISTORY_S,
) -> int:
    """Make the ring of an instance's topic; returns its size. `dims` fill the named sizes of the row."""
    schema = schema_of(topic, dims)
    meta = {"dims": dict(dims), "rate_hz": topic.rate_hz, **info}
    depth = topic.depth or max(MIN_SLOTS, round(history_s * meta["rate_hz"]))
    return make(segment_name(system, instance, topic.name), RING, schema, depth, meta)


def reader(system: str, instance: str, topic: str, kind: str | None = None, *, often: bool = True) -> RingReader:
    """Attach to a ring; with `kind`, refuse a schema that differs from our table's. `often`: see RingReader.

    Rings of events are not prepared for fast reads: those have something to read only now and then.
    """
    segment = Segment(segment_name(system, instance, topic))
    try:
        return RingReader(segment, _expected(segment, kind, topic), often=often and _is_periodic(segment))
    except BaseException:
        segment.close()
        raise


def writer(system: str, instance: str, topic: str, kind: str | None) -> RingWriter:
    """Claim a ring; SegmentError names its holder. Without `kind` its layout is read from its header."""
    segment = Segment(segment_name(system, instance, topic), write=True)
    try:
        return RingWriter(segment, instance, _expected(segment, kind, topic), often=_is_periodic(segment))
    except BaseException:
        segment.close()
        raise


def _is_periodic(segment: Segment) -> bool:
    return bool(segment.header.info.get("rate_hz"))


def _expected(segment: Segment, kind: str | None, topic: str) -> Schema | None:
    if kind is None:
        return None
    dims = segment.header.info.get("dims", {})
    try:
        return schema_of(topic_of(kind, topic), dims)
    except (LayoutError, TypeError, ValueError, OverflowError) as error:  # its header may have any content
        raise SegmentError(f"{segment.name}: its sizes {str(dims)[:64]!r} are not readable: {error}") from None


def create_document(system: str, length: int, make: Make = create, segments: Iterable[str] = ()) -> int:
    """Make the segment for a document of `length` bytes, empty as yet; returns its size. `segments`: all others."""
    name = segment_name(system, "supervisor", "document")
    try:
        schema = _document_schema(length)
    except LayoutError as error:
        raise SegmentError(f"{name}: {error}") from None
    return make(name, "document", schema, 1, {LIST: [each.split("~", 2)[2] for each in segments]})


def publish_document(system: str, text: bytes, make: Make = create, segments: Iterable[str] = ()) -> int:
    """Make the document segment and fill it; returns its size."""
    size = create_document(system, len(text), make, segments)
    with Segment(segment_name(system, "supervisor", "document"), write=True) as segment:
        start = segment.header.first + 16
        segment.view[start : start + len(text)] = text
        segment.words()[HEAD] = 1  # the head: the text is whole
    return size


def document(system: str) -> bytes:
    """The document of a system as JSON; SegmentError if there is none or it is not complete yet."""
    with Segment(segment_name(system, "supervisor", "document")) as segment:
        attach(segment, "document", None)
        length = segment.header.schema.dtype.itemsize - 16
        if segment.words()[HEAD] != 1:
            raise SegmentError(f"{segment.name}: is still being written")
        start = segment.header.first + 16
        return segment.view[start : start + length].tobytes().rstrip(b"\0")


def _document_schema(length: int) -> Schema:
    text = b'{"topic":"document","fields":[{"name":"text","dtype":"(%d,)u1"}]}' % length
    return schema_from_json(text)
