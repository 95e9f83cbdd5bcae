"""Setup joints in system files: who stands on whom, what io gets to know, and what is wrong with their files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests import stock
from trocar.procs.config import Loaded, load_system
from trocar.procs.config.loading.kinds import check_file
from trocar.procs.fpga import registers

FOLDERS = {"Classic": "dvrk-site/jhu-daVinci/suj-ECM-1-2-3.json", "Si": "dvrk-site/jhu-daVinci-Si/suj-si.json",
           "Fixed": "dvrk-share/arm/suj-fixed-simulated.json"}
PSM = {"type": "PSM", "simulation": "KINEMATIC",
       "arm_file": "arm/PSM_KIN_SIMULATED_LARGE_NEEDLE_DRIVER_400006.json"}


def content(kind: str) -> dict:
    text = stock.find(FOLDERS[kind]).read_text()
    return json.loads(re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL))


def load(tmp_path: Path, kind: str, arms: list[dict] | None = None, file: dict | None = None, **keys) -> Loaded:
    (tmp_path / "suj.json").write_text(json.dumps(file or content(kind)))
    suj = {"name": "SUJ", "type": f"SUJ_{kind}", "arm_file": "suj.json"} | keys
    if kind == "Classic" and "simulation" not in keys:
        suj |= {"IO": "IO1", "IO_file": "sawRobotIO1394-SUJ.json"}
    system = {"$id": "dvrk-system.schema.json", "$version": "1", "arms": [suj, *(arms or [])]}
    if "IO" in suj:
        system["IOs"] = [{"name": "IO1", "port": "fw"}]
    (tmp_path / "system.json").write_text(json.dumps(system))
    return load_system(tmp_path / "system.json", boards="emulated",
                       search=[stock.find("dvrk-share"), stock.find("dvrk-site/jhu-daVinci")])


def on(name: str, setup: str, component: str = "SUJ") -> dict:
    return PSM | {"name": name, "base_frame": {"component": component, "interface": setup}}


def test_arms_know_who_carries_them_and_the_other_way_round(tmp_path: Path) -> None:
    system = load(tmp_path, "Fixed", [on("PSM1", "PSM1"), on("LEFT", "PSM2"), PSM | {"name": "PSM3"}]).system
    assert system is not None
    assert [(arm.name, arm.base_from, arm.base_setup) for arm in system.arms] == [
        ("PSM1", "SUJ", "PSM1"), ("LEFT", "SUJ", "PSM2"), ("PSM3", "", "")]
    assert [arm.carries for arm in system.cart("SUJ").arms] == ["", "PSM1", "LEFT", ""]
    assert system.process("SUJ").kind == "suj" and system.process("SUJ").period_s == 0.002


@pytest.mark.parametrize(("arms", "key", "says"), [
    ([on("PSM1", "PSM4")], "arms[1].base_frame.interface", "SUJ has no setup arm PSM4"),
    ([on("PSM1", "PSM1"), on("PSM2", "PSM1")], "arms[2].base_frame.interface", "SUJ/PSM1 carries PSM1 already")])
def test_an_arm_stands_on_one_set_up_arm_that_is_there(tmp_path: Path, arms: list[dict], key: str, says: str) -> None:
    (error,) = load(tmp_path, "Fixed", arms).errors
    assert error.key == key and says in error.text


def test_a_base_frame_from_something_else_is_noted(tmp_path: Path) -> None:
    system = load(tmp_path, "Fixed", [on("PSM1", "frame", "tracker")]).system
    assert system is not None and "not started yet: base frame of PSM1 from tracker/frame" in system.notes
    assert system.arms[0].base_from == ""


def test_io_learns_of_brakes_channel_and_lift_but_the_boards_stay_as_they_are(tmp_path: Path) -> None:
    system = load(tmp_path, "Classic").system
    assert system is not None and system.emulation is not None
    io, boards = system.io("IO1"), system.emulated().io("IO1")
    assert {a.effort_to_current for a in io.robots[0].actuators} == {1.0}
    assert [(pid.robot, pid.arm, len(pid.axes)) for pid in io.pids] == [("SUJ", "SUJ", 4)]
    shown = [row for row in io.digital_inputs if "channel" in row.name]
    assert [(row.name, row.bit_id - registers.INPUT_ENCODER_A_SHIFT) for row in shown] == [
        (f"SUJ_channel_{line}", line) for line in range(4)]
    assert {row.name: (row.set_by, row.robot) for row in io.digital_outputs} == {
        "no_mux_reset": ("multiplexer", "SUJ"), "mux_increment": ("multiplexer", "SUJ"),
        "control_PWM": ("lift", "SUJ"), "disable_PWM": ("lift", "SUJ")}
    assert boards.pids == () and {a.effort_to_current for a in boards.robots[0].actuators} == {0.0}
    assert not any("channel" in row.name for row in boards.digital_inputs)


def test_periods_come_from_the_entry_or_the_options(tmp_path: Path) -> None:
    system = load(tmp_path, "Fixed", period=0.01).system
    assert system is not None and system.process("SUJ").period_s == 0.01


@pytest.mark.parametrize(("weight", "good"), [(0.3, True), ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], True), (1.2, False),
                                              ([0.5], False), ("half", False), (True, False), ([0.5] * 5 + [-1], 0)])
def test_weights_hold_for_all_joints_or_one_each(tmp_path: Path, weight: object, good: bool) -> None:
    file = content("Classic")
    file["arms"][1]["primary_secondary_weight"] = weight
    loaded = load(tmp_path, "Classic", file=file)
    if good:
        assert loaded.system is not None
        assert loaded.system.cart("SUJ").arms[1].weight == (tuple(weight) if isinstance(weight, list) else (0.3,) * 6)
    else:
        assert [error.key for error in loaded.errors] == ["arms[1].primary_secondary_weight"]



@pytest.mark.parametrize(("kind", "arm", "changes", "keys"), [
    ("Classic", 1, {"DH": None}, ["arms[1].DH"]),
    ("Classic", 1, {"world_origin_to_SUJ": {"Translation": [0, 0, 0], "Rotation": [[1, 0, 0], [0, 2, 0], [0, 0, 1]]}},
     ["arms[1].world_origin_to_SUJ.Rotation"]),
    ("Classic", 1, {"world_origin_to_SUJ": {"Translation": [0, 0], "Rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}},
     ["arms[1].world_origin_to_SUJ.Translation"]),
    ("Classic", 0, {"simulated_position": [1, 2]}, ["arms[0].simulated_position"]),
    ("Si", 1, {"arduino_mac": None}, ["arms[1].arduino_mac"]),
    ("Si", 1, {"arduino_mac": "somewhere"}, ["arms[1].arduino_mac"]), ("Si", 1, {"name": "PSM7"}, ["arms[1].name"]),
    ("Si", 1, {"primary_scales": [1, 2, 3]}, ["arms[1].primary_scales"]), ("Si", 3, {"name": "PSM1"}, ["arms[3].name"]),
    ("Fixed", 2, {"measured_cp": [[1, 0], [0, 1]]}, ["arms[2].measured_cp"])])
def test_mistakes_in_the_file_are_named(
        tmp_path: Path, kind: str, arm: int, changes: dict, keys: list[str]) -> None:
    file = content(kind)
    file["arms"][arm] = {name: value for name, value in (file["arms"][arm] | changes).items() if value is not None}
    loaded = load(tmp_path, kind, file=file)
    assert [error.key for error in loaded.errors] == keys, [str(error) for error in loaded.errors]


def test_a_board_without_an_address_is_absent(tmp_path: Path) -> None:
    file = content("Si")
    file["arms"][1]["arduino_mac"] = ""
    loaded = load(tmp_path, "Si", file=file)
    assert loaded.system is not None and [arm.board for arm in loaded.system.cart("SUJ").arms].count("") == 1


def test_the_base_s_board_and_the_reference_must_be_there(tmp_path: Path) -> None:
    file = content("Si")
    del file["base_arduino_mac"]
    assert [e.key for e in load(tmp_path, "Si", file=file).errors] == ["base_arduino_mac"]
    file = content("Fixed") | {"reference_arm": "PSM9"}
    assert [e.key for e in load(tmp_path, "Fixed", file=file).errors] == ["reference_arm"]


@pytest.mark.parametrize("kind", FOLDERS)
def test_their_files_are_checked_by_themselves(kind: str) -> None:
    checked = check_file(stock.find(FOLDERS[kind]))
    assert (checked.kind, checked.problems) == (f"setup joints, {kind if kind != 'Fixed' else 'fixed'}", ())


# -- Si carts of 2026: potentiometers in one file an arm ---------------------------------------------------------------

JOINTS = {"PSM1": 4, "ECM": 4, "PSM3": 5}
SI_ARMS = {"PSM1": "PSM1-292409.json", "ECM": "ECM-438610.json"}


def pots(name: str, serial: str, joints: int = 4, **keys) -> dict:
    lines = [{"scale": -2.68e-4, "offset": 0.51}, *({"scale": 1.13e-3, "offset": -2.3},) * (joints - 1)]
    return {"$id": "saw-robot-io-suj-si.schema.json", "$version": "1", "arm_name": name, "serial_number": serial,
            "primary_measured_js": lines, "secondary_measured_js": lines} | keys


def by_arm(tmp_path: Path, *files: dict, boards: str = "emulated", arms: tuple[str, ...] = ("PSM1", "ECM")) -> Loaded:
    """A cart with geometry only, under real Si arms of a site."""
    geometry = content("Si")
    geometry["arms"] = [{key: arm[key] for key in ("name", "DH", "world_origin_to_SUJ", "SUJ_tip_to_tool_origin")}
                        for arm in geometry["arms"] if arm["name"] in arms]
    del geometry["base_arduino_mac"]
    (tmp_path / "kinematic").mkdir(exist_ok=True)
    (tmp_path / "kinematic" / "suj-si.json").write_text(json.dumps(geometry))
    for file in files:
        name = f"sawRobotIO1394-SUJ-Si-{file['arm_name']}-{file['serial_number']}.json"
        (tmp_path / file.pop("file", name)).write_text(json.dumps(file))
    rows = [{"name": name, "type": name[:3], "IO": "IO1", "serial": SI_ARMS[name][-11:-5], "arm_file": SI_ARMS[name],
             "base_frame": {"component": "SUJ", "interface": name}} for name in SI_ARMS]
    system = {"$id": "dvrk-system.schema.json", "$version": "1", "IOs": [{"name": "IO1", "port": "fw"}], "arms": [
        {"name": "SUJ", "type": "SUJ_Si", "arm_file": "kinematic/suj-si.json"}, *rows]}
    (tmp_path / "system.json").write_text(json.dumps(system))
    return load_system(tmp_path / "system.json", boards=boards,
                       search=[stock.find("dvrk-share"), stock.find("dvrk-site/jhu-daVinci-Si")])


GOOD = ("PSM1", "292409"), ("ECM", "438610")


def test_a_cart_of_2026_takes_the_file_of_each_carried_arm(tmp_path: Path) -> None:
    other = pots(*GOOD[1]) | {"$id": "saw-robot-io-SUJ-Si.schema.json"}
    loaded = by_arm(tmp_path, pots(*GOOD[0]), other)
    assert loaded.system is not None, loaded.errors
    cart = loaded.system.cart("SUJ")
    assert cart.by_arm and cart.emulated and cart.base_board == ""
    assert [(arm.name, arm.carries, arm.board, arm.joints) for arm in cart.arms] == [
        ("ECM", "ECM", "ECM", 4), ("PSM1", "PSM1", "PSM1", 4)]
    assert cart.arms[1].primary == ((-2.68e-4, 0.51), *((1.13e-3, -2.3),) * 3) == cart.arms[1].secondary
    assert cart.arms[1].weight == (0.5,) * 4
    real = by_arm(tmp_path, boards="real")
    assert real.system is not None and not real.system.cart("SUJ").emulated
    assert any("firmware Rev 10 reads these setup joints" in problem.text for problem in real.warnings)


@pytest.mark.parametrize(("changes", "key", "says"), [
    ({"serial_number": "1", "file": "sawRobotIO1394-SUJ-Si-PSM1-292409.json"}, "serial_number", "1, in a file of PSM1"),
    ({"arm_name": "PSM2", "file": "sawRobotIO1394-SUJ-Si-PSM1-292409.json"}, "arm_name", "PSM2, in a file of PSM1"),
    ({"primary_measured_js": [{"scale": -2.7e-4, "offset": 0.5}, {}, {"scale": 1.0, "offset": 0.0},
                              {"scale": 0.001, "offset": 1.0}]}, "primary_measured_js",
     "PSM1: joint 2, 3 not calibrated"),
    ({"secondary_measured_js": [{"scale": -1.69e-5, "offset": 0.5}, *[{"scale": 7.1e-5, "offset": -2.3}] * 3]},
     "secondary_measured_js", "is that of a Bluetooth board"),
    ({"secondary_measured_js": [{"scale": -2.7e-4, "offset": 0.5}]}, "secondary_measured_js", "1 potentiometers for 4"),
    ({"further": 1}, "further", ""),
])
def test_what_the_file_of_an_arm_lacks_is_named(tmp_path: Path, changes: dict, key: str, says: str) -> None:
    loaded = by_arm(tmp_path, pots(*GOOD[0], **changes), pots(*GOOD[1]))
    assert loaded.system is None
    assert [(error.key, says in error.text) for error in loaded.errors if error.key == key] == [(key, True)]


def test_a_missing_file_and_a_setup_arm_without_an_arm_are_errors(tmp_path: Path) -> None:
    loaded = by_arm(tmp_path, pots(*GOOD[0]))
    assert "no file sawRobotIO1394-SUJ-Si-ECM-438610.json" in str(loaded.errors[0])
    loaded = by_arm(tmp_path, pots(*GOOD[0]), pots(*GOOD[1]), arms=("PSM1", "ECM", "PSM3"))
    assert "it carries none" in str(loaded.errors[0])


def test_the_file_of_an_arm_is_checked_by_itself(tmp_path: Path) -> None:
    file = tmp_path / "sawRobotIO1394-SUJ-Si-PSM1-292409.json"
    file.write_text(json.dumps(pots(*GOOD[0])))
    found = check_file(file)
    assert found.kind == "setup joints, Si arm" and found.problems == ()
    file.write_text(json.dumps(pots(*GOOD[0], primary_measured_js=[], secondary_measured_js=[{}] * 6)))
    assert [problem.key for problem in check_file(file).problems] == [
        "primary_measured_js", "secondary_measured_js", "secondary_measured_js", "secondary_measured_js"]
