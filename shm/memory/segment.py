"""One shared-memory segment: its name, its header, and the rules for creating, claiming and reading it.

The supervisor creates a segment, sizes it with posix_fallocate (a full /dev/shm is an error now, not a SIGBUS in a
loop later) and alone unlinks it. A writer claims it with a flock, which the kernel gives back when the writer dies.
A reader maps it read-only. Everything in the header (shm/memory/header.py) is checked against the file before anything
is mapped.

Not checkable: a process that may write a segment may also shorten its file; another process that then touches the
missing part is ended by SIGBUS. Files in /dev/shm cannot be sealed against this. Therefore only accepted owners count
(shm/memory/owners.py), and only owner and group may write.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import mmap
import os
import stat
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from trocar.shm.memory import owners, private, removed, shm_files
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.header import (
    FIXED,
    HEAD_AT,
    IDENTITY,
    IDENTITY_AT,
    MAGIC,
    TEXT_AT,
    VERSION,
    Header,
    SegmentError,
    checked,
    layout,
    readable,
    reason,
    text_of,
)
from trocar.shm.memory.layout import Schema, address_of
from trocar.shm.memory.names import FOLDER, NAME, path_of, segment_name
from trocar.shm.memory.order import Words, ordered
from trocar.shm.memory.process_start import start_time

ENDLESS = 1 << 62  # ordinary memory: the kernel reports when there is no more
CLAIM_ATTEMPTS, CLAIM_PAUSE_S = 100, 0.002
Make = Callable[[str, str, Schema, int, dict[str, Any]], int]  # create, with a mode or group bound, or size_of
__all__ = [
    "FIXED", "FOLDER", "HEAD_AT", "IDENTITY_AT", "MAGIC", "NAME", "TEXT_AT", "VERSION", "Header", "Identity", "Make",
    "Segment", "SegmentError", "SegmentFull", "create", "foreign_owner", "free_bytes", "names_of", "open_file",
    "owner_of", "path_of", "segment_name", "size_of", "start_time", "status_of", "unlink",
]


class SegmentFull(SegmentError):
    """Shared memory is full."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The process that claimed a segment: `epoch` counts the claims, `start` is its start time in ticks since boot."""

    pid: int
    epoch: int
    start: int
    name: str


def names_of(system: str | None = None, *, foreign: bool = False) -> list[tuple[str, str, str]]:
    """All segments of accepted owners as (system, instance, what), of one system or of all; sorted.

    Other users' segments are left out; `foreign` lists them.
    """
    ours = [] if foreign else [name[1:].split("~") for name in private.segments(system)]
    if system is not None and private.is_kept(system):
        return sorted((parts[1], parts[2], parts[3]) for parts in ours)
    accepted = owners.accepted()
    begin = "trocar~" if system is None else f"trocar~{system}~"
    found = [(parts[1], parts[2], parts[3]) for parts in ours]
    for path in FOLDER.iterdir() if FOLDER.is_dir() else ():
        parts = path.name.split("~") if path.name.startswith(begin) else []
        if len(parts) == 4 and all(NAME.fullmatch(part) for part in parts[1:]):
            owner = _owner(path.lstat)
            if owner >= 0 and (owner not in accepted) == foreign:
                found.append((parts[1], parts[2], parts[3]))
    return sorted(found)


def free_bytes(system: str = "") -> int:
    """Room left for a system in shared memory, bytes."""
    if private.is_kept(system):
        return ENDLESS
    status = os.statvfs(FOLDER)
    return status.f_bavail * status.f_frsize


def status_of(name: str) -> os.stat_result:
    """Status of the file of a segment, also if another program has removed its name; OSError: there is none."""
    fd = open_file(name, os.O_PATH)
    try:
        return os.fstat(fd)
    finally:
        os.close(fd)


def _owner(status_of_file: Callable[[], os.stat_result]) -> int:
    """User id of an ordinary file, -1: there is none (a link is none)."""
    try:
        status = status_of_file()
    except OSError:
        return -1
    return status.st_uid if stat.S_ISREG(status.st_mode) else -1


