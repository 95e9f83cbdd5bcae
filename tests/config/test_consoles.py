"""Consoles and teleoperations of a system file, as rows of the document."""

from __future__ import annotations

import math
import re

import pytest
from pydantic import BaseModel

from tests import stock
from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import load_system
from trocar.procs.config.loading.kinds import check_file
from trocar.procs.config.models.system_file import TeleopEcmParameters, TeleopPsmParameters
from trocar.procs.document import system as document
from trocar.procs.document.consoles import HidSensor
from trocar.procs.document.system import SystemConfig, WiredInput
from trocar.shm.commands import SCALE

FULL = "dvrk-share/system/system-full-system-simulated.json"
ARMS = [{"name": name, "type": name[:3], "simulation": "KINEMATIC", "serial": "0",
         "arm_file": f"arms/{name[:3]}{'R' if name[:3] == 'MTM' else '1' if name[:3] == 'PSM' else ''}-demo.yaml"}
        for name in ("MTMR", "MTML", "PSM1", "ECM")]


def full() -> SystemConfig:
    system = load_system(stock.find(FULL), search=[stock.find("dvrk-share")]).system
    assert system is not None
    return system


def console(**keys: object) -> dict[str, object]:
    return {"name": "c", "input_type": "SIMULATED", **keys}


def psm(**keys: object) -> dict[str, object]:
    return {"teleop_PSMs": [{"MTM": "MTMR", "PSM": "PSM1", "configure_parameter": keys}]}


def test_full_system_has_one_console_and_four_teleops() -> None:
    system = full()
    (console,) = system.consoles
    assert console.teleops == ("MTML_MTMR_ECM", "MTMR_PSM1", "MTML_PSM2", "MTML_PSM3"), "the endoscope's first"
    teleop = system.teleop("MTMR_PSM1")
    assert isinstance(teleop, document.TeleopPsmConfig) and teleop.start_gripper_threshold == 0.0
    assert teleop.scale == 0.2 and teleop.jaw_rate == pytest.approx(4 * math.pi)
    assert document.from_json(document.to_json(system)) == system


def test_defaults_are_those_of_the_original() -> None:
    bare = document.TeleopPsmConfig("MTMR_PSM1", "MTMR", "PSM1", 0.001, "console")
    made = full().teleop_psms[0]
    for name in bare.__slots__:
        wanted, found = getattr(bare, name), getattr(made, name)
        if name != "start_gripper_threshold":
            assert found == (pytest.approx(wanted) if isinstance(wanted, float) else wanted), name


@pytest.mark.parametrize(("keys", "key"), [
    ({"scale": 0.0}, "scale"), ({"scale": 1.0001}, "scale"), ({"jaw_rate": -1.0}, "jaw_rate"),
    ({"start_roll_threshold": -0.1}, "start_roll_threshold"), ({"MTM_is_haptic": False}, "align_MTM"),
    ({"gripper_scaling": {"zero": 0.5, "max": 0.5}}, "gripper_scaling.max")])
def test_wrong_parameter_stops_the_start(home: Home, keys: dict[str, object], key: str) -> None:
    loaded = home.load_made({"arms": ARMS, "consoles": [console(**psm(**keys))]})
    assert [error.key for error in loaded.errors] == [f"consoles[0].teleop_PSMs[0].configure_parameter.{key}"]
    assert loaded.errors[0].line > 0 and loaded.errors[0].file.endswith("made.json")


def test_teleop_is_listed_in_one_console_only(home: Home) -> None:
    loaded = home.load_made({"arms": ARMS, "consoles": [console(**psm()), console(name="d", input_type="SIMULATED") |
                                                        psm()]})
    (error,) = loaded.errors
    assert error.key == "consoles[1].teleop_PSMs[0]" and "first in console c" in error.text


