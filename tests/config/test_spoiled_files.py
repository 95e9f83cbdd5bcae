"""Files of which every key is spoiled in turn: what is said of each, and in which words; see tests.traces."""

from __future__ import annotations

import copy
import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.cases import cases
from tests.traces import Trace
from trocar.procs.config.loading.arms import base_frame_of
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.io_checks import board_ids, check_bus, check_io_file
from trocar.procs.config.models.arm_file import EcmFile, MtmFile, PsmFile
from trocar.procs.config.models.io_file import IoFile, PidFile
from trocar.procs.config.models.kinematic_file import ToolFile
from trocar.procs.config.models.system_file import SystemFile
from trocar.procs.config.models.trocar_section import EmulationOptions
from trocar.procs.config.read.jsontext import parse_json
from trocar.procs.config.read.problem import ERROR, KeyPath
from trocar.procs.config.read.search import search_path
from trocar.procs.config.read.source import SourceFile
from trocar.procs.config.read.validate import validate

FOLDER = Path(__file__).parent / "traces"
DRIVE = {"effort_to_current": {"scale": 2.5}, "current_to_bits": {"scale": 5242.88, "offset": 32768.0},
         "bits_to_current": {"scale": 1.9e-4, "offset": -6.25}, "maximum_current": 1.5}


def actuator(number: int, **changes: Any) -> dict[str, Any]:
    drive = copy.deepcopy(DRIVE)
    drive["current_to_bits"]["offset"] = 32768.0 + number  # type: ignore[index]
    return {"board_id": number // 2, "axis_id": number % 2, "joint_type": "REVOLUTE", "drive": drive,
            "encoder": {"bits_to_position": {"scale": 1e-3, "offset": 0.1}, "velocity_source": "FIRMWARE",
                        "position_limits_soft": {"lower": -1.0, "upper": 1.0}},
            "potentiometer": {"bits_to_voltage": {"scale": 1e-4}, "voltage_to_position": {"scale": 1.0}}, **changes}