def size_of(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
    """Number of bytes that `create` would take; SegmentError if a size is out of range."""
    return layout(name, kind, schema, depth, text_of(info))[1]


def create(
    name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None, *, mode: int = 0o600,
    group: int = -1,
) -> int:
    """Make a segment, sized and filled with its header, readable at once; returns its size in bytes.

    Raises SegmentError when it exists, when shared memory is full, when a size is out of range or when we are not
    of the group.
    """
    info_text = text_of(info)
    first, size = layout(name, kind, schema, depth, info_text)
    fd = _new(name)
    try:
        _fill(fd, name, size)
        header = FIXED.pack(MAGIC, VERSION, first, schema.fingerprint, schema.stride, depth, len(schema.text),
                            len(info_text), kind.encode(), size)
        os.pwrite(fd, schema.text + info_text, TEXT_AT)
        os.pwrite(fd, header[8:], 8)
        os.pwrite(fd, MAGIC, 0)  # last: a half-made segment has no magic
        if group >= 0:
            _give(fd, name, group)
        os.fchmod(fd, mode)  # fchmod, because the umask narrows the mode passed to shm_open
    except BaseException:
        unlink(name)
        raise
    finally:
        os.close(fd)
    return size


def _new(name: str) -> int:
    """The file of a new segment, empty."""
    try:
        return private.create(name) if private.belongs(name) else shm_files.create(name)
    except FileExistsError:
        raise SegmentError(f"{name}: exists already{_in_the_way(name)}") from None
    except OSError as error:
        raise SegmentError(f"{name}: cannot be made in {FOLDER}: {reason(error)}") from None


def _fill(fd: int, name: str, size: int) -> None:
    free = free_bytes()
    try:
        os.posix_fallocate(fd, 0, size)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.ENOMEM):
            text = f"{name}: shared memory is full: {size} bytes are needed, {free} are free in {FOLDER}"
            raise SegmentFull(text) from None
        raise SegmentError(f"{name}: {size} bytes cannot be had in {FOLDER}: {error.strerror}") from None


def _give(fd: int, name: str, group: int) -> None:
    try:
        os.fchown(fd, -1, group)
    except OSError as error:
        raise SegmentError(f"{name}: cannot be given to group {group}: {error.strerror}; a member of the group, or "
                           "root, must start the system") from None


def foreign_owner(name: str) -> str:
    """The owner of a segment in words ("user bob") if it is not accepted; empty if it is, or if there is no segment."""
    uid = _owner(partial(status_of, name))
    return "" if uid == -1 or uid in owners.accepted() else owners.user(uid)


def owner_of(name: str) -> str:
    """The owner of the file under a name, in words ("user bob"); empty if that is us, or if there is no file."""
    try:
        uid = status_of(name).st_uid
    except OSError:
        return ""
    return "" if uid == os.getuid() else owners.user(uid)


def _in_the_way(name: str) -> str:
    """Owner of the unexpected file, and how to resolve it."""
    user, path = owner_of(name), path_of(name)
    if user:
        return (f" and belongs to {user}: its owner, or root, has to remove it (rm {path}); or choose another name "
                "(--system)")
    if path.is_file() and not path.is_symlink():
        return "; another system of this name is up, or was not cleared"
    return f" and is no segment: remove it (rm -r {path})"


def unlink(name: str) -> None:
    """Remove a segment's name; no effect if it is already gone, SegmentError if it may not be removed."""
    if private.belongs(name):
        private.unlink(name)
        return
    try:
        shm_files.unlink(name)
    except FileNotFoundError:
        return
    except OSError as error:
        raise SegmentError(f"{name}: cannot be removed ({reason(error)}){_in_the_way(name)}") from None


