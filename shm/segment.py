"""One shared-memory segment: its name, its header, who may create, claim and read it.

The supervisor creates a segment, sizes it with posix_fallocate (a full /dev/shm is an error now, not a SIGBUS in a
loop later) and alone unlinks it. A writer claims it with a flock, which the kernel gives back when the writer dies.
A reader maps it read-only. Everything in the header is checked against the file before anything is mapped.

Header, little-endian (W: written by the supervisor at creation, C: by the claiming writer, H: by its loop):

    0    8  W  magic             "TROCAR" 0 1
    8    4  W  header version    2
    12   4  W  header size       offset of the first slot, a multiple of 4096
    16   8  W  fingerprint       of the schema
    24   4  W  stride            bytes from slot to slot
    28   4  W  depth             slots
    32   4  W  schema length     JSON, from byte 256
    36   4  W  info length       JSON behind the schema: constants of this instance (names, cuts)
    40  16  W  kind              "ring", "mailbox", "control", "clock", "document"
    56   8  W  size              of the whole file
    64   4  C  pid               of the writer, 0: never claimed
    68   4  C  epoch             +1 at each claim
    72   8  C  start             the writer's start time, clock ticks since boot (from /proc)
    80  64  C  name              instance name of the writer
    192  8  H  head              sequence of the newest slot, 0: none; on a cache line of its own
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import mmap
import os
import re
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import posix_ipc

from shm.layout import MAX_DEPTH, MAX_STRIDE, PAGE, LayoutError, Schema, schema_from_json
from shm.order import Words, ordered

MAGIC = b"TROCAR\x00\x01"
VERSION = 2
FIXED = struct.Struct("<8sIIQIIII16sQ")
IDENTITY = struct.Struct("<IIQ64s")
IDENTITY_AT = 64
HEAD_AT = 192
TEXT_AT = 256
MAX_TEXT = 1 << 20
NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
FOLDER = Path("/dev/shm")
CLAIM_ATTEMPTS, CLAIM_PAUSE_S = 10, 0.002


class SegmentError(Exception):
    """A segment that cannot be made, found, trusted or claimed; the message says which and what to do."""


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


@dataclass(frozen=True, slots=True)
class Identity:
    """Who claimed a segment: `epoch` counts the claims, `start` is the process start time in ticks since boot."""

    pid: int
    epoch: int
    start: int
    name: str


def segment_name(system: str, instance: str, what: str) -> str:
    """`/trocar~<system>~<instance>~<what>`; SegmentError when a part has letters that are not allowed."""
    for label, part in (("system", system), ("instance", instance), ("segment", what)):
        if not NAME.fullmatch(part):
            raise SegmentError(f"{label} name {part!r}: allowed are 1 to 64 letters, digits, _ and -")
    return f"/trocar~{system}~{instance}~{what}"


def names_of(system: str | None = None) -> list[tuple[str, str, str]]:
    """All segments present as (system, instance, what), of one system or of all; sorted."""
    found = []
    for path in FOLDER.glob("trocar~*"):
        parts = path.name.split("~")
        if len(parts) == 4 and (system is None or parts[1] == system):
            found.append((parts[1], parts[2], parts[3]))
    return sorted(found)


def create(
    name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None, *, mode: int = 0o600,
    group: int = -1,
) -> int:
    """Make a segment, sized and filled with its header, readable at once; returns its size in bytes.

    Raises SegmentError when it exists, when shared memory is full or when a size is out of range.
    """
    info_text = json.dumps(info or {}, separators=(",", ":")).encode()
    if not 0 < depth <= MAX_DEPTH:
        raise SegmentError(f"{name}: depth {depth}; allowed are 1 to {MAX_DEPTH}")
    first = -(-(TEXT_AT + len(schema.text) + len(info_text)) // PAGE) * PAGE
    size = -(-(first + depth * schema.stride) // PAGE) * PAGE
    try:
        shared = posix_ipc.SharedMemory(name, flags=posix_ipc.O_CREX, mode=0o600)
    except posix_ipc.ExistentialError:
        raise SegmentError(f"{name}: exists already; another system of this name is up, or was not cleared") from None
    try:
        _fill(shared.fd, name, size)
        header = FIXED.pack(MAGIC, VERSION, first, schema.fingerprint, schema.stride, depth, len(schema.text),
                            len(info_text), kind.encode(), size)
        os.pwrite(shared.fd, schema.text + info_text, TEXT_AT)
        os.pwrite(shared.fd, header[8:], 8)
        os.pwrite(shared.fd, MAGIC, 0)  # last: a half-made segment has no magic
        if group >= 0:
            os.fchown(shared.fd, -1, group)
        os.fchmod(shared.fd, mode)  # fchmod, because the umask narrows what shm_open is given
    except BaseException:
        shared.unlink()
        raise
    finally:
        shared.close_fd()
    return size


def _fill(fd: int, name: str, size: int) -> None:
    try:
        os.posix_fallocate(fd, 0, size)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.ENOMEM):
            raise SegmentError(f"{name}: shared memory is full, {size} bytes do not fit in {FOLDER}") from None
        raise


def unlink(name: str) -> None:
    """Remove a segment's name; nothing when it is gone already."""
    with contextlib.suppress(posix_ipc.ExistentialError):
        posix_ipc.unlink_shared_memory(name)


