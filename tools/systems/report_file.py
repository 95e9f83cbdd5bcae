"""All information needed to diagnose a problem, in one archive, without secrets.

Tokens are blanked everywhere: those in the files named by the configuration, and texts that look like one in an
address. Keys and certificates are in files of their own, which are not included.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import os
import re
import subprocess
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from trocar.procs.crtk.plain import plain
from trocar.procs.machine.paths import ROOT, log_folder, token_file
from trocar.procs.machine.version import VERSION
from trocar.procs.recordings.reading import RecordingError, open_recording
from trocar.shm.memory.parts import parts_of
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns
from trocar.tools.analysis.places import folder_of
from trocar.tools.inspect.machine import findings
from trocar.tools.inspect.processes import statuses
from trocar.tools.output.printing import Say
from trocar.tools.systems.dumping import dump
from trocar.tools.systems.find import chosen_system, forbidden

LOG_BYTES: Final = 4 << 20
"""Of each log file, its end."""
IN_ADDRESS: Final = re.compile(rb"(token=)[^\s&\"'<>]+")
BLANK: Final = b"[left out]"
SHORTEST: Final = 6
"""Shorter words are not tokens, and are not blanked."""
PATIENCE_S: Final = 10.0
PRIVATE: Final = 0o600


@dataclasses.dataclass(frozen=True, slots=True)
class Reported:
    """Packed content: names in the archive with their bytes, and the unreadable parts."""

    files: dict[str, int]
    problems: tuple[str, ...]


class Report:
    """One archive in the making."""

    def __init__(self, system: str, file: Path) -> None:
        """A new file; OSError if it cannot be made."""
        self.system, self.files, self.problems = system, dict[str, int](), list[str]()
        self._folder = file.name.removesuffix(".tar.gz")
        self._mtime = local_ns() // 1_000_000_000
        self._stream = os.fdopen(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, PRIVATE), "wb")
        self._tar = tarfile.TarFile.gzopen(None, "w", self._stream, 6)
        self.secrets: tuple[bytes, ...] = ()

    def text(self, name: str, data: bytes) -> None:
        """A file of text; tokens in it are blanked."""
        for secret in self.secrets:
            data = data.replace(secret, BLANK)
        data = IN_ADDRESS.sub(rb"\1" + BLANK, data)
        entry = self._entry(name, len(data))
        self._tar.addfile(entry, io.BytesIO(data))

    def json(self, name: str, value: Any) -> None:
        """Something as JSON, one line for each element of a list."""
        rows = value if isinstance(value, list) else [value]
        self.text(name, "".join(json.dumps(plain(row), ensure_ascii=False) + "\n" for row in rows).encode())

    def copy(self, name: str, path: Path) -> None:
        """A file as it is; data added meanwhile is left out."""
        with path.open("rb") as stream:
            self._tar.addfile(self._entry(name, os.fstat(stream.fileno()).st_size), stream)

    def _entry(self, name: str, size: int) -> tarfile.TarInfo:
        entry = tarfile.TarInfo(f"{self._folder}/{name}")
        entry.size, entry.mtime, entry.mode = size, self._mtime, 0o600
        self.files[name] = size
        return entry

    def close(self) -> None:
        """Complete the archive."""
        self._tar.close()
        self._stream.close()


def system_meant(name: str | None) -> str:
    """The system of this name, which may be long down and have logs only, else the only one up; Problem else."""
    return name if name and log_folder(os.environ, name).is_dir() and not forbidden(name) else chosen_system(name)


def report(system: str, file: Path, most: int, say: Say, also: Sequence[Path] = ()) -> Reported:
    """Pack it; `most`: bytes of recordings, the newest first; `also`: further texts. OSError if the archive cannot be
    written.
    """
    made = Report(system, file)
    try:
        document = _document(system)
        made.secrets = tuple(_secrets(system, document))
        say("checking this machine", None)
        made.json("versions.json", _versions())
        made.json("doctor.json", [dataclasses.asdict(finding) for finding in findings()])
        if document:
            made.text("configuration.json", document)
        else:
            made.problems.append("no configuration: nothing of the system is in memory, and no recording has it")
        if parts_of(system):
            made.json("status.json", [dataclasses.asdict(row) for row in statuses(system)])
        for path, name in _distinct(also):
            made.text(f"files/{name}", path.read_bytes())
        _add_logs(made, say)
        _add_recordings(made, file, most, say)
        made.text("CONTENTS.txt", _contents(made).encode())
        made.close()
    except BaseException:
        with contextlib.suppress(OSError):  # its remaining content has no room either
            made.close()
        file.unlink(missing_ok=True)
        raise
    return Reported(made.files, tuple(made.problems))


def _distinct(files: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """Files with names of their own: with as many of their folders as those of the same name need."""
    each = list({path.resolve(): path for path in files}.values())
    ends = [path.resolve().parts for path in each]
    for path, parts in zip(each, ends, strict=True):
        yield path, next("/".join(parts[-count:]).strip("/") for count in range(1, len(parts) + 1)
                         if [end[-count:] for end in ends].count(parts[-count:]) == 1)


def _contents(made: Report) -> str:
    rows = [f"{size:>12} {name}" for name, size in made.files.items()]
    return "\n".join([f"Contents of the report on system {made.system}. Tokens are left out; check the logs of",
                      "your own programs before you share this file.", "", *rows, "", *made.problems, ""])


def _versions() -> dict[str, Any]:
    known = [each.metadata for each in metadata.distributions()]  # each reads a file
    packages = sorted({f"{each['Name']}=={each['Version']}" for each in known}, key=str.lower)
    checkout = ""
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        changed = "-dirty" if _git("status", "--porcelain", "-uno") else ""
        checkout = f"{_git('describe', '--always')}{changed}"
    return {"trocar": VERSION, "checkout": checkout, "packages": packages}


def _git(*words: str) -> str:
    """State of the checkout according to git, without a lock on its index, which `describe --dirty` would take."""
    words = ("git", "--no-optional-locks", "-C", str(ROOT), *words)
    return subprocess.run(words, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S,
                          check=False).stdout.strip()


def _document(system: str) -> bytes:
    """The configuration: of the system that is, or was, in memory, else of its newest recording that has one."""
    with contextlib.suppress(SegmentError, ValueError):
        return directory.document(system)
    for path in _newest(system):
        with contextlib.suppress(RecordingError), open_recording(path) as recording:
            if found := recording.document:
                return found
    return b""


def _secrets(system: str, document: bytes) -> Iterator[bytes]:
    try:
        found = json.loads(document or b"{}")
    except ValueError:
        found = {}
    rows = [found.get(part) for part in ("socket", "gui", "foxglove")] if isinstance(found, dict) else []
    named = [row.get("token_file") for row in rows if isinstance(row, dict)]
    for path in (*filter(None, named), token_file(os.environ, system)):
        with contextlib.suppress(OSError, ValueError):
            if len(secret := Path(str(path)).read_bytes().strip()) >= SHORTEST:
                yield secret


def _add_logs(made: Report, say: Say) -> None:
    for path in sorted(log_folder(os.environ, made.system).glob("*.log")):
        say(f"packing {path.name}", None)
        try:
            with path.open("rb") as stream:
                stream.seek(max(0, os.fstat(stream.fileno()).st_size - LOG_BYTES))
                made.text(f"logs/{path.name}", stream.read(LOG_BYTES))
        except OSError as error:
            made.problems.append(f"logs/{path.name}: {error.strerror}")


def _newest(system: str) -> list[Path]:
    found = []
    for path in folder_of(system).rglob("*.mcap"):
        with contextlib.suppress(OSError):  # removed meanwhile, or unreadable
            found.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(found, reverse=True)]


def _add_recordings(made: Report, file: Path, most: int, say: Say) -> None:
    """Present memory content, and the newest recordings while there is room."""
    if parts_of(made.system):
        now = file.with_name(f".{file.name}.mcap")
        try:
            dumped = dump(made.system, now, "for a report", say, PRIVATE)
            made.problems += dumped.problems
            made.copy("recordings/now.mcap", now)
        except Exception as error:  # a crashed process may have left any content
            made.problems.append(f"recordings/now.mcap: {error or type(error).__name__}")
        finally:
            now.unlink(missing_ok=True)
    _copy_while_there_is_room(made, _newest(made.system), most, say)


def _copy_while_there_is_room(made: Report, paths: Iterable[Path], most: int, say: Say) -> None:
    for path in paths:
        try:
            with path.open("rb"):
                size = path.stat().st_size
        except FileNotFoundError:  # removed meanwhile
            continue
        except OSError as error:
            made.problems.append(f"recordings/{path.name}: {error.strerror}")
            continue
        try:
            if size > most:
                made.problems.append(f"recordings/{path.name} is left out: {size / 1e6:.0f} MB (--recordings)")
                continue
            most -= size
            say(f"packing {path.name}", None)
            made.copy(f"recordings/{path.name}", path)
        except FileNotFoundError:  # removed meanwhile
            continue
