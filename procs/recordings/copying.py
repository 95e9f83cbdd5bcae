"""Chunks of one recording into another one, as they are: both have their channels from the same table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mcap.opcode import Opcode

from trocar.procs.recordings.chunks import RECORD, PackedChunk
from trocar.procs.recordings.reading import CHUNK, MAX_RECORD
from trocar.procs.recordings.writing import MAGIC

INDEX_HEAD: Final = 6


def chunks_of(path: Path, begin_ns: int = 0) -> Iterator[PackedChunk]:
    """The chunks of a file that we have written ourselves, which may still grow, that end after `begin_ns`."""
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
