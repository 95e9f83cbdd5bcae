"""Messages from clients: one JSON object a message, see docs/socket.md. Pure: same bytes, same result."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from trocar.procs.crtk.messages import FLAG, NO_WORD, VALUE, VALUES, WORD, MessagePart, Ops, a_number

MAX_RATE_HZ: Final = 1000.0
MIN_RATE_HZ: Final = 0.01


def _name(value: Any) -> Any:
    if isinstance(value, str) and 1 <= len(value) <= 16 and value.isascii() and value.isprintable():
        return value
    raise ValueError


def _rate(value: Any) -> float:
    rate = a_number(value)
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise ValueError
    return rate


RATE: Final = f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}"
OPS: Final[Ops] = {
    "hello": {"token": NO_WORD,
              "name": MessagePart("1 to 16 printable characters", _name, "socket")},
    "ping": {},
    "list": {},
    "commands": {"of": WORD},
    "read": {"topic": WORD},
    "subscribe": {"topic": WORD, "rate_hz": MessagePart(RATE, _rate, 10.0),
                  "last": replace(FLAG, default=True)},
    "unsubscribe": {"topic": WORD},
    "call": {"to": WORD, "command": WORD, "values": VALUES, "text": NO_WORD},
    "get": {"of": WORD},
    "set": {"of": WORD, "property": WORD, "value": VALUE},
}
