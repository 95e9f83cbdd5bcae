"""Everything there is to know about a command is in one row, from which everything else is derived.

Derived from it: the mailbox (authority, lateness, what a stop voids), bridges and the web console (`may_power`, which
commands need control), clients (arguments, help), ROS (topics and messages), audit, replay, docs/commands.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Numbers = Sequence[float] | NDArray[np.float64]


class Effect(IntEnum):
    """The worst that a command can do, in this order."""

    READ = 0
    """It answers."""
    SETTING = 1
    """It changes a behaviour, or makes it safer."""
    FREE = 2
    """It takes efforts away: an arm may go limp."""
    RELAX = 3
    """It takes a protection away."""
    RELEASE = 4
    """It releases a brake."""
    MOTION = 5
    """Something moves."""
    POWER = 6
    """Something is powered, homed, or gets or loses its controller."""


READ, SETTING, FREE, RELAX, RELEASE, MOTION, POWER = Effect

JOINTS: Final = -1
"""Size: as many numbers as the arm has joints."""
MAX_NUMBERS: Final = 64
SOME: Final = -2
"""Size: any number of numbers; only the last argument."""
ARGUMENT: Final = ("name", "unit", "size", "low", "high", "optional", "whole", "above")
ANY: Final = "*"
"""In `stops`: with any text and values."""
ITSELF: Final = "="
"""In `ended_by`: the same command, with zeros."""
ZERO: Final = "=0"
"""In `stops`: with values that are all 0."""
ANYTHING: Final = 1e9
"""No quantity of a robot is larger: a larger number is a mistake."""
SQUARED: Final = ANYTHING**2
EVERYTHING: Final = "*.*"
"""In `causes`: every command of every kind."""


@dataclass(frozen=True, slots=True)
class Argument:
    """Numbers of a command: `size` of them in [low, high], in ]low, high] if `above`; optional ones are last."""

    name: str
    unit: str = ""
    size: int = 1
    low: float = -ANYTHING
    high: float = ANYTHING
    optional: bool = False
    whole: bool = False
    above: bool = False

    @property
    def takes(self) -> str:
        """Its name with size, unit and bounds, as help and docs show it."""
        size = {1: "", JOINTS: " {n}", SOME: " …"}.get(self.size, f" ({self.size})")
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.name}{size}{unit}{self.allowed}"

    @property
    def is_bounded(self) -> bool:
        """Whether not every finite number will do."""
        return self.low > -ANYTHING or self.high < ANYTHING or self.whole

    @property
    def allowed(self) -> str:
        """Its bounds, with a blank in front; empty: any finite number."""
        if self.whole and (self.low, self.high) == (0.0, 1.0):
            return " 0|1"
        if not self.is_bounded:
            return ""
        if self.low <= -ANYTHING:
            return " whole" if self.high >= ANYTHING else f" <= {self.high:.9g}"
        if self.high >= ANYTHING:
            return f" {'>' if self.above else '>='} {self.low:.9g}"
        return f" {']' if self.above else '['}{self.low:.9g}, {self.high:.9g}]"

    def admits(self, value: float) -> bool:
        """Whether one number is finite and within the bounds; NaN is not."""
        if not (math.isfinite(value) and self.low <= value <= self.high):
            return False
        return not (self.above and value == self.low) and not (self.whole and value != int(value))


@dataclass(frozen=True, slots=True)
class Ros:
    """ROS topics of a command, behind the instance's name, and what their messages contain: see
    procs/ros_messages/command_messages.py.

    `topics`, default the command's name: {part} is replaced by each setup arm or robot. `kind`: kind of the topics'
    owner if that is another process.
    """

    message: str
    topics: tuple[str, ...] = ()
    kind: str = ""
    newest: bool = False
    """Of several messages that wait only the newest counts."""


@dataclass(frozen=True, slots=True)
class CommandRow:
    """One command: name (CRTK where there is one), its worst possible effect, one sentence, arguments, text.

    `effect_of_zero`, `effect_of_one`, `effect_of_words`: its effect where that is less, because its values are all 0
    (or absent), or all 1, or because of its text. `stops`: the texts with which it stops something, ANY or ZERO.
    `stream`: the stream it is part of, which ends when its sender is silent. `move`: accepted at once, done on arrival.
    `ended_by`: the command that ends it when the client that holds it is gone, or ITSELF. `causes`: commands
    ("kind.name", "kind.*") that the process issues because of it. `types`: arm types that have it (for a teleoperation:
    types of its slave), empty: all. `latest`: if several wait, only the newest counts.
    """

    name: str
    effect: Effect
    doc: str
    arguments: tuple[Argument, ...] = ()
    text: str = ""
    effect_of_zero: Effect | None = None
    effect_of_one: Effect | None = None
    effect_of_words: Mapping[str, Effect] = field(default_factory=dict, hash=False)
    stops: tuple[str, ...] = ()
    stream: str = ""
    move: bool = False
    ended_by: str = ""
    causes: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    latest: bool = False
    ros: Ros | None = None
    _known: dict[tuple[int | None, int], bool] = field(default_factory=dict, init=False, repr=False, compare=False)
    """For a number of joints and a valid number of values: whether every finite value is valid."""

    def is_stop(self, text: str, values: Numbers) -> bool:
        """Whether it stops something and starts nothing."""
        stops = self.stops
        return ANY in stops or text in stops or (ZERO in stops and not any(values))

    def effect_for(self, text: str, values: Numbers) -> Effect:
        """Its effect with this text and these numbers; a stop counts as a setting."""
        if self.is_stop(text, values):
            return SETTING
        if text in self.effect_of_words:
            return self.effect_of_words[text]
        if self.effect_of_zero is not None and not any(values):
            return self.effect_of_zero
        if self.effect_of_one is not None and len(values) and all(value == 1.0 for value in values):
            return self.effect_of_one
        return self.effect

    def needs_operator(self, text: str, values: Numbers) -> bool:
        """Whether it requires an operator's command given since the last fault."""
        return self.effect_for(text, values) >= RELAX

    def expires(self, text: str, values: Numbers) -> bool:
        """Whether it is refused if late, or if a stop was sent after it."""
        return self.effect_for(text, values) >= FREE

    def about(self, text: str) -> str:
        """The part of the instance concerned, the first word of its text; empty: all of it."""
        return "" if not self.text or text in self.stops else text.partition(" ")[0]

    @property
    def takes(self) -> str:
        """Its numbers in words."""
        return ", ".join(f"{each.takes} or none" if each.optional else each.takes for each in self.arguments)

    def objection(self, values: Numbers, joints: int | None = None) -> str:
        """Why these numbers are invalid, "": they are valid. `joints`: of the arm; None: unknown, any number fits."""
        count = len(values)
        is_free = self._known.get((joints, count))
        if is_free is None:
            if count not in self._sizes(joints):
                return f"takes {self._wanted(joints)}; {f'{count} given' if count else 'none was given'}"
            is_free = self._known[joints, count] = self._is_free(joints, count)
        if is_free and isinstance(values, np.ndarray) and values.dot(values) < SQUARED:
            return ""
        at = 0
        for argument in self.arguments:
            size = self._size(argument, joints, count)
            for value in values[at : at + size]:
                if not argument.admits(float(value)):
                    return f"{argument.name} {float(value):.9g}; allowed:{argument.allowed or ' finite numbers'}"
            at += size
        return ""

    @staticmethod
    def _size(argument: Argument, joints: int | None, count: int) -> int:
        """How many of `count` numbers an argument may have."""
        return {JOINTS: joints or count, SOME: count}.get(argument.size, argument.size)

    def _is_free(self, joints: int | None, count: int) -> bool:
        at = 0
        for argument in self.arguments:
            if at < count and argument.is_bounded:
                return False
            at += self._size(argument, joints, count)
        return True

    def _sizes(self, joints: int | None) -> frozenset[int] | range:
        """How many numbers it may have."""
        at, found = 0, set()
        for argument in self.arguments:
            if argument.optional or argument.size == SOME:
                found.add(at)
            if argument.size == SOME or (argument.size == JOINTS and joints is None):
                return range(at, MAX_NUMBERS + 1)
            at += joints or 0 if argument.size == JOINTS else argument.size
        return frozenset((*found, at))

    def _wanted(self, joints: int | None) -> str:
        words = self.takes or "no numbers"
        return words if joints is None else words.replace("{n}", f"({joints})")


