"""The header of a segment: its layout, and the checks before a file is accepted as one.

Header, little-endian (W: written by the supervisor at creation, C: by the claiming writer, H: by its loop):

    0    8  W  magic             "TROCAR" 0 1
    8    4  W  header version    2
    12   4  W  header size       offset of the first slot: 256 and the texts, in whole pages of 4096
    16   8  W  fingerprint       of the schema
    24   4  W  stride            bytes from slot to slot
    28   4  W  depth             slots
    32   4  W  schema length     JSON, from byte 256
    36   4  W  info length       JSON behind the schema: constants of this instance (names, cuts)
    40  16  W  kind              "ring", "mailbox", "control", "clock", "document", "faults"
    56   8  W  size              of the whole file
    64   4  C  pid               of the writer, 0: never claimed
    68   4  C  epoch             +1 at each claim
    72   8  C  start             the writer's start time, clock ticks since boot (from /proc)
    80  64  C  name              instance name of the writer
    192  8  H  head              sequence of the newest slot, 0: none; on a cache line of its own
"""

from __future__ import annotations

import errno
import json
import os
import struct
from dataclasses import dataclass
from typing import Any

from trocar.shm.memory.layout import LINE, MAX_DEPTH, MAX_STRIDE, PAGE, LayoutError, Schema, schema_from_json

MAGIC = b"TROCAR\x00\x01"
VERSION = 2
FIXED = struct.Struct("<8sIIQIIII16sQ")
IDENTITY = struct.Struct("<IIQ64s")
IDENTITY_AT = 64
HEAD_AT = 192
TEXT_AT = 256
MAX_TEXT = 1 << 20
BLOCK = 512  # unit of a file's block count
KINDS = ("ring", "mailbox", "control", "clock", "document", "faults")


class SegmentError(Exception):
    """A segment that cannot be made, found, trusted or claimed; the message says which and how to fix it."""


def reason(error: Exception) -> str:
    """Why a file was not opened or made, and the remedy if there is one."""
    more = " (ulimit -n $(ulimit -Hn) allows more at its start)" if getattr(error, "errno", 0) == errno.EMFILE else ""
    return f"{getattr(error, 'strerror', None) or error}{more}"


@dataclass(frozen=True, slots=True)
class Header:
    """The checked header of a segment."""

    kind: str
    schema: Schema
    info: dict[str, Any]
    first: int
    stride: int
    depth: int
    size: int


def text_of(info: dict[str, Any] | None) -> bytes:
    """The header's text about the instance, unparsed."""
    return json.dumps(info or {}, separators=(",", ":")).encode()


def layout(name: str, kind: str, schema: Schema, depth: int, info_text: bytes) -> tuple[int, int]:
    """(offset of the first slot, size of the file); SegmentError when a size is out of range."""
    if kind not in KINDS or not 0 < depth <= MAX_DEPTH:
        raise SegmentError(f"{name}: kind {kind}, depth {depth}; allowed are {', '.join(KINDS)} and 1 to {MAX_DEPTH}")
    if max(len(schema.text), len(info_text)) > MAX_TEXT:
        raise SegmentError(f"{name}: texts of {len(schema.text)} and {len(info_text)} bytes for its header; allowed "
                           f"are {MAX_TEXT} each")
    first = pages(TEXT_AT + len(schema.text) + len(info_text))
    return first, pages(first + depth * schema.stride)


def pages(size: int) -> int:
    """This many bytes, rounded up to whole pages."""
    return -(-size // PAGE) * PAGE


def readable(raw: bytes) -> str:
    """Text from a cell with any content, made fit for one line."""
    text = raw.rstrip(b"\0").decode(errors="replace")
    return text if text.isprintable() else "".join(c if c.isprintable() else "\ufffd" for c in text)


def checked(fd: int, name: str) -> Header:
    """The header of a file, if consistent with the file and with itself; SegmentError names the inconsistency."""
    status = os.fstat(fd)
    raw = os.pread(fd, FIXED.size, 0)
    if len(raw) < FIXED.size:
        raise SegmentError(f"{name}: {status.st_size} bytes are too short for a header of {FIXED.size}")
    magic, version, first, fingerprint, stride, depth, schema_size, info_size, kind, size = FIXED.unpack(raw)
    if magic != MAGIC:
        raise SegmentError(f"{name}: is not a Trocar segment (magic {magic!r}, not {MAGIC!r})")
    if version != VERSION:
        raise SegmentError(f"{name}: has header version {version}, this program reads {VERSION}")
    if readable(kind) not in KINDS:
        raise SegmentError(f"{name}: is of unknown kind {readable(kind)!r}; known are {', '.join(KINDS)}")
    if not (0 < stride <= MAX_STRIDE and stride % LINE == 0 and 0 < depth <= MAX_DEPTH):
        raise SegmentError(f"{name}: stride {stride} or depth {depth} is out of range; allowed are multiples of {LINE} "
                           f"to {MAX_STRIDE}, and 1 to {MAX_DEPTH}")
    if max(schema_size, info_size) > MAX_TEXT or first != pages(TEXT_AT + schema_size + info_size):
        raise SegmentError(f"{name}: texts of {schema_size} and {info_size} bytes do not fit a header of {first}; "
                           f"allowed are {MAX_TEXT} each, in whole pages")
    if not size == status.st_size == pages(first + stride * depth):
        raise SegmentError(f"{name}: is a file of {status.st_size} bytes and says {size}, but its header asks for "
                           f"{pages(first + stride * depth)}")
    if status.st_blocks * BLOCK < size:
        raise SegmentError(f"{name}: is a file with holes: of {size} bytes {status.st_blocks * BLOCK} are there")
    schema, info = _texts(os.pread(fd, schema_size + info_size, TEXT_AT), schema_size, name)
    if schema.fingerprint != fingerprint or schema.stride != stride:
        raise SegmentError(f"{name}: schema and header contradict each other: fingerprint {schema.fingerprint:016x}, "
                           f"{fingerprint:016x}; stride {schema.stride}, {stride}")
    return Header(readable(kind), schema, info, first, stride, depth, size)


def _texts(text: bytes, schema_size: int, name: str) -> tuple[Schema, dict[str, Any]]:
    try:
        schema = schema_from_json(text[:schema_size])
    except LayoutError as error:
        raise SegmentError(f"{name}: {error}") from None
    try:
        info = json.loads(text[schema_size:])
    except (ValueError, RecursionError) as error:
        raise SegmentError(f"{name}: what its header says of the instance is not readable: {error}") from None
    if not isinstance(info, dict):
        raise SegmentError(f"{name}: what its header says of the instance is a {type(info).__name__}, not an object")
    return schema, info
