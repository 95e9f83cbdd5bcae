"""Messages for unknown names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Final

from trocar.shm.memory.header import SegmentError


class Unknown(SegmentError):
    """An unknown name; the message suggests similar ones."""


ROOM: Final = 200
"""Characters for a list of names."""


def none_such(what: str, name: str, known: Iterable[str], owner: str = "", meant: Iterable[str] = ()) -> str:
    """The message that there is no `name`, or that `owner` has none, with similar names, or all if they are few.

    `meant`: names that are suggested first, although they are not similar.
    """
    names = list(known)
    said = f"{owner} has no {what} {name}" if owner else f"no {what} {name}"
    if near := dict.fromkeys((*meant, *difflib.get_close_matches(str(name), names, 3, 0.5))):
        return f"{said}; did you mean {', '.join(near)}?"
    there = names if len(names) <= 8 or len(", ".join(names)) <= ROOM else [*names[:8], "…"]
    return f"{said}; " + (f"there are: {', '.join(there)}" if there else "there are none")
