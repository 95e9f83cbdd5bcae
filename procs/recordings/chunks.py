"""Chunks of messages, which are compressed and written as a whole, and checked when read."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import lz4.frame
import zstandard
from mcap.opcode import Opcode

MESSAGE: Final = struct.Struct("<BQHIQQ")
RECORD: Final = struct.Struct("<BQ")
BODY: Final = struct.Struct("<HIQQ")
NONE, LZ4, ZSTD = "", "lz4", "zstd"
LEVEL: Final = 1  # of zstd
COMPRESSIONS: Final = {"none": NONE, "lz4": LZ4, "zstd": ZSTD}
MAX_CHUNK: Final = 256 << 20
"""Maximum size of a chunk to read; ours have one or two million bytes."""
SEQUENCES: Final = 0xFFFFFFFF


class ChunkError(Exception):
    """A chunk cannot be read; the message is the reason."""


@dataclass(slots=True)
class Chunk:
    """Messages in the order of arrival."""

    data: bytearray = field(default_factory=bytearray)
    index: dict[int, list[int]] = field(default_factory=dict)
    """By channel: time and offset of each message, alternating."""
    begin_ns: int = (1 << 64) - 1
    end_ns: int = 0
    count: int = 0

    def add(self, channel: int, sequence: int, log_ns: int, publish_ns: int, *parts: bytes | memoryview) -> None:
        """Add a message; the lower 32 bits of `sequence` are kept, times are not negative."""
        data = self.data
        self.index.setdefault(channel, []).extend((log_ns, len(data)))
        data += MESSAGE.pack(Opcode.MESSAGE, BODY.size + sum(map(len, parts)), channel, sequence & SEQUENCES, log_ns,
                             publish_ns)
        for part in parts:
            data += part
        self.count += 1
        if log_ns < self.begin_ns:
            self.begin_ns = log_ns
        if log_ns > self.end_ns:
            self.end_ns = log_ns


@dataclass(frozen=True, slots=True)
class PackedChunk:
    """A compressed chunk with its index records, in the form in which it is written, and can be copied."""

    record: bytes
    indexes: tuple[tuple[int, bytes, int], ...]
    """Channel, index record, and its number of messages."""
    begin_ns: int
    end_ns: int
    count: int
    compression: str
    compressed: int
    uncompressed: int

    @property
    def size(self) -> int:
        """Size in a file in bytes."""
        return len(self.record) + sum(len(record) for _, record, _ in self.indexes)


def packed(chunk: Chunk, compression: str) -> PackedChunk:
    """Compress a chunk; takes a few ms, in which other threads run."""
    plain = bytes(chunk.data)
    data = compressed(plain, compression)
    name = compression.encode()
    head = struct.pack(f"<QQQII{len(name)}sQ", chunk.begin_ns, chunk.end_ns, len(plain), zlib.crc32(plain), len(name),
                       name, len(data))
    record = RECORD.pack(Opcode.CHUNK, len(head) + len(data)) + head + data
    indexes = []
    for channel, words in chunk.index.items():
        body = struct.pack(f"<HI{len(words)}Q", channel, 8 * len(words), *words)
        indexes.append((channel, RECORD.pack(Opcode.MESSAGE_INDEX, len(body)) + body, len(words) // 2))
    return PackedChunk(record, tuple(indexes), chunk.begin_ns, chunk.end_ns, chunk.count, compression, len(data),
                       len(plain))


def compressed(data: bytes, compression: str) -> bytes:
    """Compress data as in MCAP files; KeyError for an unknown compression."""
    if compression == ZSTD:
        packed_data: bytes = zstandard.ZstdCompressor(level=LEVEL).compress(data)
        return packed_data
    if compression == LZ4:
        return bytes(lz4.frame.compress(data))
    return {NONE: data}[compression]


def uncompressed(data: bytes, compression: str, size: int, crc: int) -> bytes:
    """Uncompress data of `size` bytes with this checksum (0: none); ChunkError has the reason of a failure."""
    if size > MAX_CHUNK:
        raise ChunkError(f"a chunk says that it has {size} bytes; allowed are {MAX_CHUNK}")
    found: bytes
    try:
        if compression == ZSTD:
            if zstandard.frame_content_size(data) > size:
                raise ChunkError("a chunk is larger than it says")
            found = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        elif compression == LZ4:
            found = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
        elif compression == NONE:
            found = data
        else:
            raise ChunkError(f"a chunk is compressed with {compression[:20]!r}; known are lz4 and zstd")
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError) as error:
        raise ChunkError(f"a chunk cannot be uncompressed: {error}") from None
    if len(found) != size or (crc and zlib.crc32(found) != crc):
        raise ChunkError("a chunk is damaged: size or checksum do not fit")
    return found


def messages(data: bytes) -> Iterator[tuple[int, int, int, int, memoryview]]:
    """Channel, sequence, log and publish time, and data of each message; ChunkError for invalid data."""
    view, at, end = memoryview(data), 0, len(data)
    while at < end:
        if at + RECORD.size > end:
            raise ChunkError("a chunk ends within a record")
        opcode, length = RECORD.unpack_from(view, at)
        at += RECORD.size
        if length > end - at or (opcode == Opcode.MESSAGE and length < BODY.size):
            raise ChunkError(f"a record of {length} bytes does not fit its chunk")
        if opcode == Opcode.MESSAGE:
            yield (*BODY.unpack_from(view, at), view[at + BODY.size : at + length])
        at += length
