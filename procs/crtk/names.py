"""Names that are not there, in words."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from shm.header import SegmentError


class Unknown(SegmentError):
    """There is nothing of this name; the message has the nearest ones."""


def none_such(what: str, name: str, known: Iterable[str]) -> str:
    """That there is no `name`: the nearest ones, or all when there are few."""
    names = list(known)
    near = difflib.get_close_matches(name, names, 3, 0.5) or (names if len(names) <= 8 else names[:8] + ["…"])
    return f"no {what} {name}; " + (f"near are: {', '.join(near)}" if near else "there is none at all")
