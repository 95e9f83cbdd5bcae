"""Writing to the disk, in a thread of its own: one that is slow or full holds up nobody.

What it cannot take is dropped. So many bytes may wait for it, no more. Compressing is done here, too: zstd and lz4 let
others run meanwhile.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO, Final

from procs.recordings.chunks import Chunk, packed
from procs.recordings.writing import ChannelTable, RecordingFile

MAX_WAITING: Final = 48 << 20
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
            except OSError as error:
                self.problem = f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"
            except Exception as error:  # what comes next may well be written
                self.problem = f"{type(error).__name__}: {error}"
            with self._lock:
                self.waiting -= size

    def close(self, seconds: float) -> bool:
        """Do what waits; False: it takes longer than so many seconds, and is left."""
        self._jobs.put((None, 0))
        self._thread.join(seconds)
        return not self._thread.is_alive()


class DiskFile:
    """One recording on its way to the disk, whose thread writes it, until it `is_ended`."""

    def __init__(self, disk: Disk, path: Path, table: ChannelTable, metadata: Mapping[str, Mapping[str, str]],
                 attachments: Sequence[tuple[str, str, bytes]], created_ns: int, opened: Open = open_new) -> None:
        self.path, self._disk, self._table = path, disk, table
        self._begin = metadata, attachments, created_ns
        self._opened = opened
        self._stream: BinaryIO | None = None
        self._file: RecordingFile | None = None
        self.dropped = self.messages = 0
        """Messages that are not in it, and those that are or will be."""
        self.is_ended = False
        self.has_failed = False
        """Something else than messages is not in it: what was copied, or its end."""

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
        except Exception:
            self.has_failed = True
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
            self._open().put(packed(chunk, compression))
            self._sync()
        except Exception:
            self.dropped += chunk.count
            self.messages -= chunk.count
            raise
        self._disk.problem = ""

    def _sync(self) -> None:
        """Nothing that was written is lost when the power goes."""
        if self._stream is not None:
            try:
                os.fdatasync(self._stream.fileno())
            except (OSError, ValueError):  # no file of a disk
                return

    def _end(self, losses: Mapping[str, str], name: str) -> None:
        try:
            if self._file is not None:
                self._file.note(name, {**losses, "dropped": str(self.dropped)})
                self._file.finish()
                self._sync()
        except Exception:
            self.has_failed = True
            raise
        finally:
            self.is_ended = True
            if self._stream is not None:
                self._stream.close()