def held(name: str) -> bool:
    """Whether any process holds the claim on the file under this name, of this version or another."""
    try:
        fd = open_file(name, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


class Segment(Closable):
    """An attached segment; a context manager. `view` is its memory, read-only unless attached with `write`."""

    def __init__(self, name: str, *, write: bool = False) -> None:
        """Attach after checking owner, size and header; SegmentError names the mismatch."""
        self.name = name
        self.fd: int = _opened(name, write)
        try:
            _trusted(self.fd, name)
            self.header = checked(self.fd, name)
            access = mmap.ACCESS_WRITE if write else mmap.ACCESS_READ
            self._map = _mapped(self.fd, name, self.header.size, access)
        except BaseException:
            os.close(self.fd)
            raise
        self.view = memoryview(self._map)
        self._at_close: list[Callable[[], object]] = [self.view.release]
        self._closed = self._claimed = False

    def at_close(self, callback: Callable[[], object], *, unlocks: bool = False) -> None:
        """Call `callback` first when the segment is closed; with `unlocks` in this process only, see `close`."""
        self._at_close.insert(0, partial(_if_in, os.getpid(), callback) if unlocks else callback)

    def keep(self, part: memoryview) -> memoryview:
        """Release `part`, a view taken from this segment, at close."""
        self.at_close(part.release)
        return part

    @property
    def address(self) -> int:
        """Address of the map, for code that is not Python; valid until `close`, which such code does not check."""
        return address_of(self.view)

    def words(self, copied: int = 0) -> Words:
        """The whole segment as unsigned 64-bit words, loaded and stored in program order (shm/memory/order.py).

        `copied`: bytes of the largest copy that is written between them.
        """
        words = self.view.cast("Q")
        self.keep(words)
        return ordered(words, copied)

    def claim(self, name: str) -> Identity:
        """Become the writer; SegmentError names the current one. The kernel frees the claim when our process ends."""
        for attempt in range(CLAIM_ATTEMPTS):
            try:
                fcntl.flock(self.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if attempt < CLAIM_ATTEMPTS - 1:
                    time.sleep(CLAIM_PAUSE_S)  # another process may only be checking whether it is claimed
        else:
            first = self.identity()
            raise SegmentError(f"{self.name}: {first.name} (pid {first.pid}) writes it already; a ring has one writer")
        if not self._claimed:  # a map still in use holds a copy of our descriptor
            self.at_close(lambda: fcntl.flock(self.fd, fcntl.LOCK_UN), unlocks=True)
        self._claimed = True
        epoch = self.identity().epoch + 1 & 0xFFFFFFFF  # whatever was written there before
        identity = Identity(os.getpid(), epoch, start_time(os.getpid()), name)
        packed = IDENTITY.pack(identity.pid, identity.epoch, identity.start, name.encode()[:64])
        self.view[IDENTITY_AT : IDENTITY_AT + IDENTITY.size] = packed
        return identity

    def identity(self) -> Identity:
        """The last process that claimed it."""
        pid, epoch, start, name = IDENTITY.unpack_from(self.view, IDENTITY_AT)
        return Identity(pid, epoch, start, readable(name))

    def claimed(self) -> bool:
        """Whether a live process holds the claim now (makes a system call: for tools, not for loops)."""
        if self._claimed:
            return True
        try:
            fcntl.flock(self.fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        fcntl.flock(self.fd, fcntl.LOCK_UN)
        return False

    @property
    def gone(self) -> str:
        """The last claimer, in words, if it no longer holds the claim; empty while claimed or if never claimed."""
        last = self.identity()
        return f"{last.name} (pid {last.pid})" if last.epoch and not self.claimed() else ""

    def close(self) -> None:
        """Unmap and close; every view taken from it must be out of use.

        A forked child that closes its copy leaves its parent's claim and places alone.
        """
        if self._closed:
            return
        self._closed = True
        for callback in self._at_close:
            with contextlib.suppress(BufferError):
                callback()
        self._at_close.clear()  # they hold us, and without the garbage collector the reference cycle would stay
        with contextlib.suppress(BufferError):  # a numpy view still lives: the map goes with it
            self._map.close()
        os.close(self.fd)


def _if_in(pid: int, callback: Callable[[], object]) -> None:
    """Locks belong to the open file, which a forked child has as well."""
    if os.getpid() == pid:
        callback()


def open_file(name: str, access: int) -> int:
    """The file of a segment, open, also if another program has removed its name; OSError.

    Never waits, and follows no link but that of the kernel to a file that we have open.
    """
    path, flags = path_of(name), access | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        return os.open(path, flags | (0 if path.parent == private.OURS else os.O_NOFOLLOW))
    except FileNotFoundError:
        if private.belongs(name):
            raise
        return removed.opened(name, flags)


def _opened(name: str, write: bool) -> int:
    """The file, open. Not by shm_open: that one blocks indefinitely on a named pipe, and accepts directories."""
    try:
        return open_file(name, os.O_RDWR if write else os.O_RDONLY)
    except FileNotFoundError:
        raise SegmentError(f"{name}: there is no such segment; is the system up? (trocar status)") from None
    except PermissionError:
        owner = owner_of(name)
        raise SegmentError(f"{name}: not permitted{f', it belongs to {owner}' if owner else ''}; the system's `group` "
                           "decides who else may attach") from None
    except OSError as error:
        what = "cannot be opened" if error.errno == errno.EMFILE else "is no segment but something else of that name"
        raise SegmentError(f"{name}: {what} ({reason(error)})") from None


def _mapped(fd: int, name: str, size: int, access: int) -> mmap.mmap:
    try:
        return mmap.mmap(fd, size, access=access)
    except (OSError, ValueError) as error:  # ValueError: it was cut short since we looked
        raise SegmentError(f"{name}: {size} bytes cannot be mapped: {reason(error)}") from None


def _trusted(fd: int, name: str) -> None:
    """Refuse a file that is not an ordinary file, or has another owner."""
    status = os.fstat(fd)
    if not stat.S_ISREG(status.st_mode):
        raise SegmentError(f"{name}: is no segment but another kind of file (mode {status.st_mode:o})")
    accepted = owners.accepted()
    if status.st_uid not in accepted:
        raise SegmentError(f"{name}: belongs to {owners.user(status.st_uid)}; accepted are {owners.users(accepted)} "
                           f"and the user in {owners.SERVICE_USER}")
    if status.st_mode & stat.S_IWOTH:
        mode = stat.S_IMODE(status.st_mode)
        raise SegmentError(f"{name}: every user may write it (mode {mode:o}); allowed are 600 and 660")