def test_a_generic_teleop_is_told_in_plain_words(home: Home) -> None:
    teleops = {"teleop_PSMs": [{"type": "TELEOP_PSM_GENERIC", "MTM": "MTMR", "PSM": "PSM1", "component": "mine"}]}
    loaded = home.load_made({"arms": ARMS, "consoles": [console(**teleops)]})
    assert loaded.system is not None, loaded.errors
    notes = " / ".join(loaded.system.notes)
    assert "not started: teleop MTMR_PSM1 (TELEOP_PSM_GENERIC)" in notes and "third-party-masters.md" in notes


def test_what_a_component_manager_loads_is_left_out_and_the_rest_starts(home: Home) -> None:
    components = [{"shared-library": "sawSensablePhantomHD", "class-name": "mtsSensableHD", "constructor-arg": {}},
                  {"shared-library": "mine", "class-name": "mtsMine"}]
    for manager in ({"components": components, "connections": []}, components):
        loaded = home.load_made({"arms": ARMS, "component_manager": manager})
        assert loaded.system is not None and [arm.name for arm in loaded.system.arms] == [arm["name"] for arm in ARMS]
        (warning,) = (row for row in loaded.warnings if row.key == "component_manager")
        assert "mtsSensableHD, mtsMine" in warning.text and warning.line > 1
        haptic, _, mine = warning.allowed.partition("; for mtsMine: ")
        assert haptic.startswith("for mtsSensableHD: ") and "MTM_GENERIC" in haptic and "your own process" in mine


@pytest.mark.parametrize("manager", [[1, {}], {"components": 3}, "x"])
def test_no_form_of_component_manager_stops_the_arms(home: Home, manager: object) -> None:
    loaded = home.load_made({"arms": ARMS, "component_manager": manager})
    assert loaded.system is not None and any(row.key == "component_manager" for row in loaded.warnings)


def test_a_teleop_on_a_base_frame_of_a_component_is_left_out_as_well(home: Home) -> None:
    frame = {"component": "Cart", "interface": "a"}
    teleop = {"MTM": "MTMR", "PSM": "PSM1", "PSM_base_frame": frame}
    system = {"arms": ARMS, "consoles": [console(teleop_PSMs=[teleop])]}
    (error,) = home.load_made(system).errors
    assert error.key.endswith("PSM_base_frame.component")
    loaded = home.load_made({**system, "component_manager": {"components": [{"class-name": "mtsCart"}]}})
    assert loaded.system is not None and loaded.system.teleop_psms == ()
    assert "not started: teleop MTMR_PSM1" in " / ".join(loaded.system.notes)


def test_console_files_of_old_are_told_how_to_become_new(home: Home) -> None:
    error = home.error(file=str(stock.find("dvrk-share/system/console-PSM1_SNAKE_KIN_SIMULATED.json")))
    assert "before dVRK 2.4" in error.text
    assert re.search(r"trocar convert \S+/console-PSM1_SNAKE_KIN_SIMULATED.json", error.allowed)


def test_goovis_comes_from_its_file() -> None:
    path = stock.find("dvrk-site/jhu-dVRK/system-MTML-MTMR.json")
    loaded = load_system(path, search=[stock.find("dvrk-share")], boards="emulated")
    assert loaded.system is not None, loaded.errors
    (row,) = loaded.system.consoles
    assert row.head == HidSensor(0x880A, 0x3501, 17), "our own file: the original's is not among the data"
    assert row.operator_present == () and row.camera == WiredInput("IO1", "camera")


@pytest.mark.parametrize(("text", "key"), [
    ('{"id_vendor": "880a", "id_product": "3501"}', "index_data"),
    ('{"id_vendor": "88zz", "id_product": "3501", "index_data": 17}', "id_vendor"),
    ('{"id_vendor": "880a", "id_product": 3501, "index_data": 17}', "id_product"),
    ('{"id_vendor": "880a", "id_product": "3501", "index_data": 64}', "index_data")])
def test_a_head_sensor_s_file_with_a_mistake_is_told(home: Home, text: str, key: str) -> None:
    (home.path / "head.json").write_text(text)
    pedals = {"IO": "IO1", "IO_file": "io/PSM1-demo.yaml"}
    row = console(IO_pedals=pedals, HID_file="head.json") | {"input_type": "PEDALS_GOOVIS_HEAD_SENSOR"}
    loaded = home.load_made({"IOs": [{"name": "IO1", "port": "udp"}], "consoles": [row]}, boards="emulated")
    (error,) = loaded.errors
    assert (error.file.rpartition("/")[2], error.key) == ("head.json", key)
    (found,) = check_file(home.path / "head.json").problems
    assert found.key == key