def listed(row: CommandRow) -> dict[str, Any]:
    """A row as the mailbox's header has it, for programs that do not have this table; empty columns are left out."""
    columns = {"name": row.name, "effect": _word(row.effect), "values": row.takes, "text": row.text, "doc": row.doc,
            "arguments": [[getattr(each, name) for name in ARGUMENT] for each in row.arguments], "stops": row.stops,
            "types": row.types, "stream": row.stream, "latest": row.latest, "move": row.move, "causes": row.causes,
            "effect_of_zero": _word(row.effect_of_zero), "effect_of_one": _word(row.effect_of_one),
            "effect_of_words": {word: _word(effect) for word, effect in row.effect_of_words.items()}}
    return {name: value for name, value in columns.items() if value}


def of_type(rows: list[dict[str, Any]], name: str) -> list[dict[str, Any]]:
    """Rows of a mailbox that an arm of this type has; "": not an arm, all rows."""
    return [row for row in rows if not name or name in row.get("types", (name,))]


def row_of(given: Mapping[str, Any]) -> CommandRow:
    """A row as a mailbox lists it, with any content: a missing or unknown effect counts as the worst one."""
    arguments = given.get("arguments")
    words = given.get("effect_of_words")
    name, doc, text, stream = (str(given.get(key, "")) for key in ("name", "doc", "text", "stream"))
    stops, causes, types = (tuple(map(str, given.get(key) or ())) for key in ("stops", "causes", "types"))
    return CommandRow(
        name, effect_named(given.get("effect")) or POWER, doc,
        tuple(map(_argument, arguments)) if isinstance(arguments, list) else (), text,
        effect_of_zero=effect_named(given.get("effect_of_zero")),
        effect_of_one=effect_named(given.get("effect_of_one")),
        effect_of_words={str(word): effect_named(effect) or POWER for word, effect in words.items()}
        if isinstance(words, dict) else {},
        stops=stops, stream=stream, causes=causes, types=types, latest=given.get("latest") is True,
        move=given.get("move") is True)


def effect_named(word: object) -> Effect | None:
    """An effect by its name; None if there is no such effect."""
    return next((effect for effect in Effect if _word(effect) == word), None)


def _word(effect: Effect | None) -> str:
    return "" if effect is None else effect.name.lower()


def _argument(given: Any) -> Argument:
    try:
        name, unit, size, low, high, *marks = given
        return Argument(str(name), str(unit), int(size), float(low), float(high), *(mark is True for mark in marks))
    except (TypeError, ValueError):
        return Argument("numbers", size=SOME)
