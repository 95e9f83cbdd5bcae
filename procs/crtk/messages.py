"""Clients' messages as JSON: one object each, checked part by part. Pure functions."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from trocar.procs.crtk.names import none_such

MAX_BYTES: Final = 65536
"""Maximum size of a message."""
MAX_ID: Final = 64
MAX_VALUES: Final = 64


class WrongMessage(Exception):
    """A message that is answered with an error; the text is the reason."""

    def __init__(self, reason: str, number: object = None) -> None:
        """`number`: the message's `id`."""
        super().__init__(reason)
        self.id = number


class NoMessage(WrongMessage):
    """Not a message at all: perhaps another protocol."""


@dataclass(frozen=True, slots=True)
class Message:
    """A checked message with all its parts."""

    op: str
    id: Any
    parts: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class MessagePart:
    """A part of a message: its expected value in words, and a check that returns it; default None: required."""

    what: str
    check: Callable[[Any], Any]
    default: Any = None


def _text(value: Any) -> Any:
    if isinstance(value, str) and len(value) <= 256:
        return value
    raise ValueError


def _flag(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    raise ValueError


def _any_number(value: Any) -> float:
    """A number, or NaN for `null`; otherwise ValueError."""
    if value is None:
        return math.nan
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    raise ValueError


def a_number(value: Any) -> float:
    """A finite number; otherwise ValueError."""
    if not math.isfinite(found := _any_number(value)):
        raise ValueError
    return found


def _numbers(value: Any, number: Callable[[Any], float] = a_number) -> list[float]:
    if not isinstance(value, list) or len(value) > MAX_VALUES:
        raise ValueError
    return [number(item) for item in value]


TEXT: Final = "a text of up to 256 characters"
NUMBERS: Final = f"a list of up to {MAX_VALUES} numbers"
WORD: Final = MessagePart(TEXT, _text)
NO_WORD: Final = MessagePart(TEXT, _text, "")
SOME_NUMBERS: Final = MessagePart(NUMBERS, _numbers, ())
FLAG: Final = MessagePart("true or false", _flag)
VALUE: Final = MessagePart("a number", _any_number)
VALUES: Final = MessagePart(NUMBERS, partial(_numbers, number=_any_number), ())
"""Arguments of a command: the receiving process refuses values that are not finite, and records that in its audit."""
Ops = Mapping[str, Mapping[str, MessagePart]]


def parsed(data: bytes | str, ops: Ops) -> Message:
    """Parse a message, whose op and parts must be in `ops`; WrongMessage has the reason."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise NoMessage(f"this is no JSON: {error}"[:200]) from None
    if not isinstance(found, dict):
        raise NoMessage("a message is an object: {\"op\": \"list\"}")
    number = found.pop("id", None)
    if not (number is None or (isinstance(number, str) and len(number) <= MAX_ID)
            or (type(number) is int and abs(number) < 1 << 53)):
        raise WrongMessage(f"id has to be a whole number, or a text of up to {MAX_ID} characters")
    op = found.pop("op", None)
    if not isinstance(op, str) or op not in ops:
        raise WrongMessage(none_such("op", str(op)[:40], ops), number)
    known = ops[op]
    for name in found:
        if name not in known:
            raise WrongMessage(f"{op}: {none_such('part', name[:40], known)}", number)
    return Message(op, number, {name: _part(op, number, name, part, found) for name, part in known.items()})


def _part(op: str, number: Any, name: str, part: MessagePart, found: Mapping[str, Any]) -> Any:
    if name not in found:
        if part.default is None:
            raise WrongMessage(f"{op}: {name} is missing: {part.what}", number)
        return part.default
    try:
        return part.check(found[name])
    except (ValueError, OverflowError):
        raise WrongMessage(f"{op}: {name} has to be {part.what}", number) from None


def said(op: str, number: Any = None, **parts: Any) -> bytes:
    """A message to a client."""
    head = {"op": op} if number is None else {"op": op, "id": number}
    return json.dumps(head | parts, allow_nan=False, separators=(",", ":")).encode()
