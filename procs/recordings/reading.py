"""Reading recordings, also those whose writer was killed: damage to a file is listed in `problems`, not raised.

    with open_recording(path) as recording:
        recording.is_whole, recording.problems, recording.metadata["trocar"]
        found = recording.records("PSM1/state")
        found.rows["position"], found.rows["sequence"], found.rows["stamp_ns"], found.local_ns, found.missing

The file is untrusted data: sizes and offsets are checked before use.
"""

from __future__ import annotations

import gzip
import json
import struct
import zlib
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, McapRecord, Metadata, Schema
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import RECORD, ChunkError, PackedChunk, messages, uncompressed
from trocar.procs.recordings.layout import layout_of
from trocar.procs.recordings.records import Piece, joined
from trocar.procs.recordings.records import RecordedTopic as RecordedTopic
from trocar.procs.recordings.records import Records as Records
from trocar.procs.recordings.writing import MAGIC
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.layout import LayoutError, schema_from_json, schema_of
from trocar.shm.topics import AUDIT, EVENTS, Topic

CHUNK: Final = struct.Struct("<QQQII")
INDEX_HEAD: Final = 6
MAX_RECORD: Final = 256 << 20
MAX_PROBLEMS: Final = 20
MAX_DOCUMENT: Final = 64 << 20
MAX_ROWS: Final = 2 << 30
"""Maximum bytes of records read at once: ten minutes of an arm at full rate."""
MAX_SAID: Final = 100_000
"""Maximum number of events or commands of one topic: the newest ones."""
SAID: Final = {"events": EVENTS, "audit": AUDIT}
ALL_STAMPS: Final = (-(1 << 62), 1 << 62)
READ: Final[dict[int, Callable[[ReadDataStream], McapRecord]]] = {
    Opcode.SCHEMA: Schema.read, Opcode.CHANNEL: Channel.read, Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read}


FoundMessage = tuple[int, int, int, int, memoryview]
"""Channel, sequence, time of day, stamp, data."""


class RecordingError(Exception):
    """A file is no recording; the message has its path and the reason."""


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """A chunk of a file: the times of day that it has, and where its data are."""

    begin_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    at: int
    length: int


