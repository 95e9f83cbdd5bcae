"""Reading of the manufacturer's `.cal` files."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.tools.new_arm.cal_file import LOWER, UPPER, CalFile, read_cal
from trocar.tools.output.errors import Problem


def read(folder: Path, text: str) -> CalFile:
    path = folder / "p1.cal"
    path.write_text(text, encoding="utf-8")
    return read_cal(path)


def test_lists_rows_comments_and_every_form_of_a_number_are_read(tmp_path: Path) -> None:
    cal = read(tmp_path, """% a comment

FileType = [ 'PSM_CAL' ]
serial_number= [ 12345 ]  trailing words
gain(1:4) = [ .5 +3, 1e-05 -6.5435E-005 ]
bare = 7
range(LOWER_LIMIT,1:2) = [ -1 -2. ]
range(UPPER_LIMIT,:) = [ 1 2 ]
table(INDEX3).len = [ 40 ]
""")
    assert (cal.one("FileType"), cal.one("serial_number"), cal.one("bare")) == ("PSM_CAL", 12345.0, 7.0)
    assert cal.numbers("gain", 4) == (0.5, 3.0, 1e-5, -6.5435e-5)
    assert (cal.numbers("range", 2, LOWER), cal.numbers("range", 2, UPPER)) == ((-1.0, -2.0), (1.0, 2.0))
    assert cal.one("table(INDEX3).len") == 40.0 and cal.one("absent") is None and cal.one("gain") is None


@pytest.mark.parametrize(("line", "column"), [
    ("gain = [ 1 2", 13), ("gain = [ 1 two ]", 12), ("gain = 1 2", 11), ("= [ 1 ]", 1), ("gain [ 1 ]", 1),
    ("gain(1:3) = [ 1 2 ]", 12), ("gain(2:3) = [ 1 2 ]", 6), ("gain(NO_SUCH,1:2) = [ 1 2 ]", 6), ("gain(0) = [ 1 ]", 6),
    ("gain = [ nan ]", 10), ("gain = [ 'open ]", 10), ("gain = [ 1.2.3 ]", 10)])
def test_a_mistake_is_named_with_line_and_column(tmp_path: Path, line: str, column: int) -> None:
    with pytest.raises(Problem, match=rf"line 2, column {column}:"):
        read(tmp_path, f"first = [ 1 ]\n{line}\n")


def test_a_list_given_twice_or_of_another_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Problem, match="line 2: gain is assigned twice"):
        read(tmp_path, "gain = [ 1 ]\ngain = [ 2 ]\n")
    cal = read(tmp_path, "gain = [ 1 2 ]\nwords = [ 1 'a' ]\n")
    for name, count in (("gain", 3), ("words", 2), ("absent", 1)):
        with pytest.raises(Problem, match=name):
            cal.numbers(name, count)


def test_a_file_that_is_missing_or_huge_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Problem, match="cannot be read"):
        read_cal(tmp_path / "absent.cal")
    with pytest.raises(Problem, match="bytes"):
        read(tmp_path, "%" * (1 << 21))


@given(st.binary(max_size=200))
def test_any_content_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.cal"
    path.write_bytes(content)
    try:
        read_cal(path)
    except Problem as problem:
        assert " line " in str(problem)
