"""Messages from browsers, see docs/gui.md: one JSON object a message. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from trocar.procs.crtk.messages import FLAG, NO_WORD, SOME_NUMBERS, VALUES, WORD, MessagePart, Ops

MAX_SOURCES: Final = 64
MAX_NAME: Final = 160
MAX_PERSON: Final = 24


def _names(value: Any) -> Any:
    if isinstance(value, list) and len(value) <= MAX_SOURCES and all(
            isinstance(name, str) and len(name) <= MAX_NAME for name in value):
        return value
    raise ValueError


def _count(value: Any) -> Any:
    if type(value) is int and 0 <= value < 1 << 53:
        return value
    raise ValueError


def _person(value: Any) -> Any:
    if isinstance(value, str) and len(value) <= MAX_PERSON and value.isprintable():
        return value.strip()
    raise ValueError


TICK: Final = MessagePart("the number of a tick", _count, 0)
"""The newest tick that the page has received; without it a request counts as old."""
SINCE: Final = MessagePart("the number of a tick", _count, 0)
"""The tick at which a person pressed for a sequence of which this is a step; 0: just now."""
PERSON: Final = MessagePart(f"a name of up to {MAX_PERSON} characters", _person, "")
"""The operator's name, which the other pages show; by default the browser's address and port."""
SOURCES: Final = MessagePart(f"a list of up to {MAX_SOURCES} names", _names)
MOMENT: Final = MessagePart("a time of day, ms", _count, 0)
OPS: Final[Ops] = {
    "want": {"sources": SOURCES},
    "beat": {"tick": TICK},
    "control": {"take": FLAG, "over": replace(FLAG, default=False), "person": PERSON, "from": PERSON},
    "past": {"at": MOMENT, "from": MOMENT, "to": MOMENT, "points": MessagePart("a number of samples", _count, 0),
             "sources": SOURCES},
    "preview": {"arm": WORD, "position": SOME_NUMBERS, "pose": SOME_NUMBERS},
    "jog": {"arm": WORD, "twist": SOME_NUMBERS, "in_tip": replace(FLAG, default=False),
            "tick": TICK},
    "call": {"to": WORD, "command": WORD, "values": VALUES, "text": NO_WORD, "tick": TICK,
             "since": SINCE},
}
