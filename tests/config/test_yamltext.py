"""YAML by the rules of 1.2."""

from __future__ import annotations

import math

import pytest
import yaml

from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.config.read.jsontext import TextError
from trocar.procs.config.read.search import _other_names
from trocar.procs.config.read.yamltext import parse_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1.5E+3", 1500.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-7", -7),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("on", "on"),
        ("yes", "yes"),
        ("no", "no"),
        ("off", "off"),
        ("y", "y"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2024-01-02", "2024-01-02"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("'1'", "1"),
        ('"true"', "true"),
        ("-.inf", -math.inf),
    ],
)
def test_plain_words_mean_what_yaml_12_says(text: str, value: object) -> None:
    data = parse_yaml(f"key: {text}").data
    assert data == {"key": value}
    assert isinstance(data, dict) and type(data["key"]) is type(value)


def test_not_a_number_stays_a_float() -> None:
    data = parse_yaml(".nan").data
    assert isinstance(data, float) and math.isnan(data)


def test_board_ids_need_no_quotes_as_keys() -> None:
    assert parse_yaml("0: a\n'1': b\n10: c\n").data == {"0": "a", "1": "b", "10": "c"}


def test_every_key_keeps_its_line() -> None:
    lines = parse_yaml("a:\n  b:\n    - 1\n    - c: 2\n").lines
    assert (lines[("a",)], lines[("a", "b")], lines[("a", "b", 0)], lines[("a", "b", 1, "c")]) == (1, 2, 3, 4)


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("a: 1\nb: 2\na: 3", 3, "occurs twice, first in line 1"),
        ("a: [1, 2\nb: 3", 2, "expected"),
        ("a: !!python/name:os.system x", 1, "tag"),
        ("1.5: 2", 1, "a key must be a text"),
        ("true: 2", 1, "a key must be a text"),
        ("1: 2\n'1': 3", 2, "occurs twice, first in line 1"),
        ("? [1, 2]\n: 3", 1, "a key must be a text"),
        ("a: 1\n---\nb: 2", 2, "single document"),
        ("a: &x [*x]", 1, "alias that contains itself"),
        ("a: *nobody", 1, "undefined alias"),
        ("b: 1\na: \x07", 2, "special characters"),
        ("[" * 3000, 1, ""),
    ],
)
def test_broken_yaml_names_the_line(text: str, line: int, what: str) -> None:
    with pytest.raises(TextError) as caught:
        parse_yaml(text)
    assert caught.value.line == line
    assert what in caught.value.what


@pytest.mark.slow
def test_aliases_cannot_explode() -> None:
    bomb = "a0: &a0 [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
        f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 9)
    )
    with pytest.raises(TextError):
        parse_yaml(bomb)


def test_without_libyaml_all_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [file.read_text() for file in sorted(PROJECT_CONFIGS.rglob("*.yaml"))[::4]]
    texts += ["a: &x [1, 'é']\nb: *x\n# end", "a: |\n  one\n  two\nb: >\n  x\n", "? a\n: !!str 1\n", "# nothing"]
    here = [parse_yaml(text) for text in texts]
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert [parse_yaml(text) for text in texts] == here


def test_a_character_that_must_not_be_is_told_with_its_place() -> None:
    with pytest.raises(TextError) as reported:
        parse_yaml("a: 1\nb: \x01")
    assert (reported.value.line, reported.value.column) == (2, 4)


def test_a_number_that_nobody_would_write_is_a_text() -> None:
    assert parse_yaml("0x" + "1" * 27).data == int("1" * 27, 16)
    assert parse_yaml("0x" + "1" * 28).data == "0x" + "1" * 28


def test_only_json_has_a_twin_in_yaml() -> None:
    assert _other_names("arm/PSM.json") == ("arm/PSM.yaml",)
    assert _other_names("arm/PSM.csv") == _other_names("arm/PSM.yaml") == ()
