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
    (SYSTEM, "boards: emulated", "boards: emulated\n  io: {cpu: 999}", "trocar.io.cpu", "no such processor"),
])
def test_entries_that_cannot_be_meant_warn(home: Home, file: str, old: str, new: str, key: str, text: str) -> None:
    home.edit(file, old, new)
    warning = home.warning()
    assert warning.key == key and text in warning.text


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
