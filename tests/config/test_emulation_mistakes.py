"""Mistakes in the emulation section: each is reported with its place, and what would be right."""

from __future__ import annotations

import pytest

from tests.config.conftest import SYSTEM, Home, Section

BUS = "trocar.emulation.buses.IO1"
MISTAKES: list[tuple[Section, str, str, str, str]] = [  # section, hardware, key, text, allowed
    ({"firmware": "8"}, "QLA1", "trocar.emulation.firmware", "wrong type", "one of 7, 8, 9"),
    ({"quirks": {"direction": True}}, "QLA1", "trocar.emulation.quirks.direction", "direction_lag", "sticky_overflow"),
    ({"hardware": "QLA1"}, "QLA1", "trocar.emulation.hardware", "unknown key", "firmware"),
    # what was never made
    ({"firmware": 7, "fpga": "V3"}, "QLA1", "trocar.emulation.fpga", "no firmware 7 for a QLA1 on FPGA V3", "V2"),
    ({"firmware": 7}, "dRA1", "trocar.emulation.firmware", "no firmware 7 for a dRA1", "8 or 9"),
    ({"firmware": 7}, "DQLA", "trocar.emulation.firmware", "no firmware 7 for a DQLA", "8 or 9"),
    ({"fpga": "V2"}, "dRA1", "trocar.emulation.fpga", "no firmware 8 for a dRA1 on FPGA V2", "V3"),
    ({"qla": "1.5", "firmware": 7}, "QLA1", "trocar.emulation.qla", "does not support QLA 1.5", "firmware 8 or 9"),
    ({"testboard": True}, "dRA1", "trocar.emulation.testboard", "not a dRA1 (board 6, 7 of IO1)", "false"),
    # without FireWire
    ({"network": "ethernet", "firmware": 8}, "QLA1", "trocar.emulation.firmware", "needs FireWire",
     "9 or later, or network"),
    ({"network": "ethernet", "fpga": "V2"}, "QLA1", "trocar.emulation.fpga", "needs FireWire with FPGA V2", "V3"),
    ({"network": "ethernet", "buses": {"IO1": {"controllers": {"7": {"firmware": 7}}}}}, "QLA1",
     f"{BUS}.controllers.7.firmware", "board 7 of IO1 needs FireWire", "9"),
    # buses and boards
    ({"buses": {"IO2": {}}}, "QLA1", "trocar.emulation.buses.IO2", "no IO of this name", "one of IO1"),
    ({"buses": {"IO1": {"controllers": {"16": {}}}}}, "QLA1", f"{BUS}.controllers.16", "no board", "0 to 15"),
    ({"buses": {"IO1": {"controllers": {"07": {}}}}}, "QLA1", f"{BUS}.controllers.07", "no board", "0 to 15"),
    ({"buses": {"IO1": {"controllers": {"7": {"fw": 8}}}}}, "QLA1", f"{BUS}.controllers.7.fw", "unknown", "firmware"),
    ({"buses": {"IO1": {"hub": 3}}}, "QLA1", f"{BUS}.hub", "no such board", "one of 6, 7"),
    ({"buses": {"IO1": {"controllers": {"7": {"hardware": "DQLA"}}}}}, "QLA1", f"{BUS}.controllers.7.hardware",
     "board 7 of IO1 is a QLA1 in its IO file", "QLA1"),
    ({"buses": {"IO1": {"controllers": {"6": {"qla": "1.5"}}}}}, "dRA1", f"{BUS}.controllers.6.qla",
     "it has no QLA", "nothing"),
    ({"buses": {"IO1": {"controllers": {"6": {"serial": "123456"}}}}}, "QLA1", f"{BUS}.controllers.6.serial",
     "not allowed", "dddd-dd"),
    ({"buses": {"IO1": {"controllers": {str(board): {} for board in range(16)}}}}, "QLA1", f"{BUS}.controllers",
     "the 16 boards of IO1 have 529 quadlets in hub memory", "up to 506: 15 QLA1"),
    # addresses
    ({"buses": {"IO1": {"address": "eth:veth1"}}}, "QLA1", "IOs[0].port", "on raw Ethernet", "eth:INTERFACE"),
    ({"buses": {"IO1": {"address": "eth:"}}}, "QLA1", f"{BUS}.address", "not an address", "eth:INTERFACE"),
    ({"buses": {"IO1": {"address": "10.0.0.1"}}}, "QLA1", f"{BUS}.address", "not an address", "127.x.y.z"),
    ({"buses": {"IO1": {"address": "127.1.2.255"}}}, "QLA1", f"{BUS}.address", "not an address", "1 to 254"),
    ({"firmware": 9, "buses": {"IO1": {"address": "127.1.2.250"}}}, "QLA1", f"{BUS}.address",
     "board 7 of IO1 has this address plus 7", "up to 127.1.2.247"),
    # robots
    ({"robots": {"PSM2": {}}}, "QLA1", "trocar.emulation.robots.PSM2", "no robot of this name", "one of PSM1"),
    ({"robots": {"PSM1": {"payload": 6}}}, "QLA1", "trocar.emulation.robots.PSM1.payload", "out of", "up to 5.0 (kg"),
    ({"robots": {"PSM1": {"backlash": [0.01]}}}, "QLA1", "trocar.emulation.robots.PSM1.backlash", "1 values",
     "7, one an actuator"),
    ({"robots": {"PSM1": {"pot_offset": [0, 0, 0, 0, 0, 0, 11]}}}, "QLA1",
     "trocar.emulation.robots.PSM1.pot_offset[6]", "out of range", "up to 10.0"),
    ({"instruments": {"PSM9": ":1"}}, "QLA1", "trocar.emulation.instruments.PSM9", "no arm of this name", "PSM1"),
]


