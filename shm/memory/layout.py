"""Layouts derived from the topic table: numpy dtypes, schemas as JSON, and their fingerprints.

A slot is the aligned record `sequence, stamp_ns, fields…`, its stride a multiple of a cache line (64 bytes). The schema
travels in the segment's header, so that a tool can read a ring without this table; the fingerprint of the schema is
compared at attach, so that two programs with different tables never misread each other.
"""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trocar.shm.memory.rows import Topic

LINE = 64
MORE = "…".encode()
MIN_SENTENCE = 16  # bytes: with less room only "…" would be left
PAGE = 4096
SHAPED = re.compile(r"^\((?P<shape>[^)]*)\)(?P<scalar>.+)$")
MAX_STRIDE = 1 << 20
MAX_DIMENSIONS = 8
MAX_DEPTH = 1 << 16  # a reader keeps a view of every slot; 10 s at 6 kHz
FIELD_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/-]{0,63}")
KEPT_SCHEMAS = 256  # processes of one kind have the same ones, and every ring is made and attached to with them


class LayoutError(Exception):
    """An unusable schema: names the field and the error."""


@dataclass(frozen=True, slots=True)
class Schema:
    """One ring's layout: `text` is the JSON in the header, `fingerprint` its first 8 hash bytes."""

    topic: str
    dtype: np.dtype[np.void]
    stride: int
    text: bytes
    fingerprint: int

    def offset(self, field: str) -> int:
        """Byte offset of a field in the slot."""
        fields: Mapping[str, Any] = self.dtype.fields or {}
        return int(fields[field][1])


def schema_of(topic: Topic, dims: Mapping[str, int] | None = None) -> Schema:
    """The schema of a topic with its named sizes filled in from `dims` (`axes=7`, …)."""
    return _schema_of(topic, tuple(sorted(dict(dims or {}).items())))


@functools.lru_cache(KEPT_SCHEMAS)
def _schema_of(topic: Topic, dims: tuple[tuple[str, int], ...]) -> Schema:
    sizes = dict(dims)
    fields = [
        {"name": f.name, "dtype": _filled(f.dtype, sizes, topic.name, f.name), "unit": f.unit, "text": f.text,
         **({"group": f.group} if f.group else {})}
        for f in topic.fields
    ]
    document = {"topic": topic.name, "writer": topic.writer, "fields": fields}
    return schema_from_json(json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode())


@functools.lru_cache(KEPT_SCHEMAS)
def schema_from_json(text: bytes) -> Schema:
    """The schema in a header; LayoutError if the text is not a schema (it may come from an untrusted source)."""
    try:
        document = json.loads(text)
        topic = _name(document["topic"])
        rows = [(_name(f["name"]), str(f["dtype"])) for f in document["fields"]]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise LayoutError(f"the schema is not readable: {error}") from None
    names, formats = ["sequence", "stamp_ns"], ["<u8", "<i8"]
    for name, scalar in rows:
        names.append(name)
        formats.append(scalar)
    if len(set(names)) != len(names):
        raise LayoutError(f"topic {topic}: a field name occurs twice")
    try:
        dtype: np.dtype[np.void] = np.dtype({"names": names, "formats": [_parse(f) for f in formats]}, align=True)
    except (TypeError, ValueError) as error:
        raise LayoutError(f"topic {topic}: {error}") from None
    stride = -(-dtype.itemsize // LINE) * LINE
    if stride > MAX_STRIDE:
        raise LayoutError(f"topic {topic}: a record of {dtype.itemsize} bytes; allowed are {MAX_STRIDE}")
    digest = hashlib.blake2b(text, digest_size=8).digest()
    return Schema(topic, dtype, stride, text, int.from_bytes(digest, "little"))


def _name(name: str) -> str:
    if not FIELD_NAME.fullmatch(name):
        raise LayoutError(f"{name[:64]!r} is no name; allowed are up to 64 letters, digits, _, / and -")
    return name


def cut_text(text: str, size: int) -> bytes:
    """UTF-8 of `text`, at most `size` bytes, cut between characters."""
    encoded = text.encode(errors="replace")
    return encoded if len(encoded) <= size else encoded[:size].decode(errors="ignore").encode()


def shorten(text: str, size: int) -> bytes:
    """UTF-8 of a sentence, at most `size` bytes; one that is longer ends with a whole word and "…"."""
    encoded = text.encode(errors="replace")
    if len(encoded) <= size:
        return encoded
    if size < MIN_SENTENCE:
        return cut_text(text, size)
    kept = cut_text(text, size - len(MORE)).decode()
    whole, blank, _ = kept.rpartition(" ")
    return ((whole if blank else kept).rstrip(" ,;:") + MORE.decode()).encode()


def _filled(dtype: str, sizes: Mapping[str, int], topic: str, field: str) -> str:
    match = SHAPED.match(dtype)
    if not match:
        return dtype
    shape = []
    for word in (w.strip() for w in match["shape"].split(",") if w.strip()):
        if not word.isdigit() and word not in sizes:
            raise LayoutError(f"topic {topic}, field {field}: size {word} was not given")
        shape.append(int(word) if word.isdigit() else int(sizes[word]))
    return f"({','.join(str(n) for n in shape)},){match['scalar']}"


def _parse(dtype: str) -> tuple[str, tuple[int, ...]] | str:
    match = SHAPED.match(dtype)
    if not match:
        _check_scalar(dtype)
        return dtype
    shape = tuple(int(w) for w in match["shape"].split(",") if w.strip())
    if len(shape) > MAX_DIMENSIONS or any(n < 0 or n > MAX_STRIDE for n in shape):
        raise LayoutError(f"shape {str(shape)[:64]} is out of range")
    _check_scalar(match["scalar"])
    return match["scalar"], shape


def _check_scalar(dtype: str) -> None:
    if not re.fullmatch(r"\?|u1|i1|<[iuf](2|4|8)|S[1-9][0-9]{0,3}", dtype):
        raise LayoutError(f"dtype {dtype[:64]!r} is not allowed in shared memory")


def address_of(view: memoryview) -> int:
    """Address of the memory that a view shows."""
    return int(np.frombuffer(view, np.uint8).ctypes.data)
