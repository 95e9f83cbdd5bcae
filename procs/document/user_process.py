"""Processes of one's own as the system file declares them: their topics, commands and properties."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

BYTES: Final = {"float": 8, "float32": 4, "int": 8, "int32": 4, "uint8": 1, "uint16": 2, "bool": 1, "text": 1}
"""Words for types, and what one of each takes."""
TYPE: Final = rf"^({'|'.join(BYTES)})(\[[1-9][0-9]{{0,5}}(,[1-9][0-9]{{0,5}})?\])?$"
SET_PROPERTY: Final = "set_property"
SAVE_PROPERTIES: Final = "save_properties"
PROPERTIES: Final = "properties"
"""The topic that has the values in use."""


@dataclass(frozen=True, slots=True)
class UserField:
    """A field of a topic or an argument of a command: float, int, bool, text and others, `float[6]`: six of them."""

    name: str
    type: str
    unit: str = ""
    text: str = ""


@dataclass(frozen=True, slots=True)
class UserTopic:
    """A topic of its own; `depth` records are kept."""

    name: str
    rate_hz: float
    depth: int
    fields: tuple[UserField, ...]


@dataclass(frozen=True, slots=True)
class UserCommand:
    """A command that it carries out.

    `effect`: the worst that it can do (shm/mailbox/command_row.py), by itself or by what it asks others for; from
    "relax" on it needs an operator's command, whose origin is passed on. `stops`: it ends something; `latest`: of
    several that wait only the newest counts.
    """

    name: str
    arguments: tuple[UserField, ...] = ()
    text: str = ""
    effect: str = "motion"
    stops: bool = False
    latest: bool = False


@dataclass(frozen=True, slots=True)
class Property:
    """What can be read and set while it runs; `type` is float, int or bool, or `text[24]`: so many bytes at most."""

    name: str
    type: str
    default: float = 0.0
    lower: float | None = None
    upper: float | None = None
    unit: str = ""
    text: str = ""
    words: str = ""  # the default of a text

    @property
    def first(self) -> float | str:
        """Its value until it is set."""
        return self.words if self.is_text else self.default

    @property
    def is_text(self) -> bool:
        """It has no number, but a text."""
        return self.type.startswith("text")

    def objection(self, value: float | str) -> str:
        """Why it cannot have this value; empty: it can."""
        if isinstance(value, str) or self.is_text:
            if not (isinstance(value, str) and self.is_text):
                return f"{self.name}: {value!r} is no {self.type}"
            most = size_of(self.type)
            is_fit = len(value.encode()) <= most and value.isprintable()
            return "" if is_fit else f"{self.name}: {value!r} is not printable, or longer than {most} bytes"
        if not math.isfinite(value) or (self.type != "float" and value != int(value)):
            return f"{self.name}: {value:g} is no {self.type}"
        lower, upper = (0.0, 1.0) if self.type == "bool" else (self.lower, self.upper)
        if (lower is not None and value < lower) or (upper is not None and value > upper):
            above = f"from {lower:g}" if lower is not None else ""
            below = f"up to {upper:g}" if upper is not None else ""
            return f"{self.name}: {value:g} is out of range; allowed are {above} {below} {self.unit}".rstrip()
        return ""


@dataclass(frozen=True, slots=True)
class UserProcess:
    """One process; `module` is the path of a .py file, or the name of an installed module.

    `host`: the process that calls its update together with those of others; "": it is a process itself.
    """

    name: str
    module: str
    period_s: float
    topics: tuple[UserTopic, ...] = ()
    commands: tuple[UserCommand, ...] = ()
    properties: tuple[Property, ...] = ()
    host: str = ""


def shape_of(word: str) -> tuple[str, tuple[int, ...]]:
    """The bare type and its shape; ValueError when it is none."""
    match = re.match(TYPE, word)
    if match is None:
        raise ValueError(f"{word!r} is no type")
    return match[1], tuple(int(n) for n in match[2][1:-1].split(",")) if match[2] else ()


def size_of(word: str) -> int:
    """Bytes in a record."""
    bare, shape = shape_of(word)
    return BYTES[bare] * math.prod(shape)
