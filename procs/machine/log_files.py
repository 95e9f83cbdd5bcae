"""Log files: NAME.log is written, NAME.1.log is the one before it, up to so many.

    python -I -S procs/machine/log_files.py FOLDER PID BYTES SECONDS KEEP

looks after the logs of a folder for as long as its parent, PID, lives: one that is larger or older begins anew. It is a
process of its own so that neither a slow disk nor a long copy holds anybody up. Those who write know nothing of it:
they have the file open for appending, so what was in it is copied, and the file emptied under them. What is written
between the last look at its end and that (microseconds) is lost. Of a file that grows faster than it is looked at only
the newest BYTES are kept. The standard library alone: it starts quickly, and takes little memory.
"""

from __future__ import annotations

import os
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import BinaryIO, Final

KEEP: Final = 5
"""Old files of each, where nothing else is said."""
LOOK_S: Final = 0.2
CHUNK: Final = 1 << 20


def put_aside(path: Path, keep: int = KEEP) -> None:
    """A file that nobody writes any more becomes the newest of the old ones; nothing where there is none."""
    if path.exists():
        _make_room(path, keep)
        if keep:
            path.replace(_old(path, 1))
        else:
            path.unlink()


def put_run_aside(folder: Path, keep: int = KEEP) -> None:
    """All logs of the last run become old ones; the file that our own output goes to belongs to the run that begins."""
    output = Path("/proc/self/fd/2")
    for path in sorted(folder.glob("*.log")):
        if not is_old(path) and not (output.exists() and output.samefile(path)):
            put_aside(path, keep)


def is_old(path: Path) -> bool:
    """Whether it is not what its process writes now."""
    return "." in path.stem


class LogFolder:
    """The logs of a folder; `look` at them now and then."""

    def __init__(self, folder: Path, most: int, seconds: float, keep: int) -> None:
        """A file has `most` bytes about, is `seconds` old at most, and `keep` old ones are kept of each."""
        self._folder, self._most, self._seconds, self._keep = folder, most, seconds, keep
        self._begun: dict[str, tuple[float, int]] = {}  # when, and with how much in it that does not count

    def look(self, now_s: float) -> None:
        """Let begin anew what is too large or too old; what cannot be kept (a full disk) is emptied all the same."""
        for path in self._folder.glob("*.log"):
            if is_old(path):
                continue
            size, (begun_s, least) = path.stat().st_size, self._begun.setdefault(path.name, (now_s, 0))
            if size > least and (size - least > self._most or now_s - begun_s > self._seconds):
                self._begun[path.name] = now_s, self._begin_anew(path)

    def _begin_anew(self, path: Path) -> int:
        """Returns the size of the new file, which says where the old one is."""
        where = f"what was before is in {_old(path, 1).name}" if self._keep else "what was before is not kept"
        try:
            self._copy(path)
        except OSError as error:
            where = f"what was before could not be kept: {error}"
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
    """What is left of a file that may grow meanwhile, so many bytes at most."""
    while most > 0 and (chunk := file.read(CHUNK)):
        copy.write(chunk)
        most -= len(chunk)


def _old(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}.{number}.log")


def _make_room(path: Path, keep: int) -> None:
    """The old ones move up by one; what is beyond `keep` then is removed."""
    numbers = sorted((int(old.stem.rpartition(".")[2]) for old in path.parent.glob(f"{path.stem}.*.log")
                      if old.stem.rpartition(".")[2].isdecimal()), reverse=True)
    for number in numbers:
        if number >= keep:
            _old(path, number).unlink()
        else:
            _old(path, number).replace(_old(path, number + 1))


def main() -> None:
    """Until the parent has ended."""
    folder, parent, most, seconds, keep = sys.argv[1:]
    logs = LogFolder(Path(folder), int(most), float(seconds), int(keep))
    while os.getppid() == int(parent):
        try:
            logs.look(time.monotonic())
        except OSError as error:  # somebody removed what we looked at
            print(f"WARNING {folder}: {error}", file=sys.stderr, flush=True)  # noqa: T201
        time.sleep(LOOK_S)


if __name__ == "__main__":
    main()