class RecordingReader(Closable):
    """One file; a context manager. Chunks are read on demand."""

    def __init__(self, path: Path) -> None:
        """Open a file; RecordingError when it is no recording."""
        self.path = path
        self.problems: list[str] = []
        """Problems of the file, in words."""
        self.is_whole = False
        """Whether its writer ended it properly."""
        self.metadata: dict[str, dict[str, str]] = {}
        self.topics: dict[str, RecordedTopic] = {}
        self._attachments: dict[str, bytes] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self.chunks: list[ChunkPlace] = []
        try:
            self._file: BinaryIO = path.open("rb")
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from None
        try:
            self._look()
        except BaseException:
            self._file.close()
            raise

    # contents

    @property
    def begin_ns(self) -> int:
        """Time of day of its first message; 0 without messages."""
        return min((chunk.begin_ns for chunk in self.chunks), default=0)

    @property
    def end_ns(self) -> int:
        """Time of day of its last message."""
        return max((chunk.end_ns for chunk in self.chunks), default=0)

    @property
    def document(self) -> bytes:
        """The frozen configuration as JSON; empty if missing."""
        packed = self._attachments.get(names.DOCUMENT, b"")
        try:
            with gzip.GzipFile(fileobj=BytesIO(packed)) as file:
                return file.read(MAX_DOCUMENT) if packed else b""
        except (OSError, EOFError, ValueError, zlib.error) as error:
            self._wrong(f"its configuration cannot be read: {error}")
            return b""

    def attachment(self, name: str) -> bytes:
        """The attachment of this name; empty if missing."""
        return self._attachments.get(name, b"")

    def records(self, topic: str, begin_ns: int = 0, end_ns: int = 1 << 63, stamps: tuple[int, int] = ALL_STAMPS
                ) -> Records:
        """Records of a topic with a time of day from `begin_ns` to before `end_ns`; KeyError for no such topic.

        `stamps`: such a range in the system's time. At most MAX_ROWS bytes, else the first ones and a problem; `pieces`
        reads recordings of any length.
        """
        found, size = list[Records](), 0
        for _, piece in self.pieces([topic], begin_ns, end_ns, stamps):
            size += piece.rows.nbytes
            if size > MAX_ROWS:
                self._wrong(f"{topic}: it has more than {MAX_ROWS >> 20} MB of records; only the first ones are read")
                break
            found.append(piece)
        return joined(found, self.dtype(topic))

    def pieces(self, topics: Sequence[str], begin_ns: int = 0, end_ns: int = 1 << 63,
               stamps: tuple[int, int] = ALL_STAMPS) -> Iterator[tuple[str, Records]]:
        """Records of several topics in the order of the file: reads each chunk once, with only one in memory.

        Records may be out of order and repeated (see `joined`). Arguments and KeyError as for `records`.
        """
        rows = [(self.topics[name], self.dtype(name)) for name in topics]
        wanted = {channel: row for row in rows for channel in row[0].channels}
        for place in self.chunks:
            found: dict[str, Piece] = {}
            for channel, _, log_ns, _, data in self._in_chunk(place, wanted, begin_ns, end_ns):
                topic, dtype = wanted[channel]
                piece = found.get(topic.name) or found.setdefault(topic.name, Piece(topic, dtype))
                if not piece.add(channel, log_ns, data):
                    self._wrong(f"{topic.name}: a message of {len(data)} bytes is no record")
            for name, piece in found.items():
                records = piece.records(stamps)
                if len(records.rows):
                    yield name, records

    def dtype(self, topic: str) -> np.dtype[np.void]:
        """The dtype of a topic's records; KeyError when it has none."""
        dtype = self.topics[topic].dtype
        if dtype is None:
            raise KeyError(f"{topic} is a view; records have {', '.join(self.record_topics) or 'none'}")
        return dtype

    def attachments(self) -> list[tuple[str, str, bytes]]:
        """All attachments: name, media type and content."""
        return [(name, "application/octet-stream", data) for name, data in self._attachments.items()]

    def channel(self, number: int) -> tuple[str, str, dict[str, str]]:
        """Type, definition and metadata of a channel."""
        channel = self._channels[number]
        schema = self._schemas.get(channel.schema_id)
        return (schema.name, schema.data.decode(errors="replace"), channel.metadata) if schema else ("", "", {})

    def raw(self, topic: str) -> Iterator[FoundMessage]:
        """Every message of a topic in the order of the file: channel, sequence, time of day, stamp, data."""
        return self._messages(self.topics[topic].channels, 0, 1 << 63)

    def messages(self, topic: str, begin_ns: int = 0, end_ns: int = 1 << 63) -> Iterator[tuple[int, int, bytes]]:
        """Time of day, stamp and message (CDR) of a topic, for instance a view."""
        for _, _, log_ns, publish_ns, data in self._messages(self.topics[topic].channels, begin_ns, end_ns):
            yield log_ns, publish_ns, bytes(data)

    @property
    def record_topics(self) -> list[str]:
        """Topics that have records."""
        return [name for name, row in self.topics.items() if row.dtype is not None]

    def events(self) -> list[dict[str, Any]]:
        """Events of all instances in order of time, each with its `instance`."""
        return self._all("events")

    def commands(self) -> list[dict[str, Any]]:
        """Commands with their outcomes in order of time, each with its `instance`."""
        return self._all("audit")

    def _all(self, ring: str) -> list[dict[str, Any]]:
        found = []
        for name in self.record_topics:
            if self.topics[name].ring == ring and self._is_said(name, SAID[ring]):
                for row in self.records(name).rows[-MAX_SAID:]:
                    found.append({"instance": self.topics[name].instance}
                                 | {key: plain(row[key]) for key in row.dtype.names or ()})
        return sorted(found, key=lambda row: int(row["monotonic_ns"]))

    def _is_said(self, name: str, usual: Topic) -> bool:
        """Whether records have the usual fields of events or commands; otherwise a problem is noted."""
        known, found = schema_of(usual).dtype, self.dtype(name)
        wrong = [field for field in known.names or () if field not in (found.names or ()) or
                 (found[field].base.kind, found[field].shape) != (known[field].base.kind, known[field].shape)]
        if wrong:
            self._wrong(f"{name}: left out: its layout differs from that of {usual.name} ({', '.join(wrong[:3])})")
        return not wrong

    # reading

    def _wrong(self, text: str) -> None:
        if len(self.problems) < MAX_PROBLEMS and text not in self.problems:
            self.problems.append(text)

    def _look(self) -> None:
        """Scan the file once, without uncompressing chunks."""
        size = self.path.stat().st_size
        if self._file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{self.path}: is no MCAP file")
        at = len(MAGIC)
        while at + RECORD.size <= size:
            self._file.seek(at)
            opcode, length = RECORD.unpack(self._file.read(RECORD.size))
            at += RECORD.size
            if opcode == Opcode.DATA_END:
                self.is_whole = True
                return
            if length > min(size - at, MAX_RECORD):
                self._wrong(f"it ends within a record, at byte {size} of {at + length}" if length <= MAX_RECORD
                            else f"a record of {length} bytes at byte {at}; allowed are {MAX_RECORD}")
                return
            if opcode == Opcode.CHUNK:
                self._look_at_chunk(at, length)
            elif opcode in READ:
                self._take(opcode, self._file.read(length))
            at += length
        self._wrong("its writer did not close it: the last messages may be missing")

    def _look_at_chunk(self, at: int, length: int) -> None:
        if length < CHUNK.size:
            self._wrong(f"a chunk of {length} bytes at byte {at}")
            return
        begin, end, size, crc, letters = CHUNK.unpack(self._file.read(CHUNK.size))
        skipped = CHUNK.size + letters + 8
        if letters > 16 or skipped > length:
            self._wrong(f"a chunk at byte {at} has no readable head")
            return
        compression = self._file.read(letters).decode(errors="replace")
        self.chunks.append(ChunkPlace(begin, end, size, crc, compression, at + skipped, length - skipped))

    def _take(self, opcode: int, data: bytes) -> None:
        try:
            found = READ[opcode](ReadDataStream(BytesIO(data)))
        except (McapError, ValueError, EOFError, OverflowError, struct.error) as error:  # sizes of 2^63 and more
            self._wrong(f"a record cannot be read: {type(error).__name__} {error}".strip())
            return
        if isinstance(found, Schema):
            self._schemas[found.id] = found
        elif isinstance(found, Channel):
            self._channels[found.id] = found
            self._add(found)
        elif isinstance(found, Metadata):
            self.metadata[found.name] = found.metadata
        elif isinstance(found, Attachment):
            self._attachments[found.name] = found.data

    def _add(self, channel: Channel) -> None:
        """Add a channel as a new topic, or as another epoch of a topic."""
        meta, schema = channel.metadata, self._schemas.get(channel.schema_id)
        name = meta.get(names.TOPIC, channel.topic.removeprefix("/"))
        try:
            epoch = int(meta.get(names.EPOCH, "0"))
            if not 0 <= epoch < 1 << 63:
                raise ValueError(f"epoch {epoch}; allowed are 0 to 2^63 - 1")
            if name not in self.topics:
                self.topics[name] = self._topic(name, meta, schema.name if schema else "")
            elif meta.get(names.SCHEMA, "") != self.topics[name].schema:
                raise ValueError("it has two layouts")
        except (LayoutError, ValueError) as error:
            self._wrong(f"{name}: {error}")
            return
        self.topics[name].channels[channel.id] = epoch

    def _topic(self, name: str, meta: dict[str, str], type_name: str) -> RecordedTopic:
        text = meta.get(names.SCHEMA, "")
        where = (meta.get(names.INSTANCE, ""), meta.get(names.RING, ""), meta.get(names.KIND, ""))
        if not text:
            return RecordedTopic(name, type_name, *where)
        schema = schema_from_json(text.encode())
        layout = layout_of(where[2], schema)
        if layout.type_name != type_name:
            raise ValueError("its schema is not the one it was recorded with")
        return RecordedTopic(name, type_name, *where, schema.dtype, text, size=layout.size,
                             info=_info(meta.get(names.INFO, "")))

    def _messages(self, channels: Container[int], begin_ns: int, end_ns: int) -> Iterator[FoundMessage]:
        for place in self.chunks:
            yield from self._in_chunk(place, channels, begin_ns, end_ns)

    def _in_chunk(self, place: ChunkPlace, channels: Container[int], begin_ns: int, end_ns: int
                  ) -> Iterator[FoundMessage]:
        if place.end_ns < begin_ns or place.begin_ns >= end_ns:
            return
        try:
            for found in messages(self.plain(place)):
                if found[0] in channels and begin_ns <= found[2] < end_ns:
                    yield found
        except ChunkError as error:
            self._wrong(f"byte {place.at}: {error}")

    def plain(self, place: ChunkPlace) -> bytes:
        """A chunk, uncompressed; ChunkError if it is damaged."""
        self._file.seek(place.at)
        return uncompressed(self._file.read(place.length), place.compression, place.size, place.crc)

    def index(self, place: ChunkPlace) -> dict[int, NDArray[np.int64]] | None:
        """Time of day and offset (n, 2) of the messages of a chunk by channel; None if the file has not all of them."""
        found: dict[int, NDArray[np.int64]] = {}
        self._file.seek(place.at + place.length)
        while len(head := self._file.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            if opcode != Opcode.MESSAGE_INDEX:
                return found or None
            body = self._file.read(length) if INDEX_HEAD <= length <= MAX_RECORD else b""
            if len(body) < length or (length - INDEX_HEAD) % 16:
                return None
            found[int.from_bytes(body[:2], "little")] = np.frombuffer(body, np.int64, -1, INDEX_HEAD).reshape(-1, 2)
        return None

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _info(text: str) -> dict[str, Any]:
    """A ring's info; empty if it is not valid."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def open_recording(path: Path | str) -> RecordingReader:
    """Open a recording; RecordingError when the file is none, `problems` if it is damaged."""
    return RecordingReader(Path(path))


def chunks_of(path: Path, begin_ns: int) -> Iterator[PackedChunk]:
    """Chunks that end at `begin_ns` or later, from a file that this process has written, and that may still grow.

    They can be copied unchanged into another recording, because both use the same table of channels.
    """
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        head, chunk, indexes = file.read(RECORD.size), b"", list[tuple[int, bytes, int]]()
        while len(head) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            body = file.read(length) if length <= MAX_RECORD else b""
            if len(body) < length:
                break
            if opcode == Opcode.MESSAGE_INDEX and chunk:
                indexes.append((int.from_bytes(body[:2], "little"), head + body, (length - INDEX_HEAD) // 16))
            elif chunk:
                yield from _chunk(chunk, indexes, begin_ns)
                chunk, indexes = b"", []
            if opcode == Opcode.CHUNK:
                chunk = head + body
            head = file.read(RECORD.size)
        if chunk:
            yield from _chunk(chunk, indexes, begin_ns)


def _chunk(record: bytes, indexes: list[tuple[int, bytes, int]], begin_ns: int) -> Iterator[PackedChunk]:
    begin, end, size, _, letters = CHUNK.unpack_from(record, RECORD.size)
    at = RECORD.size + CHUNK.size
    if end >= begin_ns:
        yield PackedChunk(record, tuple(indexes), begin, end, sum(count for _, _, count in indexes),
                          record[at : at + letters].decode(), len(record) - at - letters - 8, size)
