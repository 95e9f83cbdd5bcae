"""Mistakes in arm files of ECM and MTM, and in what they name: file, line, key, value and what is allowed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests import stock
from tests.config.conftest import Home
from trocar.procs.config import FileProblem, check_file, load_system

ECM, MTML, PSM = "arms/ECM-demo.yaml", "arms/MTML-demo.yaml", "arms/PSM1-Si-demo.yaml"
SYSTEM_OF = {ECM: "systems/demo-ecm.yaml", MTML: "systems/demo-mtm.yaml", PSM: "systems/demo-psm-si.yaml"}


@pytest.mark.parametrize(("file", "old", "new", "key", "value", "allowed"), [
    (ECM, "Classic_SD_STRAIGHT", "Classic_SD_SIDEWAYS", "endoscope", '"Classic_SD_SIDEWAYS"', '"Classic_SD_UP"'),
    (ECM, "endoscope: Classic_SD_STRAIGHT", "re_home: true", "endoscope", "", '"NONE"'),
    (ECM, "mounting_pitch: -0.785398", "re_home: true", "mounting_pitch", "", "a number from -3.2"),
    (ECM, "mounting_pitch: -0.785398", "mounting_pitch: -45", "mounting_pitch", "-45", "up to 3.2 (rad)"),
    (ECM, "kinematic_gc: kinematic/ECM.yaml", "kinematic_gc: x.json", "kinematic_gc", '"x.json"', "search path"),
    (ECM, "kinematic_gc: kinematic/ECM.yaml", "kinematic_gc: kinematic/PSM.yaml", "kinematic_gc",
     '"kinematic/PSM.yaml"', "6 or 4 rows"),
    (PSM, "kinematic_gc: kinematic/PSM_Si_physical.yaml", "kinematic_gc: kinematic/ECM.yaml", "kinematic_gc",
     '"kinematic/ECM.yaml"', "7 rows"),
    (PSM, "mounting_pitch: -0.785398", "cannula_depth: -1\nmounting_pitch: 0", "cannula_depth", "-1", "from 0.0"),
    (MTML, "generation: Classic", "generation: Classic\nplatform_gain: 1.5", "platform_gain", "1.5", "up to 1.0"),
    (MTML, "generation: Classic", "generation: Classic\ngripper_events_debounce: -0.1", "gripper_events_debounce",
     "-0.1", "from 0.0 (s)"),
    (MTML, "generation: Classic", "generation: Classic\nkinematic_type: OPEN", "kinematic_type", '"OPEN"', "ITERATIVE"),
    (MTML, "generation: Classic", "generation: Classic\ngravity_compensation: gc.json", "gravity_compensation",
     '"gc.json"', "search path")])
def test_mistake_in_an_arm_file_is_named(
        home: Home, file: str, old: str, new: str, key: str, value: str, allowed: str) -> None:
    line = home.edit(file, old, new)
    problems = check_file(home.path / file, configs=home.path).problems
    (problem,) = [one for one in problems if one.severity == "error"]
    assert (problem.key, problem.value) == (key, value) and allowed in problem.allowed
    assert problem.line in ((line, line + 1) if value else (1, 2, 3, 4, line))
    loaded = load_system(home.path / SYSTEM_OF[file], configs=home.path)
    assert loaded.system is None
    assert (problem.file, problem.line, problem.key) in [(one.file, one.line, one.key) for one in loaded.errors]


def spoilt(folder: Path, **changes: Any) -> tuple[FileProblem, ...]:
    """What is wrong with a site's gravity file after these changes of its controller."""
    content = json.loads(stock.find("dvrk-site/jhu-dVRK/gc-MTML-22723.json").read_text())
    version = changes.pop("version", "2.0")
    content["version"] = version
    content["GC_controller"].update(changes)
    (folder / "gc.json").write_text(json.dumps(content, indent=1))
    return check_file(folder / "gc.json").problems


def test_gravity_file_of_a_site_is_fine(tmp_path: Path) -> None:
    assert spoilt(tmp_path) == ()


def test_mistake_in_a_gravity_file_is_named(tmp_path: Path) -> None:  # the others: test_finding.py
    problem = spoilt(tmp_path, version="1.0")[0]
    assert problem.key == "version" and 'the text "2.0"' in problem.allowed and problem.line > 1


def test_gravity_file_that_an_arm_names_is_checked_with_it(home: Home, tmp_path: Path) -> None:
    spoilt(home.path, db_vel_vec=[9.0] * 7)
    home.edit(MTML, "generation: Classic", "generation: Classic\ngravity_compensation: gc.json")
    for problems in (check_file(home.path / MTML, configs=home.path).problems,
                     load_system(home.path / SYSTEM_OF[MTML], configs=home.path).errors):
        assert "GC_controller.db_vel_vec[0]" in [problem.key for problem in problems]