class Segment:
    """An attached segment; a context manager. `view` is its memory, read-only unless attached with `write`."""

    def __init__(self, name: str, *, write: bool = False, owners: frozenset[int] = frozenset()) -> None:
        """Attach after checking owner, size and header; SegmentError says what does not fit."""
        self.name = name
        try:
            shared = posix_ipc.SharedMemory(name, flags=0, read_only=not write)
        except posix_ipc.ExistentialError:
            raise SegmentError(f"{name}: there is no such segment; is the system up? (trocar status)") from None
        except posix_ipc.PermissionsError:
            raise SegmentError(f"{name}: not permitted; the system belongs to another user") from None
        self.fd: int = shared.fd
        try:
            self.header = _checked(self.fd, name, owners)
            access = mmap.ACCESS_WRITE if write else mmap.ACCESS_READ
            self._map = mmap.mmap(self.fd, self.header.size, access=access)
        except BaseException:
            os.close(self.fd)
            raise
        self.view = memoryview(self._map)
        self._at_close: list[Callable[[], object]] = [self.view.release]
        self._closed = self._claimed = False

    def at_close(self, callback: Callable[[], object]) -> None:
        """Call this first when the segment is closed."""
        self._at_close.insert(0, callback)

    def keep(self, part: memoryview) -> memoryview:
        """Release `part`, a view taken from this segment, at close."""
        self.at_close(part.release)
        return part

    def words(self) -> Words:
        """The whole segment as unsigned 64-bit words, loaded and stored in program order (shm/order.py)."""
        words = self.view.cast("Q")
        self.keep(words)
        return ordered(words)

    def claim(self, name: str) -> Identity:
        """Become the writer; SegmentError names the one that holds it. The kernel frees the claim when we die."""
        for attempt in range(CLAIM_ATTEMPTS):
            try:
                fcntl.flock(self.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if attempt < CLAIM_ATTEMPTS - 1:
                    time.sleep(CLAIM_PAUSE_S)  # somebody may only be asking whether it is claimed
        else:
            first = self.identity()
            raise SegmentError(f"{self.name}: {first.name} (pid {first.pid}) writes it already; a ring has one writer")
        self._claimed = True
        self.at_close(lambda: fcntl.flock(self.fd, fcntl.LOCK_UN))  # a map still in use holds a copy of our descriptor
        identity = Identity(os.getpid(), self.identity().epoch + 1, start_time(os.getpid()), name)
        packed = IDENTITY.pack(identity.pid, identity.epoch, identity.start, name.encode()[:64])
        self.view[IDENTITY_AT : IDENTITY_AT + IDENTITY.size] = packed
        return identity

    def identity(self) -> Identity:
        """Who claimed last."""
        pid, epoch, start, name = IDENTITY.unpack_from(self.view, IDENTITY_AT)
        return Identity(pid, epoch, start, name.rstrip(b"\0").decode(errors="replace"))

    def claimed(self) -> bool:
        """Whether a living process holds the claim now (asks the kernel, for tools; not for loops)."""
        if self._claimed:
            return True
        try:
            fcntl.flock(self.fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        fcntl.flock(self.fd, fcntl.LOCK_UN)
        return False

    def close(self) -> None:
        """Unmap and close; every view taken from it must be out of use."""
        if self._closed:
            return
        self._closed = True
        for callback in self._at_close:
            with contextlib.suppress(BufferError):
                callback()
        with contextlib.suppress(BufferError):  # a numpy view still lives: the map goes with it
            self._map.close()
        os.close(self.fd)

    def __enter__(self) -> Segment:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def start_time(pid: int) -> int:
    """Start time of a process in clock ticks since boot, 0 when gone; with the pid it names a process for good."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return 0
    return int(text.rsplit(")", 1)[1].split()[19])


def _checked(fd: int, name: str, owners: frozenset[int]) -> Header:
    status = os.fstat(fd)
    if status.st_uid not in {os.getuid(), 0} | owners:
        raise SegmentError(f"{name}: belongs to user {status.st_uid}; accepted: {os.getuid()}, 0 and those configured")
    raw = os.pread(fd, FIXED.size, 0)
    if len(raw) < FIXED.size:
        raise SegmentError(f"{name}: {status.st_size} bytes are too short for a header")
    magic, version, first, fingerprint, stride, depth, schema_size, info_size, kind, size = FIXED.unpack(raw)
    if magic != MAGIC:
        raise SegmentError(f"{name}: is not a Trocar segment (magic {magic!r})")
    if version != VERSION:
        raise SegmentError(f"{name}: has header version {version}, this program reads {VERSION}")
    if not (0 < stride <= MAX_STRIDE and stride % 64 == 0 and 0 < depth <= MAX_DEPTH):
        raise SegmentError(f"{name}: stride {stride} and depth {depth} are out of range")
    if max(schema_size, info_size) > MAX_TEXT or not TEXT_AT + schema_size + info_size <= first <= 4 * MAX_TEXT:
        raise SegmentError(f"{name}: the texts of the header do not fit")
    if first % PAGE or size != status.st_size or first + stride * depth > size:
        raise SegmentError(f"{name}: file of {status.st_size} bytes, but the header asks for {first + stride * depth}")
    text = os.pread(fd, schema_size + info_size, TEXT_AT)
    try:
        schema = schema_from_json(text[:schema_size])
        info = json.loads(text[schema_size:])
    except (LayoutError, ValueError, RecursionError) as error:
        raise SegmentError(f"{name}: {error}") from None
    if schema.fingerprint != fingerprint or schema.stride != stride or not isinstance(info, dict):
        raise SegmentError(f"{name}: schema and header contradict each other")
    return Header(kind.rstrip(b"\0").decode(errors="replace"), schema, info, first, stride, depth, size)
