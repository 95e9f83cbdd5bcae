"""JSON as in dVRK files, with `//` and `/* */` comments outside strings, and tabs; with the line of every key.

The standard library's decoder supports neither comments nor positions, so this is a small recursive-descent reader. In
all other respects it is strict JSON: no trailing commas, no NaN, no bare words. For a repeated key the last value is
used, as in the original software, and the key is reported.
"""

from __future__ import annotations

import bisect
import json
import re
from dataclasses import dataclass, field

from trocar.procs.config.read.problem import KeyPath

_DEEPEST = 64
_SPACE = re.compile(r"(?:[ \t\r\n]+|//[^\n]*|/\*.*?\*/)*", re.DOTALL)
_STRING = re.compile(r'"(?:[^"\\\n]|\\.)*"')
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(\.[0-9]+)?([eE][-+]?[0-9]+)?(?![\w.+-])")
_NUMBERS = re.compile(r"\[[-+.eE0-9, \t\r\n]+\]")  # large files consist mostly of such lists
_WORD = re.compile(r"[\w.+-]+")
_WORDS = {"true": True, "false": False, "null": None}


class TextError(Exception):
    """A text cannot be read, with the position; line and column count from 1."""

    def __init__(self, line: int, column: int, what: str) -> None:
        super().__init__(f"line {line}, column {column}: {what}")
        self.line = line
        self.column = column
        self.what = what


@dataclass(slots=True)
class Parsed:
    """A decoded text: plain values, the line of every key path, and repeated key paths with their lines."""

    data: object = None
    lines: dict[KeyPath, int] = field(default_factory=dict)
    repeated: list[tuple[KeyPath, int]] = field(default_factory=list)


def parse_json(text: str) -> Parsed:
    """Decode `text`; TextError has the position of an error."""
    reader = _JsonReader(text)
    parsed = reader.parsed
    at = reader.skip(0)
    parsed.lines[()] = reader.line(at)
    parsed.data, at = reader.value(at, ())
    at = reader.skip(at)
    if at < len(text):
        raise reader.error(at, f"{_seen(text, at)} after the end of the document")
    return parsed


class _JsonReader:
    def __init__(self, text: str) -> None:
        self.text = text
        self.starts = [0] + [match.end() for match in re.finditer("\n", text)]
        self.parsed = Parsed()

    def line(self, at: int) -> int:
        return bisect.bisect_right(self.starts, at)

    def error(self, at: int, what: str) -> TextError:
        line = self.line(at)
        return TextError(line, at - self.starts[line - 1] + 1, what)

    def skip(self, at: int) -> int:
        """The next offset that is neither white space nor comment."""
        match = _SPACE.match(self.text, at)
        at = match.end() if match else at
        if self.text.startswith("/*", at):
            raise self.error(at, "comment is never closed")
        return at

    def value(self, at: int, key: KeyPath) -> tuple[object, int]:
        """The value at offset `at` and the offset behind it."""
        if len(key) > _DEEPEST:
            raise self.error(at, f"nested deeper than {_DEEPEST} levels")
        first = self.text[at : at + 1]
        if first == "{":
            return self.mapping(at, key)
        if first == "[":
            return self.numbers(at, key) or self.sequence(at, key)
        if first == '"':
            return self.string(at)
        match = _NUMBER.match(self.text, at)
        if match:
            return _number(match), match.end()
        word = _WORD.match(self.text, at)
        if word and word.group() in _WORDS:
            return _WORDS[word.group()], word.end()
        raise self.error(at, f"a value must come here, not {_seen(self.text, at)}")

    def string(self, at: int) -> tuple[str, int]:
        match = _STRING.match(self.text, at)
        if match is None:
            raise self.error(at, "text is never closed on its line")
        try:
            decoded = json.loads(match.group(), strict=False)
        except json.JSONDecodeError as bad:
            raise self.error(at + bad.pos, f"bad text: {bad.msg}") from bad
        return str(decoded), match.end()

    def mapping(self, at: int, key: KeyPath) -> tuple[dict[str, object], int]:
        result: dict[str, object] = {}
        opened, at = at, self.skip(at + 1)
        if self.text.startswith("}", at):
            return result, at + 1
        while True:
            if not self.text.startswith('"', at):
                raise self.error(at, f"a key in double quotes must come here, not {_seen(self.text, at)}")
            line = self.line(at)
            name, at = self.string(at)
            here = (*key, name)
            if name in result:
                self.parsed.repeated.append((here, line))
            self.parsed.lines[here] = line
            at = self.skip(at)
            if not self.text.startswith(":", at):
                raise self.error(at, f"a colon must follow the key {name!r}, not {_seen(self.text, at)}")
            result[name], at = self.value(self.skip(at + 1), here)
            at, more = self.separator(at, "}", opened)
            if not more:
                return result, at

    def sequence(self, at: int, key: KeyPath) -> tuple[list[object], int]:
        result: list[object] = []
        opened, at = at, self.skip(at + 1)
        if self.text.startswith("]", at):
            return result, at + 1
        while True:
            here = (*key, len(result))
            self.parsed.lines[here] = self.line(at)
            item, at = self.value(at, here)
            result.append(item)
            at, more = self.separator(at, "]", opened)
            if not more:
                return result, at

    def numbers(self, at: int, key: KeyPath) -> tuple[list[object], int] | None:
        """Read a list of numbers at once; None if it has other elements, or mistakes."""
        match = _NUMBERS.match(self.text, at)
        if match is None or len(key) >= _DEEPEST:
            return None
        result: list[object] = []
        lines: dict[KeyPath, int] = {}
        line = self.line(at)
        for piece in match.group()[1:-1].split(","):
            bare = piece.lstrip(" \t\r\n")
            number = _NUMBER.fullmatch(bare.rstrip(" \t\r\n"))
            if number is None:
                return None
            lines[(*key, len(result))] = line + piece.count("\n", 0, len(piece) - len(bare))
            line += piece.count("\n")
            result.append(_number(number))
        self.parsed.lines |= lines
        return result, match.end()

    def separator(self, at: int, close: str, opened: int) -> tuple[int, bool]:
        """After a member: the offset of the next one and True, or the offset behind the closing bracket and False."""
        at = self.skip(at)
        if self.text.startswith(close, at):
            return at + 1, False
        if not self.text.startswith(",", at):
            what = f"a comma or {close} must come here, not {_seen(self.text, at)}"
            raise self.error(at, f"{what} (opened in line {self.line(opened)})")
        comma, at = at, self.skip(at + 1)
        if self.text.startswith(close, at):
            raise self.error(comma, f"comma before {close}")
        return at, True


def _number(match: re.Match[str]) -> int | float:
    # many digits become a float, so that int() never reaches its length limit
    whole = match.group(1) is None and match.group(2) is None and len(match.group()) < 30
    return int(match.group()) if whole else float(match.group())


def _seen(text: str, at: int) -> str:
    if at >= len(text):
        return "the end of the file"
    word = _WORD.match(text, at)
    return repr(word.group() if word else text[at])
