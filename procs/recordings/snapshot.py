"""The contents of all rings of a system as one recording: of a dead system, or after an incident.

Rings are only read, so writers that still run are not affected. The longest gapless sequence of whole records up to
the newest is taken from each ring; the oldest may be missing if they are overwritten meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import ZSTD, Chunk, packed
from trocar.procs.recordings.facts import local_offset_ns
from trocar.procs.recordings.layout import ENCAPSULATION, RecordLayout
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import LAST_STAMP, RingReader
from trocar.shm.system import directory

CHUNK_BYTES = 1 << 20
ALL = 1 << 40

Attachments = Sequence[tuple[str, str, bytes]]


@dataclass(frozen=True, slots=True)
class KeptRing:
    """The contents of one ring: records, oldest first, with its depth and the epoch of its writer."""

    instance: str
    ring: str
    schema: Schema
    info: Mapping[str, Any]
    epoch: int
    depth: int
    rows: NDArray[Any]

    @property
    def kind(self) -> str:
        """The kind of its writer, from the header."""
        return str(self.info.get("kind", ""))


@dataclass(slots=True)
class Snapshot:
    """The result: numbers of records by topic, and problems in words."""

    records: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    bytes: int = 0


def kept_ring(system: str, instance: str, ring: str) -> KeptRing:
    """All whole records of one ring; SegmentError when it cannot be read."""
    segment = Segment(segment_name(system, instance, ring))
    try:
        reader = RingReader(segment, often=False)
        rows = reader.last(ALL)
        return KeptRing(instance, ring, segment.header.schema, dict(reader.info), reader.epoch, reader.depth, rows)
    finally:
        segment.close()


def take(system: str, stream: BinaryIO, facts: Mapping[str, Mapping[str, str]], attachments: Attachments,
         say: Callable[[float], None] = lambda fraction: None) -> Snapshot:
    """Write all rings of a system into a seekable `stream`, in the order of stamps; OSError when writing fails.

    `say` is called with the fraction done, 0 to 1. Rings that cannot be read are left out, and are problems of the
    snapshot.
    """
    snapshot, rings, table, channels = Snapshot(), list[KeptRing](), ChannelTable(), list[tuple[int, RecordLayout]]()
    for instance, ring in directory.rings(system):
        try:
            each = kept_ring(system, instance, ring)
            channels.append(table.ring(instance, ring, each.kind, each.schema, each.epoch, each.info))
            rings.append(each)
        except Exception as error:  # a header may say anything
            snapshot.problems.append(f"{instance}/{ring} cannot be read: {error or type(error).__name__}")
    snapshot.records = {f"{each.instance}/{each.ring}": len(each.rows) for each in rings}
    file = RecordingFile(stream, table, facts, attachments)
    _write(file, rings, channels, local_offset_ns(system), say)
    file.note(names.LOSSES, {})
    file.finish()
    snapshot.bytes = file.size
    return snapshot


def _write(file: RecordingFile, rings: Sequence[KeptRing], channels: Sequence[tuple[int, RecordLayout]],
           offset_ns: int, say: Callable[[float], None]) -> None:
    """Write the records of all rings, oldest first."""
    counts = [len(each.rows) for each in rings]
    total = sum(counts)
    stamps = np.concatenate([each.rows["stamp_ns"].astype(np.int64) for each in rings] or [np.zeros(0, np.int64)])
    which = np.repeat(np.arange(len(rings)), counts)
    place = np.concatenate([np.arange(n) for n in counts]) if counts else which
    raw = [each.rows.view(np.uint8).reshape(-1).data for each in rings]
    sizes = [each.rows.dtype.itemsize for each in rings]
    numbers = [each.rows["sequence"] for each in rings]
    chunk = Chunk()
    for done, index in enumerate(np.argsort(stamps, kind="stable")):
        ring, row = int(which[index]), int(place[index])
        (channel, layout), at = channels[ring], row * sizes[ring]
        stamp = min(max(int(stamps[index]), 0), LAST_STAMP)
        chunk.add(channel, int(numbers[ring][row]), max(stamp + offset_ns, 0), stamp, ENCAPSULATION,
                  raw[ring][at : at + layout.size])
        if len(chunk.data) >= CHUNK_BYTES:
            file.put(packed(chunk, ZSTD))
            chunk = Chunk()
            say(done / total)
    if chunk.count:
        file.put(packed(chunk, ZSTD))