@pytest.mark.parametrize(("section", "hardware", "key", "text", "allowed"), MISTAKES)
def test_mistake_is_named_with_its_place(
        home: Home, section: Section, hardware: str, key: str, text: str, allowed: str) -> None:
    errors = home.emulate(section, hardware).errors
    assert {problem.key for problem in errors} == {key}
    problem = errors[0]
    assert text in problem.text and allowed in problem.allowed
    line = (home.path / "made.json").read_text().splitlines()[problem.line - 1]
    assert problem.file == str(home.path / "made.json")
    assert (problem.value if key.endswith("]") else f'"{key.rpartition(".")[2]}"') in line


def test_infinite_numbers_are_no_numbers(home: Home) -> None:
    home.edit(SYSTEM, "boards: emulated", "boards: emulated\n  emulation: {robots: {PSM1: {friction: .inf}}}")
    problem = home.error()
    assert problem.key == "trocar.emulation.robots.PSM1.friction" and problem.text == "not a finite number"


def test_axes_must_exist_on_what_a_board_is_taken_for(home: Home) -> None:
    other = (home.path / "io/PSM1-demo.yaml").read_text()
    for old, new in (("QLA1", "HARDWARE_UNDEFINED"), ("PSM1", "other"), ("board_id: 6", "board_id: 3")):
        other = other.replace(old, new)
    (home.path / "io/other.yaml").write_text(other.replace("axis_id: 3", "axis_id: 5"))
    home.edit(SYSTEM, "port: udp", "port: udp\n    configuration_files: [io/other.yaml]")
    home.edit(SYSTEM, "boards: emulated", "boards: emulated\n  emulation: {}")
    errors = [problem for problem in home.load().errors if problem.key == "robots[0].hardware_version"]
    assert any("board 3 of IO1 has no axis 5 as a QLA1" in p.text and p.allowed == "DQLA or dRA1" for p in errors)


