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
