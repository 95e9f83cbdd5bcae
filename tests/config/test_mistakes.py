"""Every class of mistake names file, line, key, value and what is allowed, and all of them at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.config.conftest import SYSTEM, Home

IO = "io/PSM1-demo.yaml"
PID = "pid/PSM.yaml"
ARM = "arms/PSM1-demo.yaml"
CHAIN = "kinematic/PSM.yaml"
TOOL = "tool/LARGE_NEEDLE_DRIVER_400006.yaml"
INDEX = "tool/index.yaml"

DRIVE = "robots[0].actuators[0].drive"


@pytest.mark.parametrize(
    ("file", "old", "new", "key", "value", "allowed"),
    [
        # wrong type
        (IO, "maximum_current: 1.34", 'maximum_current: "1.34"', f"{DRIVE}.maximum_current", '"1.34"', "a number"),
        (IO, "maximum_current: 1.34", "maximum_current: 1e400", f"{DRIVE}.maximum_current", "Infinity", "a number"),
        (SYSTEM, "- name: IO1\n    port: udp", "- 7", "IOs[0]", "7", "an object with name, port"),
        # range
        (IO, "board_id: 6", "board_id: 16", "robots[0].actuators[0].board_id", "16", "from 0 up to 15"),
        (IO, "axis_id: 0", "axis_id: 4", "robots[0].actuators[0].axis_id", "4", "0 to 3 on QLA1"),
        (PID, "p_gain: 120", "p_gain: 1e308", "pid[0].p_gain", "1e+308", "from 0.0 up to 1000000.0"),
        (SYSTEM, "serial: demo", "serial: demo\n    period: 2", "arms[0].period", "2", "up to 0.1"),
        # words
        (SYSTEM, "port: udp", "port: usb", "IOs[0].port", '"usb"', "udp[:IP], udpfw[:IP]"),
        (SYSTEM, "name: PSM1", "name: PSM 1", "arms[0].name", '"PSM 1"', "letters, digits, _ and -"),
        (ARM, "generation: Classic", "generation: Xi", "generation", '"Xi"', '"Classic", "Si"'),
        (SYSTEM, "trocar:", "settings: {path: [nowhere]}\ntrocar:", "settings.path[0]", '"nowhere"', "a folder"),
        # versions and kinds
        (IO, '$version: "6"', "$version: 6.0", "$version", "6.0", 'the text "6"'),
        (ARM, "$id: dvrk-psm.schema.json", "$id: dvrk-ecm.schema.json", "$id", '"dvrk-ecm.schema.json"', "dvrk-psm"),
        # serial numbers and names
        (SYSTEM, "serial: demo", 'serial: "28007"', "robots[0].serial_number", '"demo"', '"28007"'),
        (SYSTEM, "serial: demo", "serial: demo\n    name_on_IO: PSM2", "arms[0].name_on_IO", '"PSM2"', "PSM1"),
        (SYSTEM, "arms:", "arm:", "arm", "a list of 1", "arms"),
        (SYSTEM, "IO: IO1", "IO: IO2", "arms[0].IO", '"IO2"', "one of IO1"),
        (SYSTEM, "serial: demo\n    IO: IO1", "IO: IO1", "arms[0].serial", "", "a text"),
        (SYSTEM, "name: PSM1", "name: boards\n    name_on_IO: PSM1", "arms[0].name", '"boards"', "a unique name"),
        (SYSTEM, "name: PSM1", "name: IO1\n    name_on_IO: PSM1", "arms[0].name", '"IO1"', "a unique name"),
        # what must fit together
        (IO, "axis_id: 1", "axis_id: 0", "robots[0].actuators[1].axis_id", "0", "only once"),
        (IO, "name: PSM1_tool", "name: PSM1_adapter", "digital_inputs[3].name", '"PSM1_adapter"', "only once"),
        (IO, "number_of_actuators: 7", "number_of_actuators: 6", "robots[0].number_of_actuators", "6", "7"),
        (IO, "number_of_brakes: 0", "number_of_brakes: 3", "robots[0].number_of_brakes", "3", "0"),
        (IO, "lower: -1.58825", "lower: 1.6", "robots[0].actuators[0].encoder.position_limits_soft.lower", "1.6",
         "1.588"),
        (IO, "scale: -1.907", "scale: 1.907", f"{DRIVE}.bits_to_current.scale", "0.00019", ""),
        (IO, "effort_to_current: {scale: 0.40408938}", "effort_to_current: {offset: 0}",
         f"{DRIVE}.effort_to_current.scale", "", "A per N·m"),
        (IO, "scale: -7.722695805e-6", "scale: 0", "robots[0].actuators[0].encoder.bits_to_position.scale", "0", ""),
        (IO, "version: QLA1", "version: HARDWARE_UNDEFINED", "robots[0].hardware_version", '"HARDWARE_UNDEFINED"',
         "QLA1, DQLA or dRA1"),
        (PID, "index: 2", "index: 3", "pid[2].index", "3", "2"),
        (PID, "type: PRISMATIC", "type: REVOLUTE", "pid[2].type", '"REVOLUTE"', "PRISMATIC"),
        (PID, "name: disc_2", "name: disc_1", "pid[4].name", '"disc_1"', "a unique name"),
        (CHAIN, "qmin: -1.588", "qmin: 1.6", "DH.joints[0].qmin", "1.6", "at most 1.588"),
        (TOOL, "- [0, 0, 1, 0]", "- [0, 0, 1.1, 0]", "tooltip_offset", "[[0", "orthonormal"),
        (TOOL, "- [0, 0, -1.2177, 1.2177]", "- [0, 0, 0, 0]", "coupling.ActuatorToJointPosition", "a list of 4",
         "invertible"),
        (TOOL, "- [0, 0, -1.2177, 1.2177]", "- [0, 0, 1]", "coupling.ActuatorToJointPosition", "a list of 4",
         "4 rows of 4"),
        (ARM, "LARGE_NEEDLE_DRIVER:400006", "SCISSORS:1", "tool", '"SCISSORS:1"', "LARGE_NEEDLE_DRIVER:400006"),
        (ARM, 'tool: "LARGE_NEEDLE_DRIVER:400006"', "re_home: true", "tool", "", "NAME:MODEL"),
        # missing keys and files
        (IO, "velocity_source: FIRMWARE", "_has: 1", "robots[0].actuators[0].encoder.velocity_source", "", "SOFTWARE"),
        (PID, "p_gain: 120, ", "", "pid[0].p_gain", "", "a number"),
        (SYSTEM, "pid/PSM.yaml", "pid/PSM9.yaml", "arms[0].PID_file", '"pid/PSM9.yaml"', "search path"),
        (SYSTEM, "io/PSM1-demo.yaml", "io/x.json", "arms[0].IO_file", '"io/x.json"', "search path"),
        (SYSTEM, "arms/PSM1-demo.yaml", "arms/x.json", "arms[0].arm_file", '"arms/x.json"', "search path"),
        (ARM, "kinematic/PSM.yaml", "kinematic/x.json", "kinematic", '"kinematic/x.json"', "search path"),
        (INDEX, "file: LARGE_NEEDLE_DRIVER_400006.yaml", "file: x.json", "tool", '"LARGE_', "search path"),
        # the section of Trocar
        (SYSTEM, "boards: emulated", "board: emulated", "trocar.board", '"emulated"', "boards"),
        (SYSTEM, "boards: emulated", "clock: lockstep", "trocar.clock", '"lockstep"', "wall"),
        (SYSTEM, "boards: emulated", "group: nobodies", "trocar.group", '"nobodies"', "a group of this machine"),
        (SYSTEM, "boards: emulated", "service_user: nbdy", "trocar.service_user", '"nbdy"', "a user of this machine"),
        (SYSTEM, "boards: emulated", "io: {spin_us: 51}", "trocar.io.spin_us", "51", "up to 50"),
        (SYSTEM, "boards: emulated", "processes: {PSM2: {cpu: 1}}", "trocar.processes.PSM2", '{"cpu": 1}', "IO1, PSM1"),
        (SYSTEM, "serial: demo", "serial: demo\n    simulation: DYNAMIC", "arms[0].simulation", '"DYNAMIC"', "NONE"),
    ],
)
def test_mistake_is_named_with_its_place(
        home: Home, file: str, old: str, new: str, key: str, value: str, allowed: str) -> None:
    line = home.edit(file, old, new)
    problem = home.error()
    assert problem.key == key
    assert problem.value.startswith(value) and bool(problem.value) == bool(value)
    assert allowed in problem.allowed
    placed_in = Path(problem.file).relative_to(home.path)
    assert problem.line > 0
    if str(placed_in) == file and problem.value and "\n" not in old:
        assert abs(problem.line - line) <= 4  # a missing key or a list stands at what surrounds it
    assert "\n" not in str(problem) and f"{problem.file}:{problem.line}: error: {key}" in str(problem)


def test_exact_line_of_a_plain_value(home: Home) -> None:
    line = home.edit(IO, "maximum_current: 0.67", "maximum_current: lots")
    problem = home.error()
    assert problem.line == line
    assert str(problem) == (
        f'{home.path / IO}:{line}: error: robots[0].actuators[2].drive.maximum_current = "lots": wrong type; '
        "allowed: a number from 0.0 up to 20.0 (A)"
    )


def test_all_mistakes_are_told_at_once(home: Home) -> None:
    home.edit(IO, "board_id: 6", "board_id: 60")
    home.edit(PID, "p_gain: 120", "p_gain: much")
    home.edit(TOOL, "qmin: -0.698132", "qmin: 7")
    home.edit(SYSTEM, "boards: emulated", "bords: emulated")
    keys = {problem.key for problem in home.load().errors}
    assert keys >= {"robots[0].actuators[0].board_id", "pid[0].p_gain", "jaw.qmin", "trocar.bords"}


def test_uncalibrated_controllers_are_refused(home: Home) -> None:
    file = home.path / IO
    lines = [
        line.split("offset:")[0] + "offset: 32768.4}" if "current_to_bits" in line else line
        for line in file.read_text().splitlines()
    ]
    file.write_text("\n".join(lines))
    problem = home.error()
    assert "not calibrated" in problem.text and "calibration_mode: true" in problem.allowed
    assert "trocar commission SYSTEM, stage currents, measures them" in problem.allowed
    assert problem.key == f"{DRIVE}.current_to_bits.offset"
    loaded = home.load(sets=["calibration_mode=true"])
    assert loaded.system is not None and loaded.errors == ()
    assert [warning.text for warning in loaded.warnings] == [problem.text]
    assert loaded.system.ios[0].calibration_mode and loaded.system.arms[0].calibration_mode
    assert any("calibration mode" in note for note in loaded.system.notes)


def test_a_gripper_whose_potentiometer_is_not_calibrated_is_refused(home: Home) -> None:
    drive = {"current_to_bits": {"scale": 5242.88, "offset": 32768}, "bits_to_current": {"scale": 1.9e-4}}
    pot = {"bits_to_voltage": {"scale": 6.87e-5}, "voltage_to_position": {}}
    actuator = {"board_id": 1, "axis_id": 3, "drive": drive, "potentiometer": pot}
    robot = {"name": "G", "serial_number": "1", "hardware_version": "QLA1", "number_of_actuators": 1,
             "actuators": [actuator], "number_of_brakes": 0}
    file = {"$id": "saw-robot-io.schema.json", "$version": "6", "robots": [robot]}
    system = {"IOs": [{"name": "IO1", "port": "udp", "configuration_files": ["gripper.json"]}]}
    (home.path / "gripper.json").write_text(json.dumps(file))
    loaded = home.load_made(system)
    assert [problem.key for problem in loaded.errors] == ["robots[0].actuators[0].potentiometer.voltage_to_position"]
    assert home.load_made({**system, "trocar": {"calibration_mode": True}}).errors == ()
    for calibrated in ({"scale": 0.5}, {"offset": 0.1}):
        pot["voltage_to_position"] = calibrated
        (home.path / "gripper.json").write_text(json.dumps(file))
        assert home.load_made(system).errors == ()
    pot["voltage_to_position"] = {}
    robot["hardware_version"] = "dRA1"  # whose potentiometers are not analog
    (home.path / "gripper.json").write_text(json.dumps(file))
    assert home.load_made(system).errors == ()


@pytest.mark.parametrize(("file", "old", "new", "key", "nearest"), [
    (TOOL, "qmin: -0.698132", "qmin: -0.698132, Qmin: 1", "jaw.Qmin", "qmin"),
    (ARM, "generation:", "mountingPitch: 0\ngeneration:", "mountingPitch", "mounting_pitch")])
def test_unknown_key_warns_with_nearest_name(home: Home, file: str, old: str, new: str, key: str, nearest: str) -> None:
    home.edit(file, old, new)
    warning = home.warning()
    assert warning.key.endswith(key) and warning.file == str(home.path / file) and warning.line > 0
    assert warning.severity == "warning"
    if nearest:
        assert f'did you mean "{nearest}"?' in warning.text


@pytest.mark.parametrize(("old", "new", "text"), [
    ("port: udp", "port: udp\n    period: 0.002", "1 ms or less"),
    ("port: udp", "port: udp\n    watchdog_timeout: 0.5", "0.3 s is used instead"),
    ("port: udp", "port: udp\n    watchdog_timeout: 0", "watchdog of the boards is off")])
def test_doubtful_values_only_warn(home: Home, old: str, new: str, text: str) -> None:
    home.edit(SYSTEM, old, new)
    warning = home.warning()
    assert text in warning.text


def test_watchdog_is_capped_and_can_be_off(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: udp\n    watchdog_timeout: 0.5")
    capped = home.load().system
    home.edit(SYSTEM, "watchdog_timeout: 0.5", "watchdog_timeout: -1")
    off = home.load().system
    assert capped is not None and off is not None
    assert (capped.ios[0].watchdog_s, off.ios[0].watchdog_s) == (0.3, 0.0)


def test_a_motor_without_a_range_warns_that_its_arm_does_not_home(home: Home) -> None:
    home.edit(IO, "{lower: -1.58825, upper: 1.58825}", "{lower: 0, upper: 0}")
    (warning,) = home.load().warnings
    assert warning.key.endswith("encoder.position_limits_soft") and "the arm does not home" in warning.text


def test_two_arms_cannot_share_a_robot(home: Home) -> None:
    arm = "  - {name: PSM2, name_on_IO: PSM1, type: PSM, serial: demo, IO: IO1, arm_file: arms/PSM1-demo.yaml,\n"
    arm += "     IO_file: io/PSM1-demo.yaml}\n"
    home.edit(SYSTEM, "\ntrocar:", f"{arm}\ntrocar:")
    problem = home.error()
    assert problem.key == "arms[1].name_on_IO" and "PSM1" in problem.text


def test_arms_on_one_bus_cannot_share_axes(home: Home) -> None:
    second = (home.path / IO).read_text().replace("PSM1", "PSM2")
    (home.path / "io/PSM2-demo.yaml").write_text(second)
    arm = "  - {name: PSM2, type: PSM, serial: demo, IO: IO1, arm_file: arms/PSM1-demo.yaml,\n"
    arm += "     IO_file: io/PSM2-demo.yaml}\n"
    home.edit(SYSTEM, "\ntrocar:", f"{arm}\ntrocar:")
    errors = home.load().errors
    assert len(errors) == 7
    assert "board 6 axis 0 is used twice" in errors[0].text and "PSM1-demo.yaml:" in errors[0].text


@pytest.mark.parametrize(("console", "key"), [
    ("{name: c, input_type: PEDALS_ONLY}", "consoles[0].IO_pedals"),
    ("{name: c, input_type: SIMULATED, teleop_PSMs: [{MTM: M, PSM: PSM1}]}", "consoles[0].teleop_PSMs[0].MTM"),
    ("{name: c, input_type: PEDALS_ONLY, IO_pedals: {IO: IO9, IO_file: io/PSM1-demo.yaml}}",
     "consoles[0].IO_pedals.IO"),
    ("{name: PSM1, input_type: SIMULATED}", "consoles[0].name"),
    ("{name: c, input_type: FEET}", "consoles[0].input_type")])
def test_consoles_are_checked(home: Home, console: str, key: str) -> None:
    home.edit(SYSTEM, "\ntrocar:", f"\nconsoles: [{console}]\ntrocar:")
    assert home.error().key == key


@pytest.mark.parametrize("frame", [
    "{reference_frame: ECM}", "{component: SUJ}",
    "{reference_frame: ECM, transform: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]], component: SUJ, interface: PSM1}",
    "{reference_frame: ECM, transform: [[1,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]}",
    "{reference_frame: ECM, transform: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]}",
    "{reference_frame: ECM, transform: [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}"])
def test_half_or_crooked_base_frame_is_refused(home: Home, frame: str) -> None:
    home.edit(SYSTEM, "serial: demo", f"serial: demo\n    base_frame: {frame}")
    assert home.error().key.startswith("arms[0].base_frame")


def test_one_board_cannot_be_of_two_kinds(home: Home) -> None:
    other = (home.path / IO).read_text().replace("QLA1", "DQLA").replace("PSM1", "OTHER")
    for axis in range(4):
        other = other.replace(f"axis_id: {axis}\n", f"axis_id: {axis + 4}\n")
    (home.path / "io/other.yaml").write_text(other)
    home.edit(SYSTEM, "port: udp", "port: udp\n    configuration_files: [io/other.yaml]")
    problem = home.error()
    assert problem.key == "robots[0].hardware_version"
    assert "board 6 is DQLA for robot OTHER" in problem.text and problem.value == '"QLA1"'


def test_axis_without_current_limit_warns(home: Home) -> None:
    home.edit(IO, "maximum_current: 1.34", "_remark: 1.34")
    loaded = home.load()
    assert loaded.system is not None
    assert [problem.key for problem in loaded.warnings] == [f"{DRIVE}._remark", f"{DRIVE}.maximum_current"]


SLIPS = [  # file, text, its slip, what it should be
    (IO, "offset: 32955.0", "offst: 32955.0", "offset"),
    (IO, "maximum_current:", "maximum_curent:", "maximum_current"),
    (IO, "effort_to_current:", "Effort_to_current:", "effort_to_current"),
    (IO, "potentiometer:", "potentiometr:", "potentiometer"),
    (PID, "i_gain: 0", "i_gain: 0, i_limits: 3", "i_limit"),
    (CHAIN, "offset:", "offsets:", "offset"),
]


@pytest.mark.parametrize(("file", "old", "new", "meant"), SLIPS)
def test_a_slip_in_a_calibration_a_gain_or_a_limit_is_an_error(
        home: Home, file: str, old: str, new: str, meant: str) -> None:
    line = home.edit(file, old, new)
    slips = [problem for problem in home.load().errors if "did you mean" in problem.text]
    name = new.split(":")[-2].split()[-1]
    assert [(problem.line, problem.key.rpartition(".")[2]) for problem in slips] == [(line, name)]
    assert f'"{meant}"' in slips[0].text


@pytest.mark.parametrize(("file", "old", "new"), [
    (ARM, "tool_detection:", "tool_detections:"),  # a slip, but no calibration
    (CHAIN, "DH:", "colour: red\nDH:"),  # no slip
])
def test_other_unknown_keys_are_warnings(home: Home, file: str, old: str, new: str) -> None:
    home.edit(file, old, new)
    loaded = home.load()
    assert loaded.errors == () and "unknown key, ignored" in loaded.warnings[0].text


def test_a_slip_beside_the_key_itself_takes_nothing_away(home: Home) -> None:
    home.edit(CHAIN, "offset:", "offst: 3.0, offset:")
    assert home.load().errors == ()


@pytest.mark.parametrize(("factor", "reported"), [(1.0, 0), (1.04, 0), (0.96, 0), (1.06, 1), (0.94, 1)])
def test_scales_that_undo_each_other_by_more_than_5_percent_are_doubted(home: Home, factor: float,
                                                                        reported: int) -> None:
    home.edit(IO, "scale: -1.907", f"scale: {factor * -1.907:.5f}")
    loaded = home.load()
    assert loaded.errors == () and sum("not the inverse" in warning.text for warning in loaded.warnings) == reported
