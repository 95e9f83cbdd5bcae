"""Users' processes as declared in the system file: topics, commands and properties."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

BYTES: Final = {"float": 8, "float32": 4, "int": 8, "int32": 4, "uint8": 1, "uint16": 2, "bool": 1, "text": 1}
"""Names of types, and the size of an element in bytes."""
TYPE: Final = rf"^({'|'.join(BYTES)})(\[[1-9][0-9]{{0,5}}(,[1-9][0-9]{{0,5}})?\])?$"
SET_PROPERTY: Final = "set_property"
SAVE_PROPERTIES: Final = "save_properties"
PROPERTIES: Final = "properties"
"""The topic with the present values of the properties."""


@dataclass(frozen=True, slots=True)
class UserField:
    """A field of a topic or an argument of a command; types are float, int, bool, text…, or arrays like `float[6]`."""

    name: str
    type: str
    unit: str = ""
    text: str = ""


@dataclass(frozen=True, slots=True)
class UserTopic:
    """A topic of a user's process; the ring keeps `depth` records."""

    name: str
    rate_hz: float
    depth: int
    fields: tuple[UserField, ...]


@dataclass(frozen=True, slots=True)
class UserCommand:
    """A command that a user's process executes.

    `effect`: the worst possible effect (shm/mailbox/command_row.py), direct or by commands to others; from "relax" on
    it needs an operator's command, whose origin is passed on. `stops`: it ends something; `latest`: of several waiting
    ones only the newest is executed.
    """

    name: str
    arguments: tuple[UserField, ...] = ()
    text: str = ""
    effect: str = "motion"
    stops: bool = False
    latest: bool = False


@dataclass(frozen=True, slots=True)
class Property:
    """A value that can be read and set at run time; `type` is float, int, bool, or text: `text[24]` has 24 bytes."""

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
        """Whether it is a text, not a number."""
        return self.type.startswith("text")

    def objection(self, value: float | str) -> str:
        """Why it cannot have this value; empty if it can."""
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
    """One user's process; `module` is the path of a .py file, or the name of an installed module.

    `host`: the process that calls its update together with others; "" for a process of its own.
    """

    name: str
    module: str
    period_s: float
    topics: tuple[UserTopic, ...] = ()
    commands: tuple[UserCommand, ...] = ()
    properties: tuple[Property, ...] = ()
    host: str = ""


def shape_of(word: str) -> tuple[str, tuple[int, ...]]:
    """The element type and the shape; ValueError when `word` is not a type."""
    match = re.match(TYPE, word)
    if match is None:
        raise ValueError(f"{word!r} is no type")
    return match[1], tuple(int(n) for n in match[2][1:-1].split(",")) if match[2] else ()


def size_of(word: str) -> int:
    """Size of a type in bytes."""
    bare, shape = shape_of(word)
    return BYTES[bare] * math.prod(shape)
