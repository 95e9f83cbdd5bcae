"""Log rotation: NAME.log is the current file, NAME.1.log the previous one, up to NAME.KEEP.log.

    python -I -S procs/machine/log_files.py FOLDER PID BYTES SECONDS KEEP

rotates the logs of a folder while its parent, PID, lives: each file that is larger than BYTES or older than SECONDS. It
is a separate process, so that neither a slow disk nor a long copy stalls others. Writers are not involved: they have
the file open for appending, so its content is copied, and then the file is truncated. Output between the last read and
the truncation (microseconds) is lost. If a file grows faster than it is checked, only the newest BYTES are kept. Only
the standard library is used, so that it starts quickly and takes little memory.
"""

from __future__ import annotations

import os
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import BinaryIO, Final

KEEP: Final = 5
"""Default number of old files for each log."""
LOOK_S: Final = 0.2
CHUNK: Final = 1 << 20


def put_aside(path: Path, keep: int = KEEP) -> None:
    """Turn a file that is no longer written into the newest of the old ones; no effect without the file."""
    if path.exists():
        _make_room(path, keep)
        if keep:
            path.replace(_old(path, 1))
        else:
            path.unlink()


def put_run_aside(folder: Path, keep: int = KEEP) -> None:
    """Turn all logs of the last run into old ones, except the file of our own output, which is part of the new run."""
    output = Path("/proc/self/fd/2")
    for path in sorted(folder.glob("*.log")):
        if not is_old(path) and not (output.exists() and output.samefile(path)):
            put_aside(path, keep)


def is_old(path: Path) -> bool:
    """Whether a log is an old one, not the current file of its process."""
    return "." in path.stem


class LogFolder:
    """The logs of a folder; call `look` regularly."""

    def __init__(self, folder: Path, most: int, seconds: float, keep: int) -> None:
        """Limits of a file: about `most` bytes, `seconds` of age, and `keep` old files for each log."""
        self._folder, self._most, self._seconds, self._keep = folder, most, seconds, keep
        self._begun: dict[str, tuple[float, int]] = {}  # begin, and the initial size, which does not count

    def look(self, now_s: float) -> None:
        """Rotate files that are too large or too old; a file that cannot be kept (full disk) is truncated anyway."""
        for path in self._folder.glob("*.log"):
            if is_old(path):
                continue
            size, (begun_s, least) = path.stat().st_size, self._begun.setdefault(path.name, (now_s, 0))
            if size > least and (size - least > self._most or now_s - begun_s > self._seconds):
                self._begun[path.name] = now_s, self._begin_anew(path)

    def _begin_anew(self, path: Path) -> int:
        """Rotate a file; returns the size of the new one, whose first line names the old one."""
        where = f"earlier entries are in {_old(path, 1).name}" if self._keep else "earlier entries were not kept"
        try:
            self._copy(path)
        except OSError as error:
            where = f"earlier entries could not be kept: {error}"
        finally:
            os.truncate(path, 0)
        line = f"{datetime.now().isoformat(' ', 'microseconds')} {time.monotonic():.6f} INFO {where}\n".encode()
        with path.open("ab", buffering=0) as file:
            file.write(line)
        return len(line)

    def _copy(self, path: Path) -> None:
        _make_room(path, self._keep)
        if not self._keep:
            return
        with path.open("rb", buffering=0) as file, _old(path, 1).open("wb", buffering=0) as copy:
            left_out = max(0, os.fstat(file.fileno()).st_size - self._most - CHUNK)
            if left_out:
                copy.write(b"%d bytes before this were too many to be kept\n" % left_out)
                file.seek(left_out)
            _append(file, copy, self._most + 2 * CHUNK)


def _append(file: BinaryIO, copy: BinaryIO, most: int) -> None:
    """Copy the rest of a file that may be growing, at most `most` bytes."""
    while most > 0 and (chunk := file.read(CHUNK)):
        copy.write(chunk)
        most -= len(chunk)


def _old(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}.{number}.log")


def _make_room(path: Path, keep: int) -> None:
    """Increment the numbers of old files; remove those beyond `keep`."""
    numbers = sorted((int(old.stem.rpartition(".")[2]) for old in path.parent.glob(f"{path.stem}.*.log")
                      if old.stem.rpartition(".")[2].isdecimal()), reverse=True)
    for number in numbers:
        if number >= keep:
            _old(path, number).unlink()
        else:
            _old(path, number).replace(_old(path, number + 1))


def main() -> None:
    """Rotate logs until the parent has ended."""
    folder, parent, most, seconds, keep = sys.argv[1:]
    logs = LogFolder(Path(folder), int(most), float(seconds), int(keep))
    while os.getppid() == int(parent):
        try:
            logs.look(time.monotonic())
        except OSError as error:  # a file was removed meanwhile
            print(f"WARNING {folder}: {error}", file=sys.stderr, flush=True)  # noqa: T201
        time.sleep(LOOK_S)


if __name__ == "__main__":
    main()
