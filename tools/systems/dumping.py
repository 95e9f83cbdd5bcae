"""Saving a system's shared memory as a recording: on demand, and before the remains of a crashed one are removed."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
from pathlib import Path
from typing import Final

from trocar.procs.crtk.plain import plain
from trocar.procs.machine.paths import log_folder, made_log_folder
from trocar.procs.recordings import names
from trocar.shm.memory.parts import removed_words
from trocar.shm.memory.segment import names_of
from trocar.shm.time.clock import local_ns
from trocar.tools.analysis.places import folder_of
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say, note
from trocar.tools.systems.find import forbidden, is_up
from trocar.tools.systems.processes import SUPERVISOR

KEPT: Final = 5
"""Maximum number of recordings of crashed systems kept, the newest ones."""
STATUS: Final = "status.json"
"""Attachment: all processes as `trocar status --json` shows them."""


TRIES: Final = 100


class FileIsThere(Problem):
    """A file of this name is there already."""


@dataclasses.dataclass(frozen=True, slots=True)
class Dumped:
    """A written file: its topics with the number of their records, and the unreadable parts."""

    file: Path
    bytes: int
    records: dict[str, int]
    problems: tuple[str, ...]


def dump(system: str, file: Path, reason: str, say: Say, mode: int = 0o666) -> Dumped:
    """Write all rings of a running or crashed system into a new file (of this mode); Problem if that fails."""
    from trocar.procs.recordings import snapshot  # imported only where recordings are written
    from trocar.procs.recordings.facts import document_of, facts_of

    status, problems = _status(system)
    if removed := removed_words(system):
        problems.append(removed)
    attachments = [*document_of(system), *status]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, mode)
        with os.fdopen(descriptor, "wb", buffering=0) as stream:
            try:
                taken = snapshot.take(system, stream, facts_of(system, names.DUMP, file.stem, reason), attachments,
                                      lambda done: say(f"writing {file.name}", done))
            except BaseException:
                file.unlink(missing_ok=True)
                raise
    except FileExistsError:
        raise FileIsThere(f"{file}: is there already; give another name") from None
    except OSError as error:
        raise Problem(f"{file}: cannot be written: {error.strerror}") from None
    return Dumped(file, taken.bytes, taken.records, (*problems, *taken.problems))


def _status(system: str) -> tuple[list[tuple[str, str, bytes]], list[str]]:
    """All processes as an attachment, or the error."""
    from trocar.tools.inspect.processes import statuses

    try:
        rows = [plain(dataclasses.asdict(row)) for row in statuses(system)]
        return [(STATUS, "application/json", json.dumps(rows).encode())], []
    except Exception as error:  # a crashed process may have left any content
        return [], [f"{STATUS}: {error or type(error).__name__}"]


def dump_by_time(system: str, word: str, reason: str, say: Say) -> Dumped:
    """The same into a file among the system's recordings, WORD-TIME.mcap, or WORD-TIME-2.mcap if that exists."""
    folder, time = folder_of(system), names.utc(local_ns())
    if folder.is_relative_to(log_folder(os.environ, system)):
        made_log_folder(os.environ, system)
    for number in range(1, TRIES):
        with contextlib.suppress(FileIsThere):
            return dump(system, folder / f"{word}-{time}{f'-{number}' if number > 1 else ''}.mcap", reason, say)
    raise Problem(f"{folder}: cannot choose a file name: {TRIES} files {word}-{time} exist")


def keep_left_over(system: str, say: Say) -> Path | None:
    """Dump the remains of a crashed system before their removal, and report the file; None: none, or not possible.

    Damaged content never stops the removal: unreadable parts are reported.
    """
    try:
        if (system, SUPERVISOR, "document") not in names_of(system) or is_up(system) or forbidden(system):
            return None
        kept = dump_by_time(system, names.DIED, "its supervisor died", say)
        remove_older(kept.file)
    except Exception as error:
        note(f"the shared memory left by {system} was not saved: {error or type(error).__name__}")
        return None
    for problem in kept.problems:
        note(problem)
    note(f"system {system} had crashed; its rings were saved to {kept.file}")
    return kept.file


def remove_older(file: Path) -> None:
    """Of the dumps of crashed systems beside `file` the newest stay, including `file`; no other file is touched."""
    ours = re.compile(rf"{names.DIED}-({names.TIME})(?:-(\d+))?\.mcap")
    found = [(match[1], int(match[2] or 1), path) for path in file.parent.iterdir()
             if path != file and (match := ours.fullmatch(path.name))]
    for _, _, old in sorted(found)[: -(KEPT - 1)]:
        old.unlink(missing_ok=True)
