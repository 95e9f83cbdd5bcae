"""Arm files without `$id`, as dVRK 2.4 reads them, and numbers where texts are meant."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import check_file
from trocar.procs.config.read.problem import ERROR, count

ARM = "arms/PSM1-demo.yaml"


def unstated(home: Home, **others: Any) -> Path:
    """A PSM file as dVRK 2.4 reads it, in the place of the demo's."""
    file = home.path / "arms/PSM1-0001.json"
    file.write_text(json.dumps({"kinematic": "kinematic/PSM.yaml", "generation": "Classic", "tool_detection": "FIXED",
                                "tool": "LARGE_NEEDLE_DRIVER:400006", **others}))
    home.edit(SYSTEM, ARM, "arms/PSM1-0001.json")
    return file


def test_an_arm_file_need_not_state_its_format(home: Home) -> None:
    file = unstated(home, cannula_depth=0.078, engaging=1)
    system = home.load().system
    assert system is not None and system.arms[0].cannula_depth == 0.078
    checked = check_file(file, configs=home.path)
    assert (checked.kind, count(checked.problems)) == ("psm", 0)


def test_an_arm_file_of_old_spelling_is_still_refused(home: Home) -> None:
    unstated(home, **{"mounting-pitch": -0.5})
    assert [problem.key for problem in home.load().errors] == ["$id", "mounting-pitch"]


@pytest.mark.parametrize(("keys", "name", "kind"), [
    ({"kinematic": "kinematic/ECM.yaml", "endoscope": "NONE", "mounting_pitch": 0.1}, "x.json", "ecm"),
    ({"kinematic": "kinematic/MTML.yaml"}, "x.json", "mtm"),
    ({"kinematic": "kinematic/MTML.yaml", "platform_gain": 0.4}, "x.json", "mtm")])
def test_the_kind_of_an_arm_file_follows_from_its_keys(home: Home, keys: dict[str, Any], name: str, kind: str) -> None:
    file = home.path / name
    file.write_text(json.dumps({"generation": "Classic", **keys}))
    checked = check_file(file, configs=home.path)
    assert (checked.kind, [str(row) for row in checked.problems if row.severity == ERROR]) == (kind, [])


@pytest.mark.parametrize(("old", "new"), [
    ("serial: demo", "serial: 28007"), ("name: IO1", "name: 1"), ("type: PSM", "type: 1"), ("IO: IO1", "IO: true"),
    ("serial: demo", "serial: 2.5")])
def test_a_number_in_the_place_of_a_text_is_to_be_quoted(home: Home, old: str, new: str) -> None:
    home.edit(SYSTEM, old, new)
    found = [problem for problem in home.load().errors if problem.text.startswith("wrong type")]
    assert len(found) == 1 and "quotes" in found[0].text
