"""Recordings that tests make: rings' schemas, records in them, and files in memory or in a folder."""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import ZSTD, Chunk, packed
from trocar.procs.recordings.layout import ENCAPSULATION
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.shm.memory.layout import Schema, schema_of
from trocar.shm.memory.rows import Field, Topic

BEGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 1_000_000
FACTS = {names.SYSTEM: {"format": names.FORMAT, "kind": names.BOX, "system": "demo"}}

STATE = schema_of(Topic("state", "arm", rate_hz=1500, fields=(
    Field("valid", "?", "", "usable"), Field("names", "(2,)S5", "", "joints"),
    Field("position", "(2,)<f8", "rad", "where it is"), Field("fault", "<u2", "", "0: none"),
    Field("matrix", "(2,3)<f4", "", "numbers"), Field("text", "S7", "", "said"))))

WIDE = schema_of(Topic("state", "arm", rate_hz=1500, fields=(Field("numbers", "(200,)<f8", "", "many"),)))


def rows_of(schema: Schema, count: int, seed: int = 0, first: int = 1) -> NDArray[Any]:
    """Records with anything in them, numbered from `first` on."""
    form = schema.dtype
    raw = np.random.default_rng(seed).integers(0, 256, count * form.itemsize, np.uint8)
    rows = np.frombuffer(raw.tobytes(), form).copy()
    for name in form.names or ():
        if form[name].base.kind == "b":
            rows[name] = np.frombuffer(raw.tobytes()[: rows[name].size], np.uint8).reshape(rows[name].shape) & 1
    rows["sequence"] = np.arange(first, first + count)
    rows["stamp_ns"] = np.arange(count) * STEP_NS + 5
    return rows


def written(stream: BinaryIO, rings: Mapping[tuple[str, str], tuple[Schema, NDArray[Any]]], per_chunk: int = 10,
            compression: str = ZSTD, finish: bool = True, document: bytes = b"{}", rate_hz: float = 0.0
            ) -> RecordingFile:
    """A file with these rings (instance, ring): their schemas and records, some of each in a chunk."""
    table = ChannelTable()
    info = {"type": "PSM", "rate_hz": rate_hz}
    made = {key: table.ring(*key, "arm", schema, 1, info) for key, (schema, _) in rings.items()}
    file = RecordingFile(stream, table, FACTS, [(names.DOCUMENT, "application/gzip", gzip.compress(document, mtime=0))],
                         BEGIN_NS)
    most = max(len(rows) for _, rows in rings.values())
    for begin in range(0, most, per_chunk):
        chunk = Chunk()
        for key, (_, rows) in rings.items():
            channel, layout = made[key]
            for row in rows[begin : begin + per_chunk]:
                number, stamp = int(row["sequence"]), int(row["stamp_ns"])
                chunk.add(channel, number, BEGIN_NS + stamp, stamp, ENCAPSULATION, row.tobytes()[: layout.size])
        file.put(packed(chunk, compression))
    if finish:
        file.finish()
    return file


def a_recording(folder: Path, count: int = 50, name: str = "one.mcap", schema: Schema = STATE, **options: Any
                ) -> tuple[Path, NDArray[Any]]:
    """A file with records of one ring."""
    rows, path = rows_of(schema, count), folder / name
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (schema, rows)}, **options)
    return path, rows


def in_memory(count: int = 50, **options: Any) -> bytes:
    """The same as bytes."""
    stream = io.BytesIO()
    written(stream, {("PSM1", "state"): (STATE, rows_of(STATE, count))}, **options)
    return stream.getvalue()
