"""Some records of a recording by the indexes of its chunks: only chunks that have some of them are uncompressed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from trocar.procs.recordings.chunks import BODY, RECORD, ChunkError
from trocar.procs.recordings.reading import ALL_STAMPS, RecordingReader
from trocar.procs.recordings.records import Piece, Records

Choose = Callable[[NDArray[np.int64]], NDArray[np.intp]]
"""The places of the wanted records among those of these times of day."""


def picked(reader: RecordingReader, wanted: Mapping[str, Choose], begin_ns: int, end_ns: int,
           check: Callable[[], None]) -> Iterator[tuple[str, Records]]:
    """Chosen records of topics, from the chunks that have times from `begin_ns` to `end_ns`, the newest chunk first.

    Each function chooses among the records of one chunk at a time, so that it may take into account what came before.
    `check` is called between chunks, and raises an error to end this.
    """
    topics = [(name, reader.topics[name], reader.dtype(name), choose) for name, choose in wanted.items()
              if name in reader.record_topics]
    for place in sorted(reader.chunks, key=lambda place: place.end_ns, reverse=True):
        if place.end_ns < begin_ns or place.begin_ns > end_ns:
            continue
        check()
        data, index = b"", reader.index(place)
        try:
            if index is None:
                data = reader.plain(place)
                index = indexed(data)
            for name, topic, dtype, choose in topics:
                piece = Piece(topic, dtype)
                for channel in topic.channels.keys() & index.keys():
                    entries = index[channel]
                    for log_ns, at in entries[choose(entries[:, 0])].tolist():
                        data = data or reader.plain(place)
                        piece.add(channel, log_ns, _message(data, at))
                records = piece.records(ALL_STAMPS)
                if len(records.rows):
                    yield name, records
        except ChunkError:  # the rest of the file is good
            continue


def indexed(data: bytes) -> dict[int, NDArray[np.int64]]:
    """See RecordingReader.index, of the data of a chunk."""
    found: dict[int, list[tuple[int, int]]] = {}
    at = 0
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        if opcode == Opcode.MESSAGE and at + RECORD.size + BODY.size <= len(data):
            channel, _, log_ns, _ = BODY.unpack_from(data, at + RECORD.size)
            found.setdefault(channel, []).append((min(log_ns, (1 << 63) - 1), at))
        at += RECORD.size + length
    return {channel: np.array(rows, np.int64) for channel, rows in found.items()}


def _message(data: bytes, at: int) -> memoryview:
    """The content of the message there; ChunkError if there is none."""
    begin = at + RECORD.size + BODY.size
    if not 0 <= at <= len(data) - RECORD.size - BODY.size:
        raise ChunkError("an index does not fit its chunk")
    opcode, length = RECORD.unpack_from(data, at)
    if opcode != Opcode.MESSAGE or not BODY.size <= length <= len(data) - at - RECORD.size:
        raise ChunkError("an index does not fit its chunk")
    return memoryview(data)[begin : at + RECORD.size + length]