def two_buses_with_the_same_files(home: Home) -> None:
    """PSM1 and a button on IO1; the same files on IO2."""
    (home.path / "io/again.yaml").write_text((home.path / "io/PSM1-demo.yaml").read_text())
    second = "  - {name: IO2, port: udp, configuration_files: [io/again.yaml]}\n"
    home.edit(SYSTEM, "    port: udp\n", f"    port: udp\n{second}")


def test_robots_of_one_name_on_two_buses_go_by_their_bus_as_well(home: Home) -> None:
    two_buses_with_the_same_files(home)
    assert home.load(boards="real").errors == ()
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    boards = loaded.system.emulated()
    assert [[robot.name for robot in io.robots] for io in boards.ios] == [["IO1/PSM1"], ["IO2/PSM1"]]
    assert boards.arm("PSM1").robot == "IO1/PSM1" and boards.ios[0].pids[0].robot == "IO1/PSM1"
    assert [io.robots[0].name for io in loaded.system.ios] == ["PSM1", "PSM1"], "on its bus it keeps its name"


def test_which_of_two_robots_differs_from_its_files_must_be_said(home: Home) -> None:
    two_buses_with_the_same_files(home)
    line = home.edit(SYSTEM, "boards: emulated", "boards: emulated\n  emulation: {robots: {PSM1: {payload: 1.0}}}") + 1
    problem = home.error()
    assert (problem.line, problem.allowed) == (line, "one of IO1/PSM1, IO2/PSM1")
    home.edit(SYSTEM, "robots: {PSM1", "robots: {IO2/PSM1")
    assert home.load().errors == ()


@pytest.mark.parametrize(("buses", "key", "text"), [
    ({"a": {}}, "trocar.emulation.buses.a.controllers", "needs controllers"),
    ({"a b": {"controllers": {"0": {}}}}, "trocar.emulation.buses.a b", "not a name"),
    ({"a": {"address": "0.0.0.0", "controllers": {"0": {}}}, "b": {"controllers": {"0": {}}}},
     "trocar.emulation.buses.a.address", "leaves no address"),
    ({ "a": {"address": "127.1.1.10", "firmware": 9, "controllers": {"0": {}, "4": {}}}, "b": {"address": "127.1.1.14",
     "controllers": {"0": {}}}, }, "trocar.emulation.buses.b.address", "127.1.1.14 belongs to a"),
    ({ "a": {"address": "127.1.1.32", "network": "ethernet", "controllers": {"0": {}}}, "b": {"address": "127.1.1.47",
     "controllers": {"0": {}}}, }, "trocar.emulation.buses.b.address", "127.1.1.47 belongs to a"),
    ({str(n): {"controllers": {"0": {}}} for n in range(16)}, "trocar.emulation.buses", "16 buses"),
    ({name: {"address": "eth:veth1", "controllers": {"0": {}}} for name in "ab"}, "trocar.emulation.buses.b.address",
     "eth:veth1 belongs to a")])
def test_buses_must_not_disturb_each_other(home: Home, buses: Section, key: str, text: str) -> None:
    loaded = home.load_made({"trocar": {"boards": "emulated", "emulation": {"buses": buses}}})
    assert [problem.key for problem in loaded.errors] == [key] and text in loaded.errors[0].text


@pytest.mark.parametrize(("old", "new"), [
    ("port: udp", "port: udp\n    period: 1.5"), ("boards: emulated", "boards: emulated\n  io: {period_s: 5}")])
def test_a_number_out_of_range_hides_no_other_mistake(home: Home, old: str, new: str) -> None:
    home.edit(SYSTEM, "boards: emulated", "boards: emulated\n  emulation: {buses: {IO2: {}}, robots: {PSM2: {}}}\n"
                                          "  processes: {PSM2: {cpu: 1}}")
    home.edit(SYSTEM, old, new)
    texts = " ".join(problem.text for problem in home.load().errors)
    assert all(text in texts for text in ("out of range", "no IO of this name", "no robot of this name is emulated",
                                          "no process of this name is started"))
