"""Writes to the disk in a separate thread, so that a slow or full disk stalls no other thread.

A limited number of bytes may wait for the disk; further data is dropped. The thread also compresses: zstd and lz4 let
other threads run meanwhile.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from io import UnsupportedOperation
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO, Final

from trocar.procs.recordings.chunks import Chunk, PackedChunk, packed
from trocar.procs.recordings.writing import ChannelTable, RecordingFile

MAX_WAITING: Final = 48 << 20
UNSYNCED: Final = (errno.EINVAL, errno.ENOTSUP)
"""Errors of fdatasync for files that do not support it."""
NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)
Open = Callable[[Path], BinaryIO]


def open_new(path: Path) -> BinaryIO:
    """A new file without a buffer in this process: written data is in the Linux kernel at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("xb", buffering=0)


class Disk:
    """The thread with its queue. `problem`: the last error, empty after a successful write."""

    def __init__(self, most: int = MAX_WAITING) -> None:
        self._jobs: SimpleQueue[tuple[Callable[[], None] | None, int]] = SimpleQueue()
        self._most, self._lock = most, threading.Lock()
        self.waiting = 0
        """Bytes in the queue."""
        self.problem = ""
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def has_room(self, size: int) -> bool:
        """Whether the queue has room for `size` more bytes."""
        return self.waiting + size <= self._most

    def do(self, job: Callable[[], None], size: int = 0) -> None:
        """Queue a job; an error in it becomes `problem`."""
        with self._lock:
            self.waiting += size
        self._jobs.put((job, size))

    def _run(self) -> None:
        while True:
            job, size = self._jobs.get()
            if job is None:
                return
            try:
                job()
            except Exception as error:  # the next job may succeed
                self.problem = in_words(error)
            with self._lock:
                self.waiting -= size

    def close(self, seconds: float) -> bool:
        """Finish the queue; False if that takes longer than `seconds`, and the rest is dropped."""
        self._jobs.put((None, 0))
        self._thread.join(seconds)
        return not self._thread.is_alive()


def in_words(error: Exception) -> str:
    """An error of the disk in words."""
    if isinstance(error, OSError):
        return f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"
    return f"{type(error).__name__}: {error}"


def no_room_made() -> bool:
    """The default for `make_room`: remove no files."""
    return False


class DiskFile:
    """One recording that the disk's thread writes, until it `is_ended`."""

    def __init__(self, disk: Disk, path: Path, table: ChannelTable, metadata: Mapping[str, Mapping[str, str]],
                 attachments: Sequence[tuple[str, str, bytes]], created_ns: int, opened: Open = open_new,
                 make_room: Callable[[], bool] = no_room_made) -> None:
        """`make_room` is called while the disk is full; it returns False if it could not remove a file."""
        self.path, self._disk, self._table = path, disk, table
        self._begin = metadata, attachments, created_ns
        self._opened, self._make_room = opened, make_room
        self._stream: BinaryIO | None = None
        self._file: RecordingFile | None = None
        self.dropped = self.messages = 0
        """Number of dropped messages, and of those that are or will be in it."""
        self.is_ended = False
        self.has_failed = False
        """Whether other parts are missing: copied chunks, or the end."""
        self.has_made_room = False
        """Whether files were removed to make room for it."""
        self.problem = ""
        """Why parts are missing, in words; empty if none are."""

    @property
    def is_complete(self) -> bool:
        """Whether it has ended with messages, and no message or other part is missing."""
        return bool(self.is_ended and self.messages and not self.dropped and not self.has_failed)

    @property
    def size(self) -> int:
        """Size on the disk in bytes."""
        return self._file.size if self._file is not None else 0

    def put(self, chunk: Chunk, compression: str) -> bool:
        """Queue the messages of a chunk; False if they are dropped because the queue is full."""
        if not chunk.count:
            return True
        if not self._disk.has_room(len(chunk.data)):
            self.dropped += chunk.count
            self.problem = self.problem or "the disk is too slow"
            return False
        self.messages += chunk.count
        self._disk.do(lambda: self._write(chunk, compression), len(chunk.data))
        return True

    def has_room(self, size: int) -> bool:
        """Whether the queue has room for `size` more bytes."""
        return self._disk.has_room(size)

    def do(self, job: Callable[[RecordingFile], None]) -> None:
        """Queue another job on the file."""
        self._disk.do(lambda: self._do(job))

    def finish(self, losses: Mapping[str, str], name: str) -> None:
        """Queue the end of the file; `losses` are noted as metadata `name`."""
        self._disk.do(lambda: self._end(losses, name))

    def _do(self, job: Callable[[RecordingFile], None]) -> None:
        try:
            job(self._open())
        except Exception as error:
            self.has_failed, self.problem = True, in_words(error)
            raise

    def _open(self) -> RecordingFile:
        if self._file is None:
            stream = self._opened(self.path)
            try:
                self._file = RecordingFile(stream, self._table, *self._begin)
            except BaseException:  # so that it can be started again when there is room
                stream.close()
                with suppress(OSError):
                    self.path.unlink(missing_ok=True)
                raise
            self._stream = stream
        return self._file

    def _write(self, chunk: Chunk, compression: str) -> None:
        try:
            self._put(packed(chunk, compression))
        except Exception as error:
            self.dropped += chunk.count
            self.messages -= chunk.count
            self.problem = in_words(error)
            raise
        self._sync_or_fail()
        self._disk.problem = ""

    def _sync_or_fail(self) -> None:
        """Sync, and note a failure: the data seems to be in the file, but may be missing later."""
        try:
            self._sync()
        except OSError as error:
            self.has_failed, self.problem = True, in_words(error)
            raise

    def _put(self, chunk: PackedChunk) -> None:
        """Write a chunk; if the disk is full, make room and retry as long as possible."""
        while True:
            try:
                self._open().put(chunk)
                return
            except OSError as error:
                if error.errno not in NO_ROOM or not self._make_room():
                    raise
                self.has_made_room = True

    def _sync(self) -> None:
        """Sync to the disk, so that a power failure loses no written data."""
        if self._stream is None:
            return
        try:
            os.fdatasync(self._stream.fileno())
        except UnsupportedOperation:  # not a file on a disk
            return
        except OSError as error:
            if error.errno not in UNSYNCED:
                raise

    def _end(self, losses: Mapping[str, str], name: str) -> None:
        try:
            if self._file is not None:
                self._file.note(name, {**losses, "dropped": str(self.dropped)})
                self._file.finish()
                self._sync()
        except Exception as error:
            self.has_failed, self.problem = True, in_words(error)
            raise
        finally:
            self.is_ended = True
            if self._stream is not None:
                self._stream.close()
