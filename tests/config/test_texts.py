"""Texts of configuration files: the line of every key and item, and what is said of each way a text may be broken."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.examples import examples
from tests.traces import Trace
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.config.read import yamltext
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
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**12), 10**12) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4), max_leaves=20)


@examples(30)
@given(VALUES, st.sampled_from([None, 2, "\t"]))
def test_any_json_reads_as_the_standard_library(value: object, indent: int | str | None) -> None:
    assert parse_json(json.dumps(value, indent=indent)).data == value


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
    for _ in range(200):
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


@cases(("text", "line", "column", "what"), [
    ('{"a": NaN}', 1, 7, "a value must come here, not 'NaN'"), ('{"a": 01}', 1, 7, "a value must come here"),
    ("[1, 2\n, 03]", 2, 3, "a value must come here"), ("[1, 2,\n]", 1, 6, "comma before ]"),
    ('{"a": .5}', 1, 7, "a value must come here"), ('{"a": "\\q"}', 1, 8, "bad text"),
    ("[1 2]", 1, 4, "a comma or ] must come here"), ('/* never\n{"a": 1}', 1, 1, "comment is never closed"),
    ("", 1, 1, "the end of the file"), ("[" * 200, 1, 66, "nested deeper than 64")])
def test_broken_json_is_placed(text: str, line: int, column: int, what: str) -> None:
    with pytest.raises(TextError) as caught:
        parse_json(text)
    assert (caught.value.line, caught.value.column) == (line, column) and what in caught.value.what


@cases(("text", "line", "column", "what"), [
    ("a: 1\nb: !x 2", 2, 4, "tag !x is not used here"), ("? [1]\n: 2", 1, 3, "a key must be a text"),
    (f"? {'[' * 60}{']' * 60}\n: 1", 1, 3, "a key must be a text"),
    ("a: 1\n7: 2\ntrue: 3", 3, 1, "a key must be a text, not 'true'"), ("a: 1\na: 2", 2, 1, "first in line 1"),
    ("1.5: 2", 1, 1, "a key must be a text"), ("1: 2\n'1': 3", 2, 1, "occurs twice, first in line 1"),
    ("a: [1, 2\nb: 3", 2, 2, "expected"), ("a: !!python/name:os.system x", 1, 4, "tag"),
    ("a: 1\n---\nb: 2", 2, 1, "single document"), ("a: &x [*x]", 1, 4, "alias that contains itself"),
    ("a: *other", 1, 4, "undefined alias"), ("a: 1\nb: \x01", 2, 4, "character #x0001"),
    ("a: [1", 1, 6, ""), ("[" * 40_000, 1, 1, "nested")])
def test_broken_yaml_is_placed(text: str, line: int, column: int, what: str) -> None:
    with pytest.raises(TextError) as caught:
        parse_yaml(text)
    assert (caught.value.line, caught.value.column) == (line, column) and what in caught.value.what


@cases(("text", "value"), [
    ("1e-3", 0.001), ("1.5E+3", 1500.0), (".5", 0.5), ("5.", 5.0), ("-7", -7), ("010", 10), ("0x1F", 31),
    ("0o17", 15), ("on", "on"), ("yes", "yes"), ("no", "no"), ("y", "y"), ("1:30", "1:30"), ("1_000", "1_000"),
    ("2024-01-02", "2024-01-02"), ("true", True), ("False", False), ("~", None), ("", None), ("'1'", "1"),
    ('"true"', "true"), ("-.inf", -math.inf)])
def test_plain_words_mean_what_yaml_12_says(text: str, value: object) -> None:
    data = parse_yaml(f"key: {text}").data
    assert data == {"key": value}
    assert isinstance(data, dict) and type(data["key"]) is type(value)


def test_yaml_without_anything_not_a_number_and_board_ids_as_keys_are_read() -> None:
    assert parse_yaml("") == Parsed(None, {(): 1}, [])
    data = parse_yaml(".nan").data
    assert isinstance(data, float) and math.isnan(data)
    assert parse_yaml("0: a\n'1': b\n10: c\n").data == {"0": "a", "1": "b", "10": "c"}
    lines = parse_yaml("a:\n  b:\n    - 1\n    - c: 2\n").lines
    assert (lines["a",], lines["a", "b"], lines["a", "b", 0], lines["a", "b", 1, "c"]) == (1, 2, 3, 4)


def test_aliases_cannot_explode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yamltext, "_MAX_NODES", 5000)
    bomb = "a0: &a0 [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 9)
    )
    with pytest.raises(TextError):
        parse_yaml(bomb)


def test_yaml_is_the_same_by_each_scanner_and_composer(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [file.read_text() for file in sorted(PROJECT_CONFIGS.rglob("*.yaml"))[::8]]
    texts += ["a: &x [1, 'é']\nb: *x\n# end", "a: |\n  one\n  two\nb: >\n  x\n", "? a\n: !!str 1\n", "# nothing"]
    here = [parse_yaml(text) for text in texts]
    monkeypatch.setattr(yamltext, "_OVERFLOWS", 0)
    assert [parse_yaml(text) for text in texts] == here
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert [parse_yaml(text) for text in texts] == here
