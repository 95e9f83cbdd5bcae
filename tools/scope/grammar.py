"""The argument of `--when`, as a tree. No part of it is ever evaluated as code.

    condition = all { "or" all }
    all       = one { "and" one }
    one       = "not" one | "(" condition ")" | comparison | event | fault
    comparison = FIELD [ OPERATOR VALUE ] | "abs" "(" FIELD ")" OPERATOR VALUE
    event     = "event" [ NAME ] [ severity, code, event or "part of its text" ]
    fault     = "fault" [ NAME ]

FIELD is a path (procs/crtk/field_paths.py), OPERATOR one of > >= < <= == !=, VALUE a number, a word or "some words".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.crtk.field_paths import BadPath, FieldPath, parse_path

MAX_LENGTH: Final = 1000
MAX_DEPTH: Final = 20
TOKEN: Final = re.compile(
    r"\s*(?:(?P<text>\"[^\"]*\"|'[^']*')|(?P<operator>>=|<=|==|!=|>|<)|(?P<bracket>[()])"
    r"|(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w/.\[]))"
    r"|(?P<path>[\w-]+(?:/[\w-]+)+(?:\.[\w/-]+(?:\[[^\[\]]*\])*)?)|(?P<word>[\w:.-]+))", re.ASCII)
GRAMMAR: Final = ("a condition is FIELD > 0.5 (or >= < <= == !=), abs(FIELD) > 0.5, event [NAME] [WORD], fault [NAME], "
                  "joined by and, or, not and brackets")
RESERVED: Final = ("and", "or", "not", "event", "fault", "abs")


class BadCondition(ValueError):
    """The text is not a condition; the message gives the position and the allowed forms."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """A field compared with a value; without operator: it is not 0, or its text is not empty. Of several: any of them.

    `written`: the value as typed, with which a text is compared.
    """

    path: FieldPath
    operator: str = ""
    value: float | str = 0.0
    of_size: bool = False
    written: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class EventSeen:
    """An event given by words: owner, severity, code, name; `text`: a part of its sentence."""

    words: tuple[str, ...] = ()
    text: str = ""


@dataclass(frozen=True, slots=True)
class FaultSeen:
    """An arm went to FAULT, or an io reports a fault; `name`: this one."""

    name: str = ""


@dataclass(frozen=True, slots=True)
class Joined:
    """Two conditions joined by `and` or `or`, or one with `not`."""

    word: str
    parts: tuple[Condition, ...]


Leaf = Comparison | EventSeen | FaultSeen
Condition = Leaf | Joined


def parse_condition(text: str) -> Condition:
    """The tree of the text; BadCondition."""
    if len(text) > MAX_LENGTH:
        raise BadCondition(f"a condition of {len(text)} characters; allowed are {MAX_LENGTH}")
    return _Parser(text).whole()


def leaves(condition: Condition) -> Iterator[Leaf]:
    """The leaves of a condition, from left to right."""
    if isinstance(condition, Joined):
        for part in condition.parts:
            yield from leaves(part)
    else:
        yield condition


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    at: int


class _Parser:
    """One text, from left to right, one token ahead."""

    def __init__(self, text: str) -> None:
        self._text, self._depth, self._place = text, 0, 0
        self._tokens = list(self._split())

    def _split(self) -> Iterator[_Token]:
        at, text = 0, self._text.rstrip()
        while at < len(text):
            found = TOKEN.match(text, at)
            if found is None:
                raise self._bad(at + len(text[at:]) - len(text[at:].lstrip()), "is not understood")
            kind = str(found.lastgroup)
            yield _Token(kind, found[kind], found.start(kind))
            at = found.end()

    def _bad(self, at: int, why: str) -> BadCondition:
        rest = self._text[at : at + 30].strip()
        where = f"at {rest!r}" if rest else "at its end"
        return BadCondition(f"--when {self._text!r}: {where} (character {at + 1}): {why}; {GRAMMAR}")

    @property
    def _next(self) -> _Token:
        return self._tokens[self._place] if self._place < len(self._tokens) else _Token("end", "", len(self._text))

    def _take(self, *texts: str) -> bool:
        taken = self._next.kind in ("word", "bracket") and self._next.text in texts
        self._place += taken
        return taken

    def whole(self) -> Condition:
        found = self._any()
        if self._next.kind != "end":
            raise self._bad(self._next.at, "and, or, or the end is expected here")
        return found

    def _any(self) -> Condition:
        return self._joined("or", lambda: self._joined("and", self._one))

    def _joined(self, word: str, part: Callable[[], Condition]) -> Condition:
        found = part()
        while self._take(word):
            found = Joined(word, (found, part()))
        return found

    def _one(self) -> Condition:
        token = self._next
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._bad(token.at, f"more than {MAX_DEPTH} deep")
        try:
            if self._take("not"):
                return Joined("not", (self._one(),))
            if self._take("("):
                found = self._any()
                self._close()
                return found
            if self._take("event"):
                return self._event()
            if self._take("fault"):
                return FaultSeen(self._name())
            return self._comparison()
        finally:
            self._depth -= 1

    def _close(self) -> None:
        if not self._take(")"):
            raise self._bad(self._next.at, "a closing bracket is missing")

    def _name(self) -> str:
        token = self._next
        if token.kind != "word" or token.text in RESERVED:
            return ""
        self._place += 1
        return token.text

    def _event(self) -> Condition:
        words = tuple(filter(None, (self._name(), self._name())))
        text = ""
        if self._next.kind == "text":
            text = self._next.text[1:-1]
            self._place += 1
        return EventSeen(words, text)

    def _comparison(self) -> Condition:
        of_size = self._take("abs")
        if of_size and not self._take("("):
            raise self._bad(self._next.at, "an opening bracket belongs behind abs")
        token = self._next
        if token.kind != "path":
            raise self._bad(token.at, "a field is expected here, as PSM1/measured_js.velocity[0]")
        self._place += 1
        try:
            path = parse_path(token.text)
        except BadPath as error:
            raise self._bad(token.at, str(error)) from None
        if not path.field:
            raise self._bad(token.at, "this is a whole topic, a field is expected")
        if of_size:
            self._close()
        if self._next.kind != "operator":
            if of_size:
                raise self._bad(self._next.at, "one of > >= < <= == != is expected here")
            return Comparison(path)
        operator = self._next.text
        self._place += 1
        written, value = self._next.text, self._value()
        return Comparison(path, operator, value, of_size, value if isinstance(value, str) else written)

    def _value(self) -> float | str:
        token = self._next
        self._place += 1
        if token.kind == "number":
            return float(token.text)
        if token.kind == "text":
            return token.text[1:-1]
        if token.kind == "word" and token.text not in RESERVED:
            return token.text
        raise self._bad(token.at, "a number or a word is expected here")
