"""Texts of configuration files: the line of every key and item, and what is said of each way a text may be broken."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tests.traces import Trace
from trocar.procs.config.read.jsontext import Parsed, TextError, parse_json
from trocar.procs.config.read.yamltext import parse_yaml

FOLDER = Path(__file__).parent / "traces"
JSON = '''// a comment
{ "name": "PSM1", /* two
lines */ "board": [1, -2.5e3,
  3], "mixed": [0.25, "x", null, [], {}, [true]],
\t"deep": {"a": {"b": [{"c": false}, 7]}}, "name": "twice" // end
}
'''
YAML = '''# a comment
name: PSM1
board: [1, -2.5e3, 3]
mixed:
  - 0.25
  - "x"
  - ~
  - {a: [true, .inf], 7: z}
text: |
  two
  lines
deep: {a: {b: [{c: off}, 0x1F]}}
'''


class Written:
    """A JSON text that is made piece by piece, and what has to be read of it."""

    def __init__(self, chance: Random) -> None:
        self.chance, self.text, self.parsed = chance, "", Parsed()

    @property
    def line(self) -> int:
        return self.text.count("\n") + 1

    def space(self) -> None:
        """Room between two signs."""
        self.text += "".join(self.chance.choices(("", " ", "\n", "\t", "/* x\n { */", "// y ]\n", "\r\n"), k=2))

    def value(self, key: tuple[str | int, ...]) -> Any:
        kind = self.chance.choice("nnnswlmN" if len(key) < 4 else "nsw")
        if kind == "m":
            return self.mapping(key)
        if kind in "lN":
            return self.items(key, numbers=kind == "N")
        value = self.chance.choice({"n": (0, -7, 12, 1.5, -2e-3, 10**20), "s": ("", "a/*b*/", 'q"\\', "é//"),
                                    "w": (True, False, None)}[kind])
        self.text += json.dumps(value, ensure_ascii=self.chance.random() < 0.5)
        return value

    def mapping(self, key: tuple[str | int, ...]) -> dict[str, Any]:
        result: dict[str, Any] = {}
        self.text += "{"
        for number in range(self.chance.randrange(4)):
            self.text += "," if number else ""
            self.space()
            name = self.chance.choice("abcd")
            if name in result:
                self.parsed.repeated.append(((*key, name), self.line))
            self.parsed.lines[*key, name] = self.line
            self.text += f'"{name}"'
            self.space()
            self.text += ":"
            self.space()
            result[name] = self.value((*key, name))
            self.space()
        self.space()
        self.text += "}"
        return result

    def items(self, key: tuple[str | int, ...], *, numbers: bool) -> list[Any]:
        result: list[Any] = []
        self.text += "["
        for number in range(self.chance.randrange(5)):
            self.text += "," if number else ""
            self.text += self.chance.choice(("", " ", "\n", " \n\t")) if numbers else ""
            if not numbers:
                self.space()
            self.parsed.lines[*key, number] = self.line
            if numbers:
                result.append(self.chance.choice((1, -2.5, 3e4)))
                self.text += str(result[-1]) + self.chance.choice(("", "\n", " "))
            else:
                result.append(self.value((*key, number)))
                self.space()
        self.text += "]"
        return result


def test_any_json_keeps_the_lines_of_its_keys_and_items() -> None:
    chance = Random(1)
    for _ in range(400):
        made = Written(chance)
        made.space()
        made.parsed.lines[()] = made.line
        made.parsed.data = made.mapping(())
        made.space()
        parsed = parse_json(made.text)
        assert parsed.data == made.parsed.data and parsed.repeated == made.parsed.repeated, made.text
        mine = {key: parsed.lines[key] for key in made.parsed.lines}
        assert mine == made.parsed.lines, made.text
        assert all(type(a) is type(b) for a, b in zip(flat(parsed.data), flat(made.parsed.data), strict=True))


def flat(value: Any) -> list[Any]:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return [value] if inner is None else [each for item in inner for each in flat(item)]


@pytest.mark.parametrize(("name", "text", "parse"), [("json", JSON, parse_json), ("yaml", YAML, parse_yaml)])
def test_what_is_said_of_broken_texts_changes_on_purpose_only(
        name: str, text: str, parse: Callable[[str], Parsed]) -> None:
    trace = Trace()
    signs = ("", '"', "x") if name == "json" else ("", ": [")
    spoiled = [text[:at] + sign + text[at + 1:] for at in range(len(text)) for sign in signs]
    for broken in [*spoiled, *(text[:at] for at in range(len(text)))]:
        try:
            found = parse(broken)
            said = f"{json.dumps(found.data)} {sorted(found.lines.values())} {found.repeated}"
        except TextError as error:
            assert str(error) == f"line {error.line}, column {error.column}: {error.what}"
            said = str(error)
        trace.look([said], [])
    trace.compare(FOLDER / f"broken-{name}.txt")


@pytest.mark.parametrize("parse", [parse_json, parse_yaml])
def test_texts_may_be_nested_64_deep(parse: Callable[[str], Parsed]) -> None:
    for opens, closes in (("[", "]"), ('{"a": ', "}")):
        assert parse(opens * 64 + "1" + closes * 64).data
        with pytest.raises(TextError, match="nested"):
            parse(opens * 65 + "1" + closes * 65)
        with pytest.raises(TextError, match="nested"):
            parse(opens * 64 + "[1]" + closes * 64)


@pytest.mark.parametrize("parse", [parse_json, parse_yaml])
def test_whole_numbers_have_up_to_29_digits(parse: Callable[[str], Parsed]) -> None:
    for digits, kind in (("7" * 29, int), ("7" * 30, float), ("-" + "7" * 28, int), ("-" + "7" * 29, float),
                         ("7" * 400, float)):
        data = parse(f"[{digits}, 1.0, 1e2]").data
        assert isinstance(data, list)
        assert type(data[0]) is kind and data == [kind(digits), 1.0, 100.0] and type(data[1]) is type(data[2]) is float
    assert type(parse_yaml(f"0x{'f' * 27}").data) is int and type(parse_yaml(f"0x{'f' * 28}").data) is str


@pytest.mark.parametrize(("text", "line", "column", "what"), [
    ("a: 1\nb: !x 2", 2, 4, "tag !x is not used here"), ("? [1]\n: 2", 1, 3, "a key must be a text, not"),
    ("a: 1\n7: 2\ntrue: 3", 3, 1, "a key must be a text, not 'true'"), ("a: 1\na: 2", 2, 1, "first in line 1"),
    ("a: 1\nb: \x01", 2, 4, "character #x0001"), ("a: [1", 1, 6, ""), ("", 1, 1, "")])
def test_broken_yaml_is_placed(text: str, line: int, column: int, what: str) -> None:
    if not text:
        assert parse_yaml(text) == Parsed(None, {(): 1}, [])
        return
    with pytest.raises(TextError) as caught:
        parse_yaml(text)
    assert (caught.value.line, caught.value.column) == (line, column) and what in caught.value.what
