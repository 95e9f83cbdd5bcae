"""Which controllers emulated buses have: from IO files alone, and changed by the section of the system file."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.config.conftest import SYSTEM, Home, Section
from trocar.procs.config import load_system
from trocar.procs.config.models.trocar_section import QuirkKeys
from trocar.procs.document import system as document


def _system(home: Home, section: Section, hardware: str = "QLA1", **keys: object) -> document.SystemConfig:
    loaded = home.emulate(section, hardware, **keys)
    system = loaded.system
    assert system is not None, [str(problem) for problem in loaded.errors]
    assert document.from_json(document.to_json(system)) == system
    return system


def _bus(home: Home, section: Section, hardware: str = "QLA1", **keys: object) -> document.BusConfig:
    emulation = _system(home, section, hardware, **keys).emulation
    assert emulation is not None
    (bus,) = emulation.buses
    return bus


IO_FILES = {  # boards of each file; hardware, FPGA and the Si arm's serial number
    "dvrk-share/io/sawRobotIO1394-MTML-foot-pedals-QLA1.json": ([1], "QLA1", "V2", ""),
    "dvrk-share/io/sawRobotIO1394-MTMR-dv-head-sensor.json": ([2], "QLA1", "V2", ""),
    "dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json": ([3], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-MTML-22723.json": ([0, 1], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-MTML-gripper-22723.json": ([1], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-MTMR-22403.json": ([2, 3], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-MTMR-gripper-22403.json": ([3], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-PSM1-28007.json": ([6, 7], "QLA1", "V2", ""),
    "dvrk-site/jhu-dVRK/sawRobotIO1394-PSM2-contact-sensor.json": ([9], "QLA1", "V2", ""),
    "dvrk-site/jhu-daVinci/sawRobotIO1394-ECM-29738.json": ([4, 5], "QLA1", "V2", ""),
    "dvrk-site/jhu-daVinci/sawRobotIO1394-SUJ.json": ([12], "QLA1", "V2", ""),
    "dvrk-site/jhu-daVinci-Si/sawRobotIO1394-ECM-438610.json": ([4], "dRA1", "V3", "e438610.cal"),
    "dvrk-site/jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json": ([6], "dRA1", "V3", "p292409.cal"),
}


def _with_files(home: Home, *files: Path) -> document.SystemConfig:
    """A system whose only bus has these IO files and no arm."""
    bus = {"name": "bus", "port": "fw", "configuration_files": [str(file) for file in files]}
    loaded = home.load_made({"IOs": [bus]}, boards="emulated")
    assert loaded.system is not None and loaded.system.emulation is not None, [str(p) for p in loaded.errors]
    assert [row.name for row in loaded.system.processes] == ["boards", "bus", "system"]
    assert loaded.system.emulated() is loaded.system, "io drives all there is"
    return loaded.system


def _emulation(system: document.SystemConfig) -> document.EmulationConfig:
    assert system.emulation is not None
    return system.emulation


@pytest.mark.parametrize("name", IO_FILES)
def test_every_io_file_has_its_controllers(name: str, data: Callable[[str], Path], home: Home) -> None:
    boards, hardware, fpga, serial = IO_FILES[name]
    (bus,) = _emulation(_with_files(home, data(name))).buses
    expected = [document.Controller(board, hardware, 8, fpga, robot_serial=serial) for board in boards]
    assert list(bus.controllers) == expected
    assert (bus.io, bus.network, bus.testboard) == ("bus", "bridge", False)


def test_the_table_of_io_files_is_complete(data: Callable[[str], Path]) -> None:
    root = data("dvrk-site").parent
    found = {str(path.relative_to(root)) for path in root.rglob("sawRobotIO1394-*.json")}
    assert {name for name in found if "LookupTable" not in name} == set(IO_FILES)


def test_boards_are_the_union_of_all_files_of_a_bus(data: Callable[[str], Path], home: Home) -> None:
    system = _with_files(home, *(data(name) for name in IO_FILES if not re.search("Si|MTMR-foot", name)))
    assert [c.board_id for c in _emulation(system).buses[0].controllers] == [0, 1, 2, 3, 4, 5, 6, 7, 9, 12]


def test_brakes_and_readers_stand_as_in_the_file(data: Callable[[str], Path], home: Home) -> None:
    (io,) = _with_files(home, data("dvrk-site/jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json")).ios
    (robot,) = io.robots
    assert io.instrument_readers == (document.InstrumentReader("PSM1_dallas", 6),)
    assert [(brake.board_id, brake.axis_id) for brake in robot.brakes] == [(6, 7), (6, 8), (6, 9)]
    assert robot.brakes[0] == document.Brake(
        6, 7, document.Linear(16000.0, 32768.0), document.Linear(6.25e-05, -2.048), 0.2, 0.15, 0.5, 0.08, 0.0)
    third = robot.brakes[2]
    assert third.current_to_bits == document.Linear(16000.0, -32768.0), "outside 16 bits: it is meant modulo 65536"
    assert (third.maximum_current, third.release_current) == (0.3, -0.25)


def test_a_driven_robot_knows_its_reader_too(data: Callable[[str], Path]) -> None:
    system = load_system(data("dvrk-site/jhu-dVRK/system-PSM1.json"), boards="emulated").system
    assert system is not None and system.emulation is not None
    assert system.ios[0].instrument_readers == (document.InstrumentReader("PSM1_dallas", 7),)
    assert system.emulated() is system, "one arm, one file: nothing more hangs on these boards"


def test_io_drives_all_robots_of_its_files_and_controls_those_of_arms(data: Callable[[str], Path]) -> None:
    path = data("dvrk-site/jhu-dVRK/system-MTML-PSM1-Teleop.json")
    system = load_system(path, search=[data("dvrk-share")], boards="emulated").system
    assert system is not None
    assert [robot.name for robot in system.ios[0].robots] == ["PSM1", "MTML", "MTML_gripper"]
    assert [pid.robot for pid in system.ios[0].pids] == [a.name for a in system.arms] == ["PSM1", "MTML"]
    assert {"clutch", "PSM1_tool"} <= {button.name for button in system.ios[0].digital_inputs}
    seen = system.emulated()
    assert [arm.name for arm in seen.arms] == ["PSM1", "MTML"]
    assert seen.ios[0].robots == system.ios[0].robots and seen.processes == system.processes
    real = load_system(path, search=[data("dvrk-share")]).system
    assert real is not None and real.emulated() is real


def test_without_a_section_boards_are_those_of_the_files(home: Home) -> None:
    bus = _bus(home, {})
    assert bus.controllers == (document.Controller(6), document.Controller(7))
    assert (bus.network, bus.testboard) == ("bridge", False)


@pytest.mark.parametrize(("firmware", "fpga"), [(7, "V2"), (8, "V2"), (8, "V3"), (9, "V2"), (9, "V3")])
def test_firmware_and_fpga_hold_for_all(home: Home, firmware: int, fpga: str) -> None:
    bus = _bus(home, {"firmware": firmware, "fpga": fpga})
    assert {(c.firmware, c.fpga) for c in bus.controllers} == {(firmware, fpga)}


def test_the_nearest_word_counts(home: Home) -> None:
    section: Section = {
        "firmware": 8, "qla": "1.5", "quirks": {"direction_lag": False, "sticky_overflow": False},
        "buses": {"IO1": {
            "fpga": "V3", "quirks": {"sticky_overflow": True},
            "controllers": {"7": {"firmware": 9, "qla": "1.4", "serial": "1234-56", "quirks": {"direction_lag": True}}},
        }},
    }
    six, seven = _bus(home, section).controllers
    assert (six.firmware, six.fpga, six.qla, six.serial) == (8, "V3", "1.5", "")
    assert (seven.firmware, seven.fpga, seven.qla, seven.serial) == (9, "V3", "1.4", "1234-56")
    assert six.quirks == document.Quirks(direction_lag=False)
    assert seven.quirks == document.Quirks()


def test_every_quirk_has_a_key() -> None:
    assert list(QuirkKeys.model_fields) == [field.name for field in dataclasses.fields(document.Quirks)]


def test_ethernet_brings_what_it_needs(home: Home) -> None:
    sections: tuple[Section, ...] = ({"network": "ethernet"}, {"buses": {"IO1": {"network": "ethernet"}}})
    for section in sections:
        bus = _bus(home, section)
        assert bus.network == "ethernet" and {(c.firmware, c.fpga) for c in bus.controllers} == {(9, "V3")}
    assert _bus(home, {"network": "ethernet", "buses": {"IO1": {"network": "bridge"}}}).network == "bridge"


@pytest.mark.parametrize(("section", "port"), [
    ({"buses": {"IO1": {"address": "127.3.4.5"}}}, "udp:127.3.4.5"),
    ({"firmware": 9, "buses": {"IO1": {"address": "127.3.4.5"}}}, "udp:127.3.4.5"),
    ({"firmware": 9, "fpga": "V3", "buses": {"IO1": {"address": "127.3.4.5"}}}, "udpfw:127.3.4.5"),
    ({"network": "ethernet", "buses": {"IO1": {"address": "127.3.4.5"}}}, "udp:127.3.4.5"),
    ({"buses": {"IO1": {"address": "0.0.0.0"}}}, "udp:127.0.0.1")])
def test_io_is_led_to_the_emulated_bus(home: Home, section: Section, port: str) -> None:
    system = _system(home, section)
    assert system.ios[0].port == port
    assert system.notes[-1].startswith("IO1: port udp replaced by emulated boards 6, 7 at ")


def test_the_port_to_boards_on_raw_ethernet_stays_as_it_is_written(home: Home) -> None:
    on_cable: Section = {"buses": {"IO1": {"address": "eth:veth1"}}}
    system = _system(home, on_cable, port="eth:veth0")
    assert system.ios[0].port == "eth:veth0" and system.emulation is not None
    assert system.emulation.buses[0].address == "eth:veth1"
    assert system.notes[-1] == "IO1: emulated boards 6, 7 at eth:veth1"


def test_extra_boards_join_and_the_hub_comes_first(home: Home) -> None:
    section: Section = {"buses": {"IO1": {"hub": 7, "controllers": {"10": {}, "3": {"hardware": "DQLA"}}}}}
    system = _system(home, section)
    assert system.emulation is not None
    rows = [(c.board_id, c.hardware, c.fpga) for c in system.emulation.buses[0].controllers]
    assert rows == [(7, "QLA1", "V2"), (3, "DQLA", "V3"), (6, "QLA1", "V2"), (10, "QLA1", "V2")]
    assert {"IO1: board 10 is in no IO file", "IO1: board 3 is in no IO file"} <= set(system.notes)


def test_a_test_board_is_noted(home: Home) -> None:
    system = _system(home, {"testboard": True})
    assert system.emulation is not None and system.emulation.buses[0].testboard
    assert system.notes[-1].endswith("wired to the test board instead of robots")
    assert not _bus(home, {"testboard": True, "buses": {"IO1": {"testboard": False}}}).testboard


def test_robots_can_differ_from_their_files(home: Home) -> None:
    plays, offsets = (0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.01), (0.1, 0.0, 0.0, 0.0, 0.0, 0.0, -0.1)
    reported = {"friction": 1.3, "inertia": 0.9, "mass": 1, "payload": 0.2, "backlash": plays, "pot_offset": offsets}
    emulation = _system(home, {"robots": {"PSM1": reported}}).emulation
    assert emulation is not None
    assert emulation.model_variations == (document.ModelVariation("PSM1", 1.3, 0.9, 1.0, 0.2, plays, offsets),)


def test_set_reaches_a_single_controller(home: Home) -> None:
    sets = ["emulation.buses.IO1.controllers.7.firmware=9", "emulation.qla=1.5", "emulation.robots.PSM1.payload=0.1"]
    system = home.load(sets=sets).system
    assert system is not None and system.emulation is not None
    assert [(c.board_id, c.firmware, c.qla) for c in system.emulation.buses[0].controllers] == [
        (6, 8, "1.5"), (7, 9, "1.5")]
    assert home.error(sets=["emulation.buses.IO1.controllers.7.firmware=6"]).file == "--set"


def test_mixed_firmware_needs_the_sequential_protocol(home: Home) -> None:
    section: Section = {"buses": {"IO1": {"controllers": {"7": {"firmware": 7}}}}}
    assert [c.firmware for c in _bus(home, section, protocol="srw").controllers] == [8, 7]
    for protocol in ("srbw", "bqrw"):
        (error,) = home.emulate(section, protocol=protocol).errors
        assert error.key == "trocar.emulation.buses.IO1.controllers.7.firmware" and "cannot mix" in error.text


def test_board_ids_in_yaml_need_no_quotes(home: Home) -> None:
    section = "emulation:\n    buses:\n      IO1:\n        controllers:\n          9:\n          6: {firmware: 9}"
    home.edit(SYSTEM, "boards: emulated", f"boards: emulated\n  {section}")
    system = home.load().system
    assert system is not None and system.emulation is not None
    assert [(c.board_id, c.firmware) for c in system.emulation.buses[0].controllers] == [(6, 9), (7, 8), (9, 8)]


def test_a_bus_without_boards_is_not_emulated(home: Home) -> None:
    ios = [{"name": "empty", "port": "udp"}, {"name": "one", "port": "udp"}]
    section = {"buses": {"one": {"controllers": {"3": {}}}}}
    system = home.load_made({"IOs": ios, "trocar": {"boards": "emulated", "emulation": section}}).system
    assert system is not None and system.emulation is not None
    assert [(bus.io, len(bus.controllers)) for bus in system.emulation.buses] == [("one", 1)]
    nothing = home.load_made({"IOs": ios, "trocar": {"boards": "emulated"}}).system
    assert nothing is not None and nothing.emulation is None and [row.name for row in nothing.processes] == ["system"]


def test_a_bus_may_have_any_name_without_ios(home: Home) -> None:
    left, right = {"0": {}, "5": {"firmware": 9}}, {"0": None}
    buses = {"left": {"controllers": left}, "right": {"controllers": right}}
    system = home.load_made({"trocar": {"boards": "emulated", "emulation": {"buses": buses}}}).system
    assert system is not None
    assert system.emulation is not None and system.ios == () and system.emulated() is system
    rows = [(bus.io, [c.board_id for c in bus.controllers]) for bus in system.emulation.buses]
    assert rows == [("left", [0, 5]), ("right", [0])]
    assert [(row.name, row.kind) for row in system.processes] == [("boards", "boards"), ("system", "system")]
    assert len({bus.address for bus in system.emulation.buses}) == 2


