"""Writing a recording: an MCAP file that is readable up to its last chunk, even if its writer is killed.

Schemas and channels precede the first chunk that needs them; each chunk is followed by its indexes, and the file ends
with a summary. A killed writer leaves no summary, which sequential readers do not need.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO, Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import PackedChunk
from trocar.procs.recordings.layout import RecordLayout, layout_of
from trocar.shm.memory.layout import Schema as RingSchema

MAGIC: Final = bytes((137, 77, 67, 65, 80, 48, 13, 10))
PROFILE: Final = "ros2"
LIBRARY: Final = "trocar"
CDR: Final = "cdr"
ROS2: Final = "ros2msg"


def as_bytes(*records: McapRecord) -> bytes:
    """MCAP records as bytes."""
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    written: bytes = builder.end()
    return written


class ChannelTable:
    """Schemas and channels for all files of one process, with the same numbers in each, so that chunks can be copied.
    """

    def __init__(self) -> None:
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self._known: dict[str, int] = {}
        self._numbers: dict[tuple[str, ...], int] = {}

    def channel(self, topic: str, type_name: str, definition: str, metadata: Mapping[str, str]) -> int:
        """The number of a channel, new or existing; schemas of the same name are shared."""
        same = topic, type_name, *(word for pair in sorted(metadata.items()) for word in pair)
        if same in self._numbers:
            return self._numbers[same]
        if type_name not in self._known:
            self._known[type_name] = len(self.schemas) + 1
            self.schemas.append(Schema(self._known[type_name], definition.encode(), ROS2, type_name))
        number = self._numbers[same] = len(self.channels) + 1
        self.channels.append(Channel(number, names.channel_name(topic), CDR, {names.TOPIC: topic, **metadata},
                                     self._known[type_name]))
        return number

    def ring(self, instance: str, ring: str, kind: str, schema: RingSchema, epoch: int,
             info: Mapping[str, Any] | None = None) -> tuple[int, RecordLayout]:
        """A channel for the records of one writer of a ring, and their layout in messages."""
        layout = layout_of(kind, schema)
        known = {names.INSTANCE: instance, names.RING: ring, names.KIND: kind, names.EPOCH: str(epoch),
                 names.SCHEMA: schema.text.decode(), names.FINGERPRINT: f"{schema.fingerprint:016x}",
                 names.INFO: json.dumps(info or {})}
        return self.channel(f"{instance}/{ring}", layout.type_name, layout.definition, known), layout


class RecordingFile:
    """One file. A partial write is cut off again, so that the file stays readable, and raises OSError."""

    def __init__(self, stream: BinaryIO, table: ChannelTable, metadata: Mapping[str, Mapping[str, str]],
                 attachments: Sequence[tuple[str, str, bytes]] = (), created_ns: int = 0) -> None:
        """Begin a file; `stream` is seekable. `metadata`: name and values; `attachments`: name, media type, content."""
        self._stream, self._table = stream, table
        self._schemas = self._channels = self.size = self.messages = 0
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._indexes: list[McapRecord] = []
        self._write(MAGIC + as_bytes(Header(PROFILE, LIBRARY)))
        for name, values in metadata.items():
            self.note(name, values)
        for name, media, content in attachments:
            record = as_bytes(Attachment(created_ns, created_ns, name, media, content))
            self._indexes.append(AttachmentIndex(self.size, len(record), created_ns, created_ns, len(content), name,
                                                 media))
            self._write(record)
        self._meet()

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write metadata; of several with the same name, the last is valid."""
        record = as_bytes(Metadata(name, dict(values)))
        index = MetadataIndex(self.size, len(record), name)
        self._write(record)
        self._indexes.append(index)

    def put(self, chunk: PackedChunk) -> None:
        """Write a chunk, preceded by new channels."""
        self._meet()
        start = self.size + len(chunk.record)
        offsets, at = {}, start
        for channel, record, _ in chunk.indexes:
            offsets[channel] = at
            at += len(record)
        index = ChunkIndex(len(chunk.record), self.size, chunk.compression, chunk.compressed, chunk.end_ns, at - start,
                           offsets, chunk.begin_ns, chunk.uncompressed)
        self._write(b"".join((chunk.record, *(record for _, record, _ in chunk.indexes))))
        self._chunks.append(index)
        self.messages += chunk.count
        for channel, _, count in chunk.indexes:
            self._counts[channel] = self._counts.get(channel, 0) + count

    def _meet(self) -> None:
        """Write schemas and channels that are not in the file yet."""
        table = self._table
        if self._schemas < len(table.schemas) or self._channels < len(table.channels):
            schemas, channels = len(table.schemas), len(table.channels)
            self._write(as_bytes(*table.schemas[self._schemas : schemas], *table.channels[self._channels : channels]))
            self._schemas, self._channels = schemas, channels

    def _write(self, data: bytes) -> None:
        """Write all of the data, or nothing."""
        try:
            self._stream.seek(self.size)
            left = memoryview(data)
            while left:  # an unbuffered file may write only a part
                left = left[self._stream.write(left) :]
            self._stream.flush()
        except OSError:
            self._stream.truncate(self.size)
            raise
        self.size += len(data)

    @property
    def end_ns(self) -> int:
        """Time of its last message; 0 without messages."""
        return max((chunk.message_end_time for chunk in self._chunks), default=0)

    def finish(self) -> None:
        """Write the summary, an index for tools; the stream stays open. Without room there is no summary."""
        data_end = as_bytes(DataEnd(0))
        start = self.size + len(data_end)
        statistics = Statistics(
            sum(isinstance(record, AttachmentIndex) for record in self._indexes), self._channels, self._counts,
            len(self._chunks), self.messages, self.end_ns,
            min((chunk.message_start_time for chunk in self._chunks), default=0),
            sum(isinstance(record, MetadataIndex) for record in self._indexes), self._schemas)
        groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._table.schemas[: self._schemas]),
            (Opcode.CHANNEL, self._table.channels[: self._channels]), (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, [row for row in self._indexes if isinstance(row, AttachmentIndex)]),
            (Opcode.METADATA_INDEX, [row for row in self._indexes if isinstance(row, MetadataIndex)]))
        summary, offsets = b"", []
        for opcode, records in groups:
            if records:
                part = as_bytes(*records)
                offsets.append(SummaryOffset(opcode, start + len(summary), len(part)))
                summary += part
        offsets_at = start + len(summary)
        summary += as_bytes(*offsets)
        footer = as_bytes(Footer(start, offsets_at, 0))
        crc = zlib.crc32(footer[:-4], zlib.crc32(summary))
        self._write(data_end + summary + footer[:-4] + crc.to_bytes(4, "little") + MAGIC)
