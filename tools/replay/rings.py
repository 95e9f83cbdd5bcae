"""All rings of a system into a recording, piece by piece while its time is stopped: nothing is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import ZSTD, Chunk, packed
from trocar.procs.recordings.facts import document_of, facts_of, local_offset_ns
from trocar.procs.recordings.layout import ENCAPSULATION, RecordLayout
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory


class WholeRings(Closable):
    """A recording of every ring at full rate; a context manager. `take` is called before rings wrap around."""

    def __init__(self, system: str, stream: BinaryIO, name: str) -> None:
        """Begin a file in `stream`; SegmentError if a ring cannot be read."""
        self._system, self._table = system, ChannelTable()
        self._file = RecordingFile(stream, self._table, facts_of(system, names.NAMED, name), document_of(system))
        self._readers: dict[tuple[str, str], RingReader] = {}
        self._schemas: dict[tuple[str, str], Schema] = {}
        for key in directory.rings(system):
            segment = Segment(segment_name(system, *key))
            self._schemas[key] = segment.header.schema
            self._readers[key] = RingReader(segment, often=False)
        self._seen = dict.fromkeys(self._readers, 0)
        self._channels: dict[tuple[str, str, int], tuple[int, RecordLayout]] = {}
        for key, reader in self._readers.items():  # also those that stay empty
            self._channel(key, reader)
        self.lost: dict[str, int] = {}
        """Records by topic that were overwritten before they were read."""
        self.records = 0

    def take(self) -> None:
        """The new records."""
        chunk, offset = Chunk(), local_offset_ns(self._system)
        for key, reader in self._readers.items():
            rows = reader.last(max(0, reader.head - self._seen[key]))
            if len(rows):
                missing = int(rows["sequence"][0]) - self._seen[key] - 1
                if missing > 0:
                    self.lost["/".join(key)] = self.lost.get("/".join(key), 0) + missing
                self._seen[key] = int(rows["sequence"][-1])
                self._add(chunk, key, reader, rows, offset)
        if chunk.count:
            self._file.put(packed(chunk, ZSTD))
            self.records += chunk.count

    def _add(self, chunk: Chunk, key: tuple[str, str], reader: RingReader, rows: NDArray[Any], offset: int) -> None:
        channel, layout = self._channel(key, reader)
        raw, size = rows.view(np.uint8).reshape(-1).data, rows.dtype.itemsize
        for k, (number, stamp) in enumerate(zip(rows["sequence"].tolist(), rows["stamp_ns"].tolist(), strict=True)):
            chunk.add(channel, number, max(stamp + offset, 0), max(stamp, 0), ENCAPSULATION,
                      raw[k * size : k * size + layout.size])

    def _channel(self, key: tuple[str, str], reader: RingReader) -> tuple[int, RecordLayout]:
        epoch = (*key, reader.epoch)
        if epoch not in self._channels:
            kind = str(reader.info.get("kind", ""))
            self._channels[epoch] = self._table.ring(*key, kind, self._schemas[key], reader.epoch, reader.info)
        return self._channels[epoch]

    def close(self) -> None:
        """End the file."""
        for reader in self._readers.values():
            reader.close()
        self._file.note(names.LOSSES, {name: str(count) for name, count in self.lost.items()})
        self._file.finish()


def new_file(path: Path) -> BinaryIO:
    """A file without a buffer, for a recording."""
    return path.open("xb", buffering=0)
