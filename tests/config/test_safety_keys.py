"""Keys with a safety meaning: each works or stops the start; none is merely ignored."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config.read.problem import FileProblem

IO, PID, ARM = "io/PSM1-demo.yaml", "pid/PSM.yaml", "arms/PSM1-demo.yaml"
MTM = {"type": "MTM_GENERIC", "component": "Haply"}
PARAMETERS = "consoles[0].teleop_PSMs[0].configure_parameter"


@pytest.mark.parametrize(("file", "old", "new", "key", "known"), [
    (SYSTEM, "port: udp", "port: udp\n    watchdog: 0.01", "IOs[0].watchdog", "watchdog_timeout"),
    (SYSTEM, "serial: demo", "serial: demo\n    base-frame: {}", "arms[0].base-frame", "base_frame"),
    (SYSTEM, "\ntrocar:", "\ntrocr:", "trocr", "trocar"),
    (PID, "i_gain: 0,", "i_gain: 0, p_deadbnd: 1,", "pid[0].p_deadbnd", "p_deadband"),
    (PID, "i_gain: 0,", "i_gain: 0, softness: 1,", "pid[0].softness", "pid_max_output"),
    (IO, "board_id: 6", "limit: 3\n        board_id: 6", "robots[0].actuators[0].limit", "drive"),
    (IO, "pressed_value: true", "bounce: 3, pressed_value: true", "digital_inputs[0].bounce", "debounce_time")])
def test_an_unknown_key_of_a_safety_section_stops_the_start(
        home: Home, file: str, old: str, new: str, key: str, known: str) -> None:
    home.edit(file, old, new)
    problem = home.error()
    assert problem.key == key and known in problem.allowed


@pytest.mark.parametrize(("file", "old", "new", "lacks"), [
    (ARM, "generation:", "generatio:", "generation"), (SYSTEM, "type: PSM", "_type: PSM", "arms[0].type"),
    (IO, "serial_number:", "_serial_number:", "robots[0].serial_number"),
    (IO, "serial_number:", "serial_numbr:", "robots[0].serial_numbr")])
def test_a_required_key_that_is_misspelt_or_a_comment_stops_the_start(
        home: Home, file: str, old: str, new: str, lacks: str) -> None:
    home.edit(file, old, new)
    errors = home.load().errors
    assert len(errors) == 1 and errors[0].key in (lacks, new.rstrip(":")), errors


def console(home: Home, keys: dict[str, Any], arms: tuple[str, ...] = ("MTMR",)) -> tuple[FileProblem, ...]:
    """Errors of a demo with generic masters and this console."""
    home.edit(SYSTEM, "\ntrocar:", "".join(
        f"\n  - {json.dumps({**MTM, 'name': name, 'interface': name})}" for name in arms)
        + f"\nconsoles: {json.dumps([{'name': 'c', 'input_type': 'SIMULATED', **keys}])}\ntrocar:")
    return home.load().errors


@pytest.mark.parametrize(("teleop", "key"), [
    ({"clutch": {"component": "Haply", "interface": "MTMR/B"}}, "consoles[0].teleop_PSMs[0].clutch"),
    ({"MTM_is_haptic": False}, "consoles[0].teleop_PSMs[0].MTM_is_haptic"),
    ({"configure_parameter": {"align_mtm": False}}, f"{PARAMETERS}.align_mtm"),
    ({"configure_parameter": {"use_MTM_velocity": False}}, f"{PARAMETERS}.use_MTM_velocity"),
    ({"configure_parameter": {"check_MTMs_workspace": False}}, f"{PARAMETERS}.check_MTMs_workspace"),
    ({"configure_parameter": {"gripper_scaling": {"zer0": 0.1}}}, f"{PARAMETERS}.gripper_scaling.zer0")])
def test_an_unknown_key_of_a_teleoperation_stops_the_start(home: Home, teleop: dict[str, Any], key: str) -> None:
    found = console(home, {"teleop_PSMs": [{"MTM": "MTMR", "PSM": "PSM1", **teleop}]})
    assert [problem.key for problem in found] == [key] and found[0].allowed


@pytest.mark.parametrize("key", ["clutch", "operator_present", "IO_head_sensor", "HID_file", "IO_pedals"])
def test_an_input_that_the_console_does_not_use_stops_the_start(home: Home, key: str) -> None:
    values = {"HID_file": "hid/goovis-hd.yaml", "IO_head_sensor": {"IO": "IO1", "IO_file": IO},
              "IO_pedals": {"IO": "IO1", "IO_file": IO}}
    found = console(home, {key: values.get(key, {"component": "Haply", "interface": "MTMR/A"})})
    assert [problem.key for problem in found] == [f"consoles[0].{key}"]


def buttons(arm: str) -> dict[str, Any]:
    return {"input_type": "COMPONENTS", "teleop_PSMs": [],
            **{name: {"component": "Haply", "interface": f"{arm}{name}"}
               for name in ("clutch", "camera", "operator_present")}}


def test_buttons_of_two_arms_of_one_component_belong_to_their_arms(home: Home) -> None:
    assert console(home, buttons("MTML/"), ("MTMR", "MTML")) == ()
    system = home.load().system
    assert system is not None
    (row,) = system.consoles
    assert row.clutch is not None and (row.clutch.io, row.clutch.name) == ("MTML", "MTML/clutch")
    assert {party.name: len(party.inputs) for party in system.third_parties} == {"MTMR": 0, "MTML": 3}


def test_a_button_of_one_of_two_arms_must_name_its_arm(home: Home) -> None:
    found = console(home, buttons(""), ("MTMR", "MTML"))
    assert [problem.key for problem in found] == [
        f"consoles[0].{name}.interface" for name in ("clutch", "camera", "operator_present")]
    assert "MTMR/clutch" in found[0].allowed and "MTML/clutch" in found[0].allowed


def test_comments_are_no_unknown_keys(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: udp\n    _port: fw\n    $comment: the left one")
    loaded = home.load()
    assert loaded.errors == () and [row.key for row in loaded.warnings] == ["IOs[0]._port", "IOs[0].$comment"]


def test_a_motor_current_beyond_the_controllers_full_scale_is_warned_of(home: Home) -> None:
    home.edit(IO, "maximum_current: 1.34", "maximum_current: 13.4")
    found = [problem for problem in home.load().warnings if problem.key.endswith("maximum_current")]
    assert found and "6.25 A" in found[0].allowed
