"""Classic setup joints of the site's files on emulated boards, and what is said of files that don't fit."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import stock
from trocar.procs.config import Loaded, load_system
from trocar.procs.document.system import DigitalOutput, from_json, to_json

SYSTEM, IO, ARMS = "system-SUJ.json", "sawRobotIO1394-SUJ.json", "suj-ECM-1-2-3.json"


@dataclass(frozen=True)
class CartFiles:
    """Copies of a patient cart's files that a test may spoil."""

    path: Path

    def spoil(self, name: str, old: str, new: str) -> None:
        text = (self.path / name).read_text()
        assert old in text, f"{old!r} is not in {name}"
        (self.path / name).write_text(text.replace(old, new, 1))

    def load(self, boards: str = "emulated") -> Loaded:
        return load_system(self.path / SYSTEM, search=[stock.find("dvrk-share")], boards=boards)


@pytest.fixture
def cart(tmp_path: Path) -> CartFiles:
    for name in (SYSTEM, IO, ARMS):
        shutil.copy(stock.find(f"dvrk-site/jhu-daVinci/{name}"), tmp_path / name)
    return CartFiles(tmp_path)


def test_setup_joints_are_found_with_their_board_and_outputs(cart: CartFiles) -> None:
    loaded = cart.load()
    assert loaded.system is not None and loaded.warnings == ()
    emulation = loaded.system.emulation
    assert emulation is not None
    (joints,) = emulation.setup_joints
    assert (joints.name, joints.io, joints.board_id, joints.axes) == ("SUJ", "IO1", 12, (0, 1, 2, 3))
    assert (joints.reset, joints.increment, joints.pwm, joints.disable) == (0, 1, 2, 3)
    assert [(arm.name, arm.plug, arm.release_current, arm.lifts) for arm in joints.arms] == [
        ("ECM", 1, 1.5, False), ("PSM1", 2, 2.2, False), ("PSM2", 3, 2.2, False), ("PSM3", 4, 2.2, True)]
    assert joints.arms[1].primary[0] == (0.25316, -0.042507) and joints.arms[0].secondary[5] == (0.0, 0.0)
    assert from_json(to_json(loaded.system)) == loaded.system


def test_digital_outputs_are_in_the_document(cart: CartFiles) -> None:
    system = cart.load().system
    assert system is not None
    assert system.emulated().io("IO1").digital_outputs == (
        DigitalOutput("no_mux_reset", 12, 0, low_s=0.0001), DigitalOutput("mux_increment", 12, 1, high_s=0.0001),
        DigitalOutput("control_PWM", 12, 2, is_pwm=True, pwm_hz=40000.0), DigitalOutput("disable_PWM", 12, 3))


def test_a_start_position_comes_from_the_file(cart: CartFiles) -> None:
    cart.spoil(ARMS, '"plug_number": 1,', '"plug_number": 1, "simulated_position": [0.1, 0.2, 0.3, 4, 0, 0],')
    system = cart.load().system
    assert system is not None and system.emulation is not None
    first, second, *_ = system.emulation.setup_joints[0].arms
    assert (first.position, second.position) == ((0.1, 0.2, 0.3, 4.0, 0.0, 0.0), ())


def test_real_boards_are_not_emulated(cart: CartFiles) -> None:
    loaded = cart.load("real")
    assert loaded.system is not None and loaded.system.emulation is None and loaded.warnings == ()


@pytest.mark.parametrize(("name", "old", "new", "key", "says"), [
    (ARMS, '"plug_number": 2', '"plug_number": 5', "arms[1].plug_number", "up to 4"),
    (ARMS, '"plug_number": 2', '"plug_number": 1', "arms[1].plug_number", "1 is also the plug of arms[0]"),
    (ARMS, '"name": "PSM2"', '"name": "PSM1"', "arms[2].name", "PSM1 is also the name of arms[1]"),
    (ARMS, '"type": "Motorized PSM"', '"type": "MPSM"', "arms[3].type", "Motorized PSM"),
    (ARMS, "[ -0.098948, -2.382,", "[ -2.382,", "arms[0].primary_offsets", "6 numbers"),
    (ARMS, '"secondary_scales": [ 0.25819', '"remarks": [ 0.25819', "arms[0].secondary_scales", "required"),
    (SYSTEM, "suj-ECM-1-2-3.json", "suj.json", "arms[0].arm_file", "no file suj.json")])
def test_mistakes_in_the_file_are_named(cart: CartFiles, name: str, old: str, new: str, key: str, says: str) -> None:
    cart.spoil(name, old, new)
    loaded = cart.load()
    assert loaded.system is None
    assert [problem.key for problem in loaded.errors] == [key]
    assert says in str(loaded.errors[0])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"name" : "mux_increment"', '"name" : "increment"'),
        ('"bit_id" : 0,\n            "board_id" : 12,\n            "is_PWM"',
         '"bit_id" : 0, "board_id" : 11,\n            "is_PWM"'),
        ('"bit_id" : 3,\n            "board_id" : 12,\n            "is_PWM"',
         '"bit_id" : 4, "board_id" : 12,\n            "is_PWM"'),
        ('"name" : "SUJ",', '"name" : "SUJ1",'),
        ('"hardware_version" : "QLA1"', '"hardware_version" : "dRA1"'),
    ],
    ids=["output missing", "output elsewhere", "no such output", "no robot", "no outputs"],
)
def test_without_all_that_it_takes_there_are_no_setup_joints(cart: CartFiles, old: str, new: str) -> None:
    cart.spoil(IO, old, new)
    loaded = cart.load()
    (warning,) = loaded.warnings
    assert (warning.key, warning.text) == ("arms[0]", "emulated without setup joints: IO1 lacks what they need")
    if loaded.system is None:  # then no process could read them either
        assert [error.key for error in loaded.errors] == ["arms[0].IO"]
    else:
        assert loaded.system.emulation is not None and loaded.system.emulation.setup_joints == ()
