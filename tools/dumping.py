"""Keeping what a system has in shared memory as a recording: on demand, and before what a dead one left is removed."""

from __future__ import annotations

import dataclasses
import json
from datetime import datetime
from pathlib import Path
from typing import Final

from procs.crtk.plain import plain
from shm.segment import names_of
from tools.errors import Problem
from tools.printing import Say, note, progress
from tools.recorded.places import folder_of
from tools.running import SUPERVISOR
from tools.systems import forbidden, is_up

KEPT: Final = 5
"""Recordings of dead systems that are kept, the newest ones."""
STATUS: Final = "status.json"
"""Attachment: all processes as `trocar status --json` shows them."""


@dataclasses.dataclass(frozen=True, slots=True)
class Dumped:
    """A file that was written: its topics with the number of their records, and what could not be read."""

    file: Path
    bytes: int
    records: dict[str, int]
    problems: tuple[str, ...]


def dump_file(system: str) -> Path:
    """Where a dump of a system goes that nobody names: its recordings, with the time of day."""
    return folder_of(system) / f"dump-{datetime.now():%Y%m%d-%H%M%S}.mcap"


def dump(system: str, file: Path, reason: str, say: Say) -> Dumped:
    """Write all rings of a system, dead or alive, into a new file; Problem where that cannot be."""
    from procs.recordings import names, snapshot  # only who records pays for them
    from procs.recordings.facts import document_of, facts_of
    from tools.inspect.processes import statuses

    status = json.dumps([plain(dataclasses.asdict(row)) for row in statuses(system)]).encode()
    attachments = [*document_of(system), (STATUS, "application/json", status)]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("xb", buffering=0) as stream:
            try:
                taken = snapshot.take(system, stream, facts_of(system, names.DUMP, file.stem, reason), attachments,
                                      lambda done: say(f"writing {file.name}", done))
            except BaseException:
                file.unlink(missing_ok=True)
                raise
    except FileExistsError:
        raise Problem(f"{file}: is there already; give another name") from None
    except OSError as error:
        raise Problem(f"{file}: cannot be written: {error.strerror}") from None
    return Dumped(file, taken.bytes, taken.records, tuple(taken.problems))


def keep_left_over(system: str) -> Path | None:
    """Dump what a dead system left before it is removed, and say where; None: there is nothing, or no room for it."""
    if (system, SUPERVISOR, "document") not in names_of(system) or is_up(system) or forbidden(system):
        return None
    with progress(f"keeping what {system} left") as say:
        try:
            kept = dump(system, dump_file(system), "its supervisor died", say)
        except Problem as problem:
            note(f"what {system} left in shared memory is not kept: {problem}")
            return None
    for old in sorted(kept.file.parent.glob("dump-*.mcap"))[:-KEPT]:
        old.unlink(missing_ok=True)
    note(f"system {system} had died; what its rings held is kept in {kept.file}")
    return kept.file
