"""The walls of a system file: which arms get them, and what is refused with its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from trocar.procs.config import load_system
from trocar.procs.config.loading.load import Loaded
from trocar.procs.document.walls import Wall
from trocar.procs.machine.paths import PROJECT_CONFIGS

FILE = PROJECT_CONFIGS / "systems" / "kinematic-full.yaml"
FLOOR = {"name": "floor", "shape": "plane", "position": [0, 0, -0.15]}


def loaded(tmp_path: Path, *walls: dict[str, Any]) -> Loaded:
    rows = "".join(f"    - {wall}\n" for wall in walls)
    text = FILE.read_text().rstrip()
    assert "\ntrocar:" not in text
    file = tmp_path / "system.yaml"
    file.write_text(f"{text}\ntrocar:\n  walls:\n{rows}".replace("'", '"'))
    return load_system(file)


def test_walls_are_those_of_all_psms_or_of_the_named_arms(tmp_path: Path) -> None:
    ball = {"name": "ball", "shape": "sphere", "size": [0.02], "of": "tip", "keep": "in", "arms": ["ECM", "PSM1"]}
    found = loaded(tmp_path, FLOOR, ball)
    assert not found.errors and found.system is not None
    names = {arm.name: [wall.name for wall in arm.walls] for arm in found.system.arms}
    assert names["PSM1"] == ["floor", "ball"] and names["PSM2"] == ["floor"] and names["ECM"] == ["ball"]
    assert not names["MTML"]
    assert found.system.arm("PSM2").walls == (Wall("floor", "plane", (0.0, 0.0, -0.15)),)


@pytest.mark.parametrize(("change", "key"), [
    ({"shape": "cube"}, "shape"), ({"name": "a b"}, "name"), ({"arms": ["PSM9"]}, "arms"), ({"size": [0.1]}, "walls"),
    ({"shape": "sphere", "size": []}, "walls"), ({"shape": "sphere", "size": [-0.1]}, "size"),
    ({"keep": "off"}, "keep"), ({"of": "jaw", "arms": ["ECM"]}, "walls"), ({"position": [0, 0]}, "position"),
    ({"orientation": [0, 0, 0, 0]}, "walls"), ({"margin": 0.2}, "margin"), ({"colour": "red"}, "colour")])
def test_a_wall_that_cannot_be_is_an_error_at_its_key(tmp_path: Path, change: dict[str, Any], key: str) -> None:
    found = loaded(tmp_path, FLOOR | change)
    assert found.system is None and any(key in str(problem) for problem in found.errors)


APART = {"name": "apart", "shape": "arms", "arms": ["PSM1", "PSM2", "ECM"], "margin": 0.005, "unknown": "hold"}
VIEW = {"name": "view", "shape": "cone", "size": [0.4], "keep": "in", "frame": "ECM"}


def test_arms_that_keep_apart_each_get_the_others(tmp_path: Path) -> None:
    found = loaded(tmp_path, APART, VIEW)
    assert not found.errors and found.system is not None
    walls = {arm.name: arm.walls for arm in found.system.arms}
    assert walls["PSM1"][0] == Wall("apart", "arms", margin=0.005, unknown="hold", arms=("PSM2", "ECM"))
    assert walls["ECM"] == (Wall("apart", "arms", margin=0.005, unknown="hold", arms=("PSM1", "PSM2")),)
    assert walls["PSM1"][1].frame == walls["PSM3"][0].frame == "ECM"


@pytest.mark.parametrize(("wall", "change", "key"), [
    (APART, {"arms": []}, "arms"), (APART, {"arms": ["PSM1"]}, "arms"), (APART, {"arms": ["PSM1", "MTML"]}, "arms"),
    (APART, {"arms": ["PSM1", "PSM1"]}, "arms"), (APART, {"size": [0.1]}, "walls"), (APART, {"keep": "in"}, "walls"),
    (APART, {"frame": "ECM"}, "walls"), (APART, {"unknown": "stop"}, "unknown"), (VIEW, {"frame": "MTML"}, "frame"),
    (VIEW, {"frame": "PSM9"}, "frame"), (VIEW, {"frame": "PSM1"}, "frame"), (VIEW, {"frame": ""}, "frame")])
def test_other_arms_that_cannot_be_a_wall_or_its_frame_are_an_error(tmp_path: Path, wall: dict[str, Any],
                                                                   change: dict[str, Any], key: str) -> None:
    found = loaded(tmp_path, wall | change)
    assert found.system is None and any(key in str(problem) for problem in found.errors)


def test_an_arm_keeps_away_from_eight_others_at_most(tmp_path: Path) -> None:
    many = [APART | {"name": f"apart{i}"} for i in range(5)]
    assert not loaded(tmp_path, *many[:4]).errors and loaded(tmp_path, *many).errors


def test_two_walls_of_an_arm_have_two_names(tmp_path: Path) -> None:
    assert loaded(tmp_path, FLOOR, FLOOR).errors
    assert not loaded(tmp_path, FLOOR | {"arms": ["PSM1"]}, FLOOR | {"arms": ["PSM2"]}).errors


def test_an_arm_has_sixteen_walls_at_most(tmp_path: Path) -> None:
    many = [FLOOR | {"name": f"floor{i}"} for i in range(17)]
    assert not loaded(tmp_path, *many[:16]).errors and loaded(tmp_path, *many).errors
