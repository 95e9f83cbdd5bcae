"""`.rob` chains of the first versions."""

from __future__ import annotations

import numpy as np
import pytest

from tests.old import convert, one_problem, only, outcomes
from trocar.procs.config.loading.kinds import check_file
from trocar.tools.converters import DEFAULTED, DROPPED, to_json

TWO = """2
modified  1.5708 0.0 0.0 0.25 revolute  active  -1.5 -2 2.5
Modified -1.5708 0.1 0.0 0.00 SLIDER    active   0.1  0 0.2

remarks
"""
FULL = (
    "1\nstandard 1.5 0.3 0.1 0.2 hinge passive -1 -2 2 7  0.5 0.01 0.02 0.03  0.001 0.002 0.003  "
    "0 1 0  -1 0 0  0 0 1 9\n"
)


def test_links_keep_their_numbers() -> None:
    assert only(TWO, "two.rob") == {
        "DH": {
            "convention": "modified",
            "joints": [
                {"alpha": 1.5708, "A": 0.0, "theta": 0.0, "D": 0.25, "type": "revolute", "mode": "active",
                 "offset": -1.5, "qmin": -2.0, "qmax": 2.5},
                {"alpha": -1.5708, "A": 0.1, "theta": 0.0, "D": 0.0, "type": "prismatic", "mode": "active",
                 "offset": 0.1, "qmin": 0.0, "qmax": 0.2},
            ],
        }
    }


def test_masses_and_principal_axes_go_over() -> None:
    (link,) = only(FULL, "full.rob")["DH"]["joints"]
    assert (link["ftmax"], link["mass"], link["cx"], link["Izz"], link["mode"]) == (7.0, 0.5, 0.01, 0.003, "passive")
    axes = np.array([[link[f"{axis}{row}"] for axis in "xyz"] for row in "123"])
    assert np.array_equal(axes, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_remarks_and_further_words_are_told_as_dropped() -> None:
    assert outcomes(convert(TWO, "two.rob"))["line 5"] == DROPPED
    assert outcomes(convert(FULL, "full.rob"))["link 1"] == DROPPED


def test_short_lines_get_limits_of_zero() -> None:
    reported = outcomes(convert("1\nmodified 0 0 0 0 revolute active 0.5\n", "a.rob"))
    assert reported == {"link 1 qmin": DEFAULTED, "link 1 qmax": DEFAULTED}


def test_the_new_file_passes_the_check(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "two.json"
    path.write_text(to_json(only(TWO, "two.rob")))
    found = check_file(path)
    assert (found.kind, found.problems) == ("kinematic", ())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (TWO.replace("2\n", "0\n", 1), "a.rob:1: error: number of links = 0: out of range; allowed: a whole number"),
        (TWO.replace("2\n", "9\n", 1), "the file has 4"),
        (TWO.replace("1.5708", "l.5708", 1), "a.rob:2: error: link 1 alpha = l.5708: not a finite number"),
        (TWO.replace("SLIDER", "rail"), "a.rob:3: error: link 2 type = rail: unknown word"),
        (TWO.replace("Modified", "hayati"), "link 2 convention = hayati: unknown word; allowed: standard, modified"),
        (TWO.replace("Modified", "standard"), "modified and standard in one chain"),
        (TWO.replace("revolute  active  -1.5 -2 2.5", ""), "link 1: 5 words"),
    ],
)
def test_mistakes_say_what_where_and_what_is_allowed(text: str, expected: str) -> None:
    assert expected in one_problem(text, "a.rob")
