"""Writing to the disk, in a thread of its own: one that is slow or full holds up nobody.

What it cannot take is dropped. So many bytes may wait for it, no more. Compressing is done here, too: zstd and lz4 let
others run meanwhile.
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
"""What there is nothing to be written back of says so."""
NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)
Open = Callable[[Path], BinaryIO]


def open_new(path: Path) -> BinaryIO:
    """A new file without a buffer of ours: what was written is with the kernel."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("xb", buffering=0)


class Disk:
    """The thread. `problem` is what went wrong last, empty when the last try went well."""

    def __init__(self, most: int = MAX_WAITING, start: bool = True) -> None:
        self._jobs: SimpleQueue[tuple[Callable[[], None] | None, int]] = SimpleQueue()
        self._most, self._lock = most, threading.Lock()
        self.waiting = 0
        """Bytes."""
        self.problem = ""
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        if start:
            self._thread.start()

    def has_room(self, size: int) -> bool:
        """Whether so many bytes may wait, too."""
        return self.waiting + size <= self._most

    def do(self, job: Callable[[], None], size: int = 0) -> None:
        """In its turn. OSError of it becomes `problem`."""
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
            except Exception as error:  # what comes next may well be written
                self.problem = in_words(error)
            with self._lock:
                self.waiting -= size

    def close(self, seconds: float) -> bool:
        """Do what waits; False: it takes longer than so many seconds, and is left."""
        self._jobs.put((None, 0))
        self._thread.join(seconds)
        return not self._thread.is_alive()


def in_words(error: Exception) -> str:
    """What a disk says when it does not take something."""
    if isinstance(error, OSError):
        return f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"
    return f"{type(error).__name__}: {error}"


def no_room_made() -> bool:
    """Nothing is removed for a file."""
    return False


class DiskFile:
    """One recording on its way to the disk, whose thread writes it, until it `is_ended`."""

    def __init__(self, disk: Disk, path: Path, table: ChannelTable, metadata: Mapping[str, Mapping[str, str]],
                 attachments: Sequence[tuple[str, str, bytes]], created_ns: int, opened: Open = open_new,
                 make_room: Callable[[], bool] = no_room_made) -> None:
        """`make_room` is called while there is no room for its messages; False: it could not remove anything."""
        self.path, self._disk, self._table = path, disk, table
        self._begin = metadata, attachments, created_ns
        self._opened, self._make_room = opened, make_room
        self._stream: BinaryIO | None = None
        self._file: RecordingFile | None = None
        self.dropped = self.messages = 0
        """Messages that are not in it, and those that are or will be."""
        self.is_ended = False
        self.has_failed = False
        """Something else than messages is not in it: what was copied, or its end."""
        self.has_made_room = False
        """Something was removed for it."""
        self.problem = ""
        """Why something is not in it, in words; empty: all that was tried is."""

    @property
    def is_complete(self) -> bool:
        """It has ended, and has messages, all of them, and what else was to be in it."""
        return bool(self.is_ended and self.messages and not self.dropped and not self.has_failed)

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._file.size if self._file is not None else 0

    def put(self, chunk: Chunk, compression: str) -> bool:
        """The messages of a chunk; False where they are dropped since too much waits."""
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
        """Whether so many bytes would not be dropped."""
        return self._disk.has_room(size)

    def do(self, job: Callable[[RecordingFile], None]) -> None:
        """Something else that is to be written, in its turn."""
        self._disk.do(lambda: self._do(job))

    def finish(self, losses: Mapping[str, str], name: str) -> None:
        """End it in order; `losses` are noted under `name`."""
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
            except BaseException:  # so that it can be begun again when there is room
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
        """What a disk could not write back is in the file, as far as anybody can tell, and may not be there later."""
        try:
            self._sync()
        except OSError as error:
            self.has_failed, self.problem = True, in_words(error)
            raise

    def _put(self, chunk: PackedChunk) -> None:
        """Where there is no room, as often as some can be made."""
        while True:
            try:
                self._open().put(chunk)
                return
            except OSError as error:
                if error.errno not in NO_ROOM or not self._make_room():
                    raise
                self.has_made_room = True

    def _sync(self) -> None:
        """Nothing that was written is lost when the power goes."""
        if self._stream is None:
            return
        try:
            os.fdatasync(self._stream.fileno())
        except UnsupportedOperation:  # no file of a disk
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
