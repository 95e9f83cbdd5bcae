"""JSON with comments and positions."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.config.read.jsontext import TextError, parse_json

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**12), 10**12)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@given(VALUES, st.sampled_from([None, 2, "\t"]))
def test_any_json_reads_as_the_standard_library(value: object, indent: int | str | None) -> None:
    assert parse_json(json.dumps(value, indent=indent)).data == value


def test_comments_count_only_outside_texts() -> None:
    text = '// first\n{ /* a, \n b */ "port": "udp://x /* y */", // "port": 1\n\t"n": [1, /* 2, */ 3]\n}\n// last'
    assert parse_json(text).data == {"port": "udp://x /* y */", "n": [1, 3]}


def test_every_key_keeps_its_line() -> None:
    lines = parse_json('{\n "a": {\n  "b": [1,\n   {"c": 2}]\n }\n}').lines
    assert (lines[("a",)], lines[("a", "b")], lines[("a", "b", 0)], lines[("a", "b", 1, "c")]) == (2, 3, 3, 4)


def test_numbers_keep_their_lines_as_anything_else_does() -> None:
    numbers, mixed = parse_json("\n[\n1, 2,\n\n -3e4\n]"), parse_json("\n[\n1, 2,\n\n -3e4 //\n]")
    assert numbers == mixed and numbers.data == [1, 2, -3e4]
    assert [numbers.lines[(place,)] for place in range(3)] == [3, 3, 5]


def test_repeated_key_is_told_and_last_counts() -> None:
    parsed = parse_json('{"a": 1,\n "b": 2,\n "a": 3}')
    assert parsed.data == {"a": 3, "b": 2}
    assert parsed.repeated == [(("a",), 3)]


@pytest.mark.parametrize(
    ("text", "line", "column", "what"),
    [
        ('{"a": 1\n "b": 2}', 2, 2, "a comma or } must come here"),
        ('{"a": 1,\n}', 1, 8, "comma before }"),
        ('{"a": }', 1, 7, "a value must come here, not '}'"),
        ('{"a": NaN}', 1, 7, "a value must come here, not 'NaN'"),
        ('{"a": 01}', 1, 7, "a value must come here"),
        ("[1, 2\n, 03]", 2, 3, "a value must come here"),
        ("[1, 2,\n]", 1, 6, "comma before ]"),
        ("[1 2]", 1, 4, "a comma or ] must come here"),
        ('{"a": .5}', 1, 7, "a value must come here"),
        ('{"a": "x\n"}', 1, 7, "text is never closed on its line"),
        ('{"a": "\\q"}', 1, 8, "bad text"),
        ('{"a" 1}', 1, 6, "a colon must follow"),
        ("{a: 1}", 1, 2, "a key in double quotes"),
        ('{"a": 1} x', 1, 10, "after the end"),
        ('/* never\n{"a": 1}', 1, 1, "comment is never closed"),
        ("[1, 2", 1, 6, "not the end of the file"),
        ("", 1, 1, "the end of the file"),
        ("[" * 200, 1, 66, "nested deeper than 64"),
    ],
)
def test_broken_json_names_line_and_column(text: str, line: int, column: int, what: str) -> None:
    with pytest.raises(TextError) as caught:
        parse_json(text)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert what in caught.value.what


def test_numbers_of_absurd_length_are_no_crash() -> None:
    assert parse_json("9" * 9000).data == float("inf")
