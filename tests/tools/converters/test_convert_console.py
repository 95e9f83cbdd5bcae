"""Console files and arm files from before dVRK 2.4."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from tests.old import convert, one_problem, only, outcomes
from trocar.tools.converters import DEFAULTED, DROPPED, LOST

FRAME = [[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
PSM = {"name": "PSM1", "type": "PSM", "serial": "11111"}
MTM = {"name": "MTMR", "type": "MTM", "serial": "22222"}


def system(**console: object) -> dict:  # type: ignore[type-arg]
    return only(json.dumps(console), "console-Try.json")


def lost(**console: object) -> set[str]:
    result = convert(json.dumps(console), "console-Try.json")
    assert result.problems == ()
    return {key for key, outcome in outcomes(result).items() if outcome == LOST}


def test_arms_find_their_files_by_their_serial_numbers() -> None:
    assert system(arms=[PSM]) == {
        "$id": "dvrk-system.schema.json",
        "$version": "1",
        "IOs": [{"name": "IO1", "port": "fw"}],
        "arms": [{"name": "PSM1", "type": "PSM", "IO": "IO1", "serial": "11111"}],
    }


def test_bus_settings_go_over() -> None:
    io = {"port": 1, "firewire-protocol": "broadcast-read-write", "period": 0.0005, "watchdog-timeout": 0.04,
          "close-all-relays": False, "configuration-files": ["a.xml", "b.json"], "physical-footpedals-required": False}
    (bus,) = system(arms=[PSM], io=io)["IOs"]
    assert bus == {"name": "IO1", "port": "fw:1", "protocol": "broadcast-query-read-write", "period": 0.0005,
                   "watchdog_timeout": 0.04, "close_all_relays": False, "configuration_files": ["a.json", "b.json"]}


def test_a_port_that_nobody_can_open_is_an_error() -> None:
    result = convert(json.dumps({"arms": [PSM], "io": {"port": "usb:1"}}), "console.json")
    assert [(problem.key, "udp[:IP]" in str(problem)) for problem in result.problems] == [("io.port", True)]


def test_defaults_that_have_changed_are_told() -> None:
    reported = outcomes(convert(json.dumps({"arms": [PSM]}), "console.json"))
    assert (reported["IOs[0].protocol"], reported["IOs[0].close_all_relays"]) == (DEFAULTED, DEFAULTED)


def test_settings_of_a_bus_without_arms_are_dropped() -> None:
    arm = {"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm": "x.json"}
    result = convert(json.dumps({"arms": [arm], "io": {"port": "udp"}}), "console.json")
    assert outcomes(result)["io"] == DROPPED


def test_simulated_arms_need_no_bus() -> None:
    data = system(arms=[{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm": "arm/x.json"}])
    assert data["arms"] == [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arm/x.json"}]
    assert "IOs" not in data


def test_names_of_files_and_types_become_those_of_today() -> None:
    suj = {"name": "SUJ", "type": "SUJ", "io": "sawRobotIO1394-SUJ.xml", "kinematic": "suj.json"}
    (row,) = system(arms=[suj])["arms"]
    assert row == {"name": "SUJ", "type": "SUJ_Classic", "IO": "IO1", "IO_file": "sawRobotIO1394-SUJ.json",
                   "arm_file": "suj.json"}


def test_base_frames_go_over() -> None:
    arms = [PSM | {"base-frame": {"component": "SUJ", "interface": "Robot"}},
            MTM | {"base-frame": {"reference-frame": "HRSV", "transform": FRAME}}]
    psm, mtm = system(arms=arms)["arms"]
    assert psm["base_frame"] == {"component": "SUJ", "interface": "Arm"}
    assert mtm["base_frame"] == {"reference_frame": "HRSV", "transform": FRAME}


def test_foreign_arms_keep_component_and_interface() -> None:
    foreign = {"name": "MTMR", "type": "MTM_GENERIC", "component": "Force", "skip-ros-bridge": True}
    (row,) = system(arms=[foreign])["arms"]
    assert row == {"name": "MTMR", "type": "MTM_GENERIC", "component": "Force", "interface": "Arm",
                   "skip_ROS_bridge": True}


TELEOPS = {
    "psm-teleops": [
        {"mtm": "MTMR", "psm": "PSM1", "period": 0.002, "psm-base-frame": {"component": "ECM", "interface": "Arm"},
         "configure-parameter": {"scale": 0.4, "align-mtm": False, "jaw-rate-back-from-clutch": 0.6, "ignore-jaw": True,
                                 "use-mtm-velocity": False, "gripper-scaling": {"zero": 0.1, "max": 1.0}}},
        {"master": "MTMR", "slave": "PSM2"},
    ],
    "ecm-teleop": {"mtm-left": "MTML", "mtm-right": "MTMR", "ecm": "ECM"},
}


def test_teleoperations_become_those_of_one_console() -> None:
    io = {"footpedals": "io/sawRobotIO1394-MTMR-foot-pedals.xml"}
    (console,) = system(arms=[PSM, MTM], io=io, **TELEOPS)["consoles"]
    assert console == {
        "name": "console",
        "input_type": "PEDALS_ONLY",
        "IO_pedals": {"IO": "IO1", "IO_file": "io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json"},
        "teleop_PSMs": [
            {"MTM": "MTMR", "PSM": "PSM1", "period": 0.002, "PSM_base_frame": {"component": "ECM", "interface": "Arm"},
             "configure_parameter": {"scale": 0.4, "jaw_rate_after_clutch": 0.6, "ignore_jaw": True, "align_MTM": False,
                                     "use_MTM_linear_velocity": False, "gripper_scaling": {"zero": 0.1, "max": 1.0}}},
            {"MTM": "MTMR", "PSM": "PSM2"},
        ],
        "teleop_ECMs": [{"MTML": "MTML", "MTMR": "MTMR", "ECM": "ECM"}],
    }


PEDALS = {"footpedals": "pedals.xml"}
KEYBOARD = {name: {"component": "Keyboard", "interface": name} for name in ("clutch", "camera", "operator-present")}


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"io": PEDALS}, {"input_type": "PEDALS_ONLY"}),
        ({"io": PEDALS, "operator-present": {"io": "head.xml"}},
         {"input_type": "PEDALS_ISI_HEAD_SENSOR", "IO_head_sensor": {"IO": "IO1", "IO_file": "head.json"}}),
        ({"io": PEDALS, "operator-present": {"hid": "goovis.json"}},
         {"input_type": "PEDALS_GOOVIS_HEAD_SENSOR", "HID_file": "goovis.json"}),
        ({}, {"input_type": "SIMULATED"}),
        ({"console-inputs": KEYBOARD},
         {"input_type": "COMPONENTS",
          "operator_present": {"component": "Keyboard", "interface": "operator-present"}}),
        ({"io": PEDALS, "console-inputs": {"clutch": KEYBOARD["clutch"]}},
         {"input_type": "COMPONENTS", "operator_present": {"component": "IO1", "interface": "coag"}}),
        ({"operator-present": {"component": "io", "interface": "COAG"}},
         {"input_type": "COMPONENTS", "operator_present": {"component": "IO1", "interface": "coag"},
          "clutch": {"component": "IO1", "interface": "clutch"}}),
    ],
)
def test_inputs_of_the_console_decide_its_type(keys: dict[str, object], expected: dict[str, object]) -> None:
    (console,) = system(arms=[PSM, MTM], **{"psm-teleops": [{"mtm": "MTMR", "psm": "PSM1"}]}, **keys)["consoles"]
    assert {key: console[key] for key in expected} == expected


def test_focus_controller_goes_over() -> None:
    data = system(arms=[PSM], **{"endoscope-focus": {"io": "focus.xml"}})
    assert data["ISI_focus_controller"] == {"name": "focus_controller", "IO": "IO1", "IO_file": "focus.json"}


def test_components_and_chattiness_go_over() -> None:
    data = system(arms=[PSM], chatty=True, **{"custom-components": [{"class-name": "mtsX"}]})
    assert data["settings"] == {"chatty": True}
    assert data["component_manager"] == {"components": [{"class-name": "mtsX"}]}


def test_components_for_teleoperations_get_their_names_of_today() -> None:
    manager = {"components": [{"class-name": "mtsMine", "constructor-arg": {"Name": "MTMR-PSM1"}}]}
    data = system(arms=[PSM, MTM], **{"component-manager": manager, "psm-teleops": [{"mtm": "MTMR", "psm": "PSM1"}]})
    assert data["component_manager"]["components"][0]["constructor-arg"] == {"Name": "MTMR_PSM1"}


EMBEDDED = {"type": "PSM", "name": "PSM1", "io": "sawRobotIO1394-PSM1-11111.xml", "pid": "../sawControllersPID-PSM.xml",
            "kinematic": "../psm-large-needle-driver.json"}


def test_arm_files_are_made_where_the_console_named_the_chain() -> None:
    result = convert(json.dumps({"arms": [EMBEDDED]}), "console-PSM1.json")
    assert result.complete
    console, arm = result.outputs
    assert (console.name, arm.name) == ("system-PSM1.json", "PSM1-11111.json")
    assert console.data["arms"] == [{"name": "PSM1", "type": "PSM", "IO": "IO1", "serial": "11111",
                                     "IO_file": "sawRobotIO1394-PSM1-11111.json", "arm_file": "PSM1-11111.json"}]
    assert arm.data == {"$id": "dvrk-psm.schema.json", "$version": "1", "kinematic": "kinematic/PSM.json",
                        "generation": "Classic", "tool_detection": "FIXED", "tool": "LARGE_NEEDLE_DRIVER:400006"}
    reported = outcomes(result)
    assert (reported["arms[0].pid"], reported["arms[0].serial"]) == (DROPPED, DEFAULTED)


@pytest.mark.parametrize(
    ("arm", "kinematic", "expected"),
    [
        ("MTML", "dvmtm.rob", {"kinematic": "kinematic/MTML.json", "gravity_compensation": "gc.json"}),
        ("ECM", "dvecm.rob", {"kinematic": "kinematic/ECM.json", "mounting_pitch": round(-math.pi / 4, 6)}),
        ("PSM2", "dvpsm.rob", {"kinematic": "kinematic/PSM.json", "tool_detection": "MANUAL"}),
    ],
)
def test_old_chains_are_known_by_their_names(arm: str, kinematic: str, expected: dict[str, object]) -> None:
    row: dict[str, object] = {"name": arm, "type": arm[:3], "serial": "12345", "kinematic": kinematic,
                              "base-frame": {"component": "SUJ", "interface": arm}}
    if arm == "MTML":
        row["gravity-compensation"] = "gc.json"
    _, made = convert(json.dumps({"arms": [row]}), "console-x.json").outputs
    assert {key: made.data[key] for key in expected} == expected


def test_names_of_arms_cannot_lead_out_of_the_folder() -> None:
    result = convert(json.dumps({"arms": [EMBEDDED | {"name": "../../etc/x"}]}), "console-x.json")
    assert result.outputs[1].name == "______etc_x-11111.json"


@pytest.mark.parametrize(
    ("console", "keys"),
    [
        ({"arms": [{"name": "PSM1", "type": "PSM_SOCKET", "remote-ip": "localhost", "port": 10001}]}, {"arms[0].type"}),
        ({"arms": [PSM | {"system": "elsewhere"}]}, {"arms[0].system"}),
        ({"arms": [PSM | {"simulation": "DYNAMIC"}]}, {"arms[0].simulation"}),
        ({"arms": [PSM | {"kinematic": "own.rob"}]}, {"arms[0].kinematic"}),
        ({"arms": [PSM], "psm-teleops": [{"mtm": "M", "psm": "P", "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}]},
         {"psm-teleops[0].rotation"}),
        ({"arms": [PSM], "console-inputs": {"clutch": KEYBOARD["clutch"], "camera": KEYBOARD["camera"]}},
         {"console-inputs.operator_present"}),
    ],
)
def test_what_cannot_be_said_today_is_told_as_lost(console: dict[str, object], keys: set[str]) -> None:
    assert lost(**console) == keys


def test_unknown_keys_are_dropped_with_their_lines() -> None:
    result = convert('{\n"arms": [{"name": "PSM1", "type": "PSM", "serial": "1",\n"colour": "red"}]}', "console.json")
    (change,) = [change for change in result.changes if change.outcome == DROPPED]
    assert (change.line, change.key, change.old) == (3, "arms[0].colour", '"red"')
    assert str(change).startswith(f"console.json:3: {DROPPED}: arms[0].colour = ")
    assert str(dataclasses.replace(change, line=0)).startswith(f"console.json: {DROPPED}: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"arms": [{"type": "PSM"}]}', "arms[0].name: this key is required; allowed: a text"),
        ('{"arms": {"name": "PSM1"}}', "arms = {\"name\": \"PSM1\"}: wrong type; allowed: a list of objects"),
        ('{"arms": [3]}', "arms[0] = 3: wrong type; allowed: an object"),
        ('{"arms": [], "io": {"period": "fast"}}', 'io.period = "fast": wrong type; allowed: a number'),
        ('{"arms": [], "psm-teleops": [{"mtm": "MTMR"}]}', "psm-teleops[0].psm: this key is required"),
        ('{"arms": [,]}', "c.json:1: error: broken JSON, column 11"),
        ('{"a": 1}', "no known kind of file; allowed: IO XML, PID XML, .rob, console*.json"),
        ("hello", "no known kind of file"),
        ("", "no known kind of file"),
        (b"{\xff}", "not UTF-8 text"),
    ],
)
def test_mistakes_say_what_where_and_what_is_allowed(text: str | bytes, expected: str) -> None:
    assert expected in one_problem(text, "c.json")


ARM = {"kinematic": "kinematic/psm.json", "generation": "Classic", "tool-detection": "FIXED",
       "tool": "LARGE_NEEDLE_DRIVER:420006[12]", "re-home": False}


def test_arm_files_get_the_spelling_of_today() -> None:
    assert only(json.dumps(ARM), "PSM1-1.json") == {
        "$id": "dvrk-psm.schema.json", "$version": "1", "kinematic": "kinematic/PSM.json", "generation": "Classic",
        "tool_detection": "FIXED", "re_home": False, "tool": "LARGE_NEEDLE_DRIVER:420006:12"}


@pytest.mark.parametrize(
    ("name", "data", "expected"),
    [
        ("ECM-1.json", {"kinematic": "kinematic/ecm-si.json", "endoscope": "Si_HD_STRAIGHT"},
         {"$id": "dvrk-ecm.schema.json", "kinematic": "kinematic/ECM_Si.json", "generation": "Si",
          "mounting_pitch": -1.22173}),
        ("MTMR-1.json", {"kinematic": "kinematic/mtm.json"},
         {"$id": "dvrk-mtm.schema.json", "kinematic": "kinematic/MTMR.json"}),
        ("x.json", {"kinematic": "own.json", "gravity-compensation": "gc.json"},
         {"$id": "dvrk-mtm.schema.json", "kinematic": "own.json", "gravity_compensation": "gc.json"}),
    ],
)
def test_kind_of_an_arm_file_follows_its_keys(name: str, data: dict[str, object], expected: dict[str, object]) -> None:
    found = only(json.dumps(data), name)
    assert {key: found[key] for key in expected} == expected


@pytest.mark.parametrize("data", [{"IOs": [{"name": "IO1", "port": "udp"}]}, {"robots": [{"name": "PSM1"}]},
                                  {"$version": "1", "pid": [{"index": 0}]}])
def test_files_of_today_without_their_head_get_it(data: dict[str, object]) -> None:
    new = only(json.dumps(data), "x.json")
    assert {"$id", "$version"} <= set(new) and data.items() <= new.items()


def test_files_of_today_become_nothing_and_are_no_mistake() -> None:
    for text in ('{"$id": "dvrk-system.schema.json", "$version": "1", "arms": []}', '{"instruments": []}'):
        result = convert(text, "x.json")
        assert (result.kind, result.outputs, result.problems) == ("today", (), ())


def test_an_arm_of_no_kind_is_refused() -> None:
    assert "nothing says which kind of arm" in one_problem('{"kinematic": "own.json"}', "x.json")