def test_a_head_sensor_without_its_file_is_an_error(home: Home) -> None:
    pedals = {"IO": "IO1", "IO_file": "io/PSM1-demo.yaml"}
    row = console(IO_pedals=pedals, HID_file="hid/gone.json") | {"input_type": "PEDALS_GOOVIS_HEAD_SENSOR"}
    loaded = home.load_made({"IOs": [{"name": "IO1", "port": "udp"}], "consoles": [row]}, boards="emulated")
    assert [error.key for error in loaded.errors] == ["consoles[0].HID_file"]


def test_isi_head_sensor_is_wired(home: Home) -> None:
    device = {"IO": "IO1", "IO_file": str(stock.find("dvrk-share/io/sawRobotIO1394-MTMR-dv-head-sensor.json"))}
    pedals = {"IO": "IO1", "IO_file": str(stock.find("dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json"))}
    row = console(IO_pedals=pedals, IO_head_sensor=device) | {"input_type": "PEDALS_ISI_HEAD_SENSOR"}
    loaded = home.load_made({"IOs": [{"name": "IO1", "port": "udp"}], "consoles": [row]}, boards="emulated")
    assert loaded.system is not None, loaded.errors
    (made,) = loaded.system.consoles
    assert [beam.name for beam in made.operator_present] == [f"dv_head_sensor_{beam}" for beam in range(1, 5)]
    assert made.present_count == 3 and made.turn_off == WiredInput("IO1", "head_sensor_turn_off")


def test_pedals_that_no_file_has_are_warnings(home: Home) -> None:
    row = "{name: c, input_type: PEDALS_ONLY, IO_pedals: {IO: IO1, IO_file: io/PSM1-demo.yaml}}"
    home.edit(SYSTEM, "\ntrocar:", f"\nconsoles: [{row}]\ntrocar:")
    warnings = [found for found in home.load().warnings if found.key == "consoles[0].IO_pedals.IO_file"]
    for found, name in zip(warnings, ("clutch", "camera", "coag"), strict=True):
        assert f"has no digital input {name}: it cannot be pressed" in found.text


CART = {"name": "SUJ", "type": "SUJ_Classic", "simulation": "KINEMATIC", "arm_file": "arms/SUJ-kinematic.yaml"}


@pytest.mark.parametrize(("frame", "key"), [
    ({"component": "SUJ", "interface": "PSM1"}, ""), ({"component": "ECM", "interface": "Arm"}, ""),
    ({"component": "SUJ", "interface": "PSM7"}, "interface"), ({"component": "SUV", "interface": "PSM1"}, "component")])
def test_a_slave_s_base_frame_is_an_arm_s_or_a_set_up_arm_s(home: Home, frame: dict[str, str], key: str) -> None:
    teleop = {"MTM": "MTMR", "PSM": "PSM1", "PSM_base_frame": frame}
    loaded = home.load_made({"arms": [*ARMS, CART], "consoles": [console(teleop_PSMs=[teleop])]})
    wanted = [f"consoles[0].teleop_PSMs[0].PSM_base_frame.{key}"] if key else []
    assert [error.key for error in loaded.errors] == wanted
    if not key:
        assert loaded.system is not None
        row = loaded.system.teleop_psms[0]
        assert (row.base_frame_from, row.base_frame_interface) == (frame["component"], frame["interface"])


@pytest.mark.parametrize("section", [TeleopPsmParameters, TeleopEcmParameters])
def test_a_file_gives_no_scale_that_a_command_may_not_give(section: type[BaseModel]) -> None:
    bounds = section.model_fields["scale"].metadata
    assert [getattr(bound, "gt", getattr(bound, "le", None)) for bound in bounds] == [SCALE.low, SCALE.high]
