"""The segments of a system: those on the list in its document, and those found in /dev/shm."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.names import FOLDER, NAME
from trocar.shm.memory.segment import Segment, names_of, segment_name, unlink

NAMED = 12
LISTENS = r"^\S+ \S+ \S+ 00010000 "
"""Of a row of /proc/net/unix: the flags of a socket that listens, as that of a supervisor does from then on."""
LIST = "segments"
"""Key in the header of the document: `<instance>~<what>` of each segment but the document."""


def remove_all(system: str) -> int:
    """Remove every segment of a system, first the document, whose list says which exist; returns their number."""
    names = names_of(system)
    for parts in sorted(names, key=lambda parts: parts[2] != "document"):
        unlink(segment_name(*parts))
    return len(names)


def parts_of(system: str) -> list[tuple[str, str, str]]:
    """All segments of a system as (system, instance, what), also those whose names were removed; sorted."""
    return sorted({*names_of(system), *_listed(system)})


def removed_words(system: str) -> str:
    """The segments on a system's list that are not in /dev/shm, in words; empty: none."""
    lost, listed = removed_of(system), _listed(system)  # while it starts or stops, one may be empty
    return in_words([f"{instance}~{what}" for _, instance, what in lost], len(listed)) if lost and listed else ""


def in_words(removed: Sequence[str], count: int) -> str:
    """What has been removed of `count` segments."""
    named = ", ".join(removed[:NAMED]) + (f" and {len(removed) - NAMED} more" if len(removed) > NAMED else "")
    return f"{len(removed)} of {count} segments were removed from {FOLDER}: {named}"


def removed_of(system: str) -> list[tuple[str, str, str]]:
    """The segments on a system's list that are not in /dev/shm; sorted."""
    return sorted(_listed(system) - set(names_of(system)))


def _listed(system: str) -> set[tuple[str, str, str]]:
    try:
        with Segment(segment_name(system, "supervisor", "document")) as document:
            listed = document.header.info.get(LIST)
    except SegmentError:
        return set()
    pairs = [str(each).split("~") for each in listed] if isinstance(listed, list) else []
    found = {(system, pair[0], pair[1]) for pair in pairs if len(pair) == 2 and all(map(NAME.fullmatch, pair))}
    return found | {(system, "supervisor", "document")} if found else found


def held_names() -> list[str]:
    """Systems with a supervisor, of any user, that has published its document, whatever is in /dev/shm; sorted."""
    try:
        held = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    return sorted(set(re.findall(rf"{LISTENS}.* @trocar~({NAME.pattern})$", held, re.MULTILINE)))
