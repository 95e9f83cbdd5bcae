"""Entries that are valid one by one and contradict each other, or this machine, only warn."""

from __future__ import annotations

import json

import pytest

from tests import stock
from tests.config.conftest import SYSTEM, Home

IO = "io/PSM1-demo.yaml"


@pytest.mark.parametrize(("file", "old", "new", "key", "text"), [
    (IO, "axis_id: 1\n", "axis_id: 1\n        actuator_id: 0\n", "robots[0].actuators[1].actuator_id", "their order"),
    (IO, "name: PSM1_arm_clutch", "name: PSM1_am_clutch", "digital_inputs[1].name", "has no such input"),
    (SYSTEM, "boards: emulated", "boards: emulated\n  processes: {PSM1: {cpu: 999}}", "trocar.processes.PSM1.cpu",
     "no such processor"),
    (SYSTEM, "boards: emulated", "boards: emulated\n  io: {cpu: 999}", "trocar.io.cpu", "no such processor")])
def test_entries_that_cannot_be_meant_warn(home: Home, file: str, old: str, new: str, key: str, text: str) -> None:
    home.edit(file, old, new)
    warning = home.warning()
    assert warning.key == key and text in warning.text


def test_a_robot_that_is_renamed_without_its_inputs_warns_of_each(home: Home) -> None:
    home.edit(SYSTEM, "name: PSM1", "name: PSM2")
    error = home.error()
    assert error.key == "arms[0].name" and "name_on_IO: PSM1" in error.allowed
    home.edit(IO, "- name: PSM1", "- name: PSM2")
    assert [problem.key for problem in home.load().warnings] == [f"digital_inputs[{place}].name" for place in range(4)]
    home.edit(IO, "- name: PSM2", "- name: PSM1")
    home.edit(SYSTEM, "name: PSM2", "name: PSM2\n    name_on_IO: PSM1")
    loaded = home.load()
    assert not loaded.errors and not loaded.warnings


def test_two_inputs_on_one_bit_warn(home: Home) -> None:
    home.edit(IO, "bit_id: 2", "bit_id: 0")
    warning = home.warning()
    assert warning.key.endswith("bit_id") and "bit 0 of board 6 is used twice" in warning.text


@pytest.mark.parametrize(("about", "key"), [({"SN": "22403"}, "SN"), ({"ARM_NAME": "MTMR"}, "ARM_NAME"), ({}, "")])
def test_the_gravity_file_of_another_master_warns(home: Home, about: dict[str, str], key: str) -> None:
    content = json.loads(stock.find("dvrk-site/jhu-dVRK/gc-MTML-22723.json").read_text())
    del content["SN"], content["ARM_NAME"]
    (home.path / "gc.json").write_text(json.dumps({**content, **about}))
    home.edit("arms/MTML-demo.yaml", "generation: Classic", "generation: Classic\ngravity_compensation: gc.json")
    loaded = home.load("systems/demo-mtm.yaml", search=[home.path])
    assert [warning.key for warning in loaded.warnings] == [key] * bool(key)


@pytest.mark.parametrize(("more", "warns"), [("", True), ("\ncannula_depth: 0.03", False)])
def test_a_fixed_instrument_of_another_generation_warns_without_the_depth_of_the_cannula(
        home: Home, more: str, warns: bool) -> None:
    home.edit("arms/PSM1-demo.yaml", 'tool: "LARGE_NEEDLE_DRIVER:400006"',
              f'tool: "LARGE_NEEDLE_DRIVER:420006[..11]"{more}')
    found = [warning for warning in home.load().warnings if "cannula_depth" in warning.text]
    assert [warning.key for warning in found] == ["tool"] * warns