HEAD = {"$id": "saw-robot-io.schema.json", "$version": "6"}
IO: dict[str, Any] = {
    **HEAD, "robots": [
        {"name": "PSM1", "serial_number": "28", "hardware_version": "QLA1", "number_of_actuators": 3,
         "actuators": [actuator(number) for number in range(3)], "number_of_brakes": 1,
         "brakes": [{"board_id": 1, "axis_id": 3, "drive": DRIVE, "release_current": 0.5, "release_time": 0.5,
                     "released_current": 0.1, "engaged_current": 0.0}],
         "potentiometers": {"potentiometers_type": "ANALOG", "tolerances": [
             {"axis_id": place, "distance": 0.1, "latency": 0.01} for place in range(3)],
             "coupling": {"JointToActuatorPosition": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}},
        {"name": "gripper", "serial_number": "28", "hardware_version": "QLA1", "number_of_actuators": 1,
         "actuators": [actuator(2, axis_id=2)], "number_of_brakes": 0}],
    "digital_inputs": [{"name": "clutch", "board_id": 4, "bit_id": 0, "pressed_value": True,
                        "trigger_when_pressed": True, "trigger_when_released": True}],
    "digital_outputs": [{"name": "lamp", "board_id": 5, "bit_id": 1}],
    "dallas_chips": [{"name": "chip", "board_id": 6}]}
PID = {"$id": "saw-controllers-pid.schema.json", "$version": "1", "pid": [
    {"index": 0, "name": "yaw", "type": "REVOLUTE", "p_gain": 1.0, "d_gain": 0.1, "i_gain": 0.0, "offset": 0.0,
     "i_forget_rate": 0.9, "pid_max_output": -1.0, "v_low_pass_cutoff": 0.5, "p_measured_setpoint_tolerance": 0.1}]}
TOOL = {"DH": {"convention": "modified", "joints": [{"type": "revolute", "alpha": 0, "A": 0, "theta": 0, "D": 0.4}]},
        "jaw": {"qmin": -0.7, "qmax": 1.4, "ftmax": 0.16}, "tooltip_offset": [[1, 0], [0, 1]],
        "coupling": {"ActuatorToJointPosition": [[1.0]]}, "tool_engage_position": {"lower": [0.0], "upper": [1.0]}}
ARM = {"$version": "1", "kinematic": "k.json", "generation": "Classic", "mounting_pitch": 0.3}
SYSTEM = {"$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "udp", "period": 0.001}],
          "arms": [{"name": "PSM1", "type": "PSM", "serial": "1", "IO": "IO1", "base_frame": {
              "reference_frame": "Cart", "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}],
          "consoles": [{"name": "console", "type": "PEDALS_ONLY", "teleop_PSMs": [{
              "MTM": "MTMR", "PSM": "PSM1", "configure_parameter": {"scale": 0.2, "start_gripper_threshold": 0.1}}]}]}
EMULATION = {"address": "x", "period_s": 0.001, "qla": 1.4, "firmware": 8, "robots": {"PSM1": {"friction": 1.0,
             "backlash": [0.1]}}, "buses": {"IO1": {"address": "127.0.0.1", "hub": 0, "controllers": {
                 "3": {"serial": "1234-56"}}}}}
MODELS: dict[str, tuple[type[Any], dict[str, Any]]] = {
    "io": (IoFile, IO), "pid": (PidFile, PID), "tool": (ToolFile, TOOL), "system": (SystemFile, SYSTEM),
    "psm": (PsmFile, {"$id": "dvrk-psm.schema.json", "tool_detection": "FIXED", "cannula_depth": 0.01, **ARM}),
    "ecm": (EcmFile, {"$id": "dvrk-ecm.schema.json", "endoscope": "NO_ENDOSCOPE", **ARM}),
    "mtm": (MtmFile, {"$id": "dvrk-mtm.schema.json", "platform_gain": 0.5, **ARM}),
    "emulation": (EmulationOptions, EMULATION)}
EACH = {"io": 17, "system": 4}
"""Of longer files not every spoiled one."""
VALUES: tuple[Any, ...] = ("wrong", -1, 17, 3.7, [])


def places(data: Any, key: KeyPath = ()) -> Iterator[KeyPath]:
    """Every key and item."""
    for name, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield (*key, name)
        yield from places(value, (*key, name))


def spoiled(data: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The file with one thing wrong: a key without its value, another value, misspelt, or beside an unknown one."""
    for key in places(data):
        for kind in ("left out", "misspelt", *VALUES):
            made = copy.deepcopy(data)
            here: Any = made
            for part in key[:-1]:
                here = here[part]
            if kind == "left out":
                del here[key[-1]]
            elif kind != "misspelt":
                here[key[-1]] = kind
            elif isinstance(here, dict):
                here[f"{key[-1]}s"] = here.pop(key[-1])
            else:
                here.append(copy.deepcopy(here[key[-1]]))
            yield made


def source_of(data: dict[str, Any], name: str = "x.json") -> SourceFile:
    parsed = parse_json(json.dumps(data, indent=1))
    assert isinstance(parsed.data, dict)
    return SourceFile(Path(name), parsed.data, parsed.lines)


def found(model: type[Any], data: dict[str, Any], *, calibration: bool = False) -> list[str]:
    """Everything that is wrong with a file."""
    context = Context(search_path((Path(),)), calibration_mode=calibration)
    source = source_of(data)
    content, problems = validate(model, source, unknown=ERROR if model is EmulationOptions else "warning")
    context.problems += problems
    if isinstance(content, IoFile):
        opened = Opened(context, source, content)
        check_io_file(opened)
        check_bus([opened])
        context.notes.append(str(board_ids(content)))
    if isinstance(content, SystemFile):
        system = Opened(context, source, content)
        for part in system.each("arms", content.arms):
            context.notes.append(f"base frame {base_frame_of(part)}")
    return [*map(str, context.problems), *context.notes]


@pytest.mark.parametrize("name", MODELS)
def test_what_is_said_of_spoiled_files_changes_on_purpose_only(name: str) -> None:
    model, data = MODELS[name]
    trace, whole = Trace(), found(model, data)
    trace.look(whole or ["nothing"], [])
    for made in itertools.islice(spoiled(data), 0, None, EACH.get(name, 1)):
        said = found(model, made)
        if said != whole:
            trace.look([line.removeprefix("x.json:") for line in said] or ["nothing"], [])
    trace.compare(FOLDER / f"spoiled-{name}.txt")


def changed(path: str, value: Any, **robot: Any) -> dict[str, Any]:
    """The IO file with another value at a place, and other keys of its first robot."""
    data = copy.deepcopy(IO)
    here: Any = data
    *parts, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    for part in parts:
        here = here[part]
    here[last] = value
    data["robots"][0] |= robot
    return data


EQUAL = [actuator(0), actuator(0, axis_id=1), actuator(0, axis_id=2)]
ONE_POT = {"bits_to_voltage": {"scale": 1e-4}, "voltage_to_position": {"scale": 0.0, "offset": 0.0}}
LIMITS = "robots.0.actuators.1.encoder.position_limits_soft"
SCALE = "robots.0.actuators.1.drive.bits_to_current.scale"
INVERSE = 1 / 5242.88


@cases(("data", "said"), [
    (changed(f"{LIMITS}.lower", 1.0), "no range"), (changed(f"{LIMITS}.lower", 1.0001), "above the upper limit"),
    (changed(SCALE, INVERSE * 1.0499), ""), (changed(SCALE, INVERSE * 1.0501), "is not the inverse"),
    (changed(SCALE, INVERSE * 0.9501), ""), (changed(SCALE, INVERSE * 0.9499), "is not the inverse"),
    (changed(SCALE, 0.0), "must have the sign"), (changed(SCALE, -INVERSE), "must have the sign"),
    (changed("robots.0.actuators.0.axis_id", 3, hardware_version="QLA1", brakes=[], number_of_brakes=0), ""),
    (changed("robots.0.actuators.0.axis_id", 4), "does not exist"),
    (changed("robots.0.actuators.0.axis_id", -1), "does not exist"),
    (changed("robots.1.hardware_version", "DQLA"), "board 1 is QLA1 for robot PSM1"),
    (changed("robots.1.hardware_version", "HARDWARE_UNDEFINED"), "board 1 is QLA1 for robot PSM1"),
    (changed("robots.0.actuators", EQUAL), "its 3 current offsets are all equal"),
    (changed("robots.0.actuators", EQUAL, hardware_version="dRA1"), "board 1 is dRA1 for robot PSM1"),
    (changed("robots.0.actuators", EQUAL[:2], number_of_actuators=2, potentiometers=None), ""),
    (changed("robots.1.actuators.0.potentiometer", ONE_POT), "the potentiometer is not calibrated"),
    (changed("robots.1.actuators.0.potentiometer", {**ONE_POT, "voltage_to_position": {"offset": 0.1}}), ""),
    (changed("robots.1.actuators.0.potentiometer", {**ONE_POT, "voltage_to_position": {"scale": 0.1}}), ""),
    (changed("digital_outputs.0.name", "clutch"), ""), (changed("robots.1.name", "PSM1"), "robot name is used twice")])
def test_what_must_hold_inside_an_io_file_holds_to_its_edge(data: dict[str, Any], said: str) -> None:
    problems = [line for line in found(IoFile, data) if "error" in line or "warning" in line]
    assert [said in line for line in problems] == [True] * bool(said), problems


def test_what_a_calibration_is_to_mend_is_a_warning_in_calibration_mode() -> None:
    for data in (changed("robots.0.actuators", EQUAL), changed("robots.1.actuators.0.potentiometer", ONE_POT)):
        (strict,), (lenient,) = ([line for line in found(IoFile, data, calibration=mode) if "x.json" in line]
                                 for mode in (False, True))
        assert ": error: " in strict and ", or calibration mode (trocar: {calibration_mode: true})" in strict
        assert ": warning: " in lenient and "calibration mode" not in lenient


def test_files_of_one_bus_share_neither_names_nor_axes() -> None:
    context = Context(search_path((Path(),)))
    opened = []
    for name, robot in (("a.json", {"hardware_version": "DQLA"}), ("b.json", {"name": "other"})):
        source = source_of(changed("$version", "6", **robot), name)
        content, _ = validate(IoFile, source)
        assert content is not None
        opened.append(Opened(context, source, content))
    check_bus(opened)
    said = [f"{problem.file} {problem.key}: {problem.text}" for problem in context.problems]
    trace = Trace()
    for line in said:
        trace.look([line], [])
    trace.compare(FOLDER / "one-bus.txt")


@pytest.mark.parametrize("given", [math.nan, math.inf])
def test_numbers_that_are_none_are_refused_as_such(given: float) -> None:
    source = source_of(PID)
    source.data["pid"][0]["p_gain"] = given  # type: ignore[index]
    content, (problem,) = validate(PidFile, source)
    assert content is None and problem.text == "not a finite number" and problem.key == "pid[0].p_gain"
