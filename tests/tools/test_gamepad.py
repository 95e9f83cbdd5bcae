"""A gamepad as a master, on a device that a test plays."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.kinematics.poses import matrix_from_pose, rotation_vector
from trocar.tools.examples import gamepad_master
from trocar.tools.examples.gamepad import (
    ABS_HAT0X,
    ABS_RX,
    ABS_RY,
    ABS_RZ,
    ABS_X,
    ABS_Y,
    AXES,
    BTN_EAST,
    BTN_SOUTH,
    BTN_TL,
    BTN_TR2,
    EV_ABS,
    EV_KEY,
    EV_SYN,
    OPEN_RAD,
    SYN_DROPPED,
    Gamepad,
    GamepadTip,
    is_gamepad,
)
from trocar.tools.output.errors import Problem


class FakePad:
    """A device with the ranges of a common gamepad."""

    name, path = "A pad", "/dev/input/event7"

    def __init__(self, axes: tuple[int, ...] = AXES, keys: tuple[int, ...] = (BTN_SOUTH, BTN_TL)) -> None:
        self.info = {code: SimpleNamespace(min=-32768, max=32767, value=0) for code in axes}
        if ABS_RZ in axes:
            self.info[ABS_RZ] = SimpleNamespace(min=0, max=255, value=0)
        self.keys, self.pressed = keys, list[int]()
        self.waiting: list[Any] = []
        self.gone = False

    def capabilities(self, *, absinfo: bool) -> dict[int, list[int]]:
        return {EV_ABS: list(self.info), EV_KEY: list(self.keys)}

    def absinfo(self, axis_num: int) -> Any:
        return self.info[axis_num]

    def active_keys(self) -> list[int]:
        return self.pressed

    def report(self, kind: int, code: int, value: int) -> None:
        self.waiting.append(SimpleNamespace(type=kind, code=code, value=value))

    def read(self) -> Iterator[Any]:
        if self.gone:
            raise OSError(19, "No such device")
        if not self.waiting:
            raise BlockingIOError
        waiting, self.waiting = self.waiting, []
        yield from waiting


def moved(pad: FakePad, seconds: float = 1.0) -> tuple[np.ndarray, GamepadTip]:
    gamepad, hand = Gamepad(pad), GamepadTip(0.05, 0.5)
    for _ in range(round(seconds * 100)):
        pose = hand.step(gamepad.poll(), 0.01)
    return pose, hand


def test_nothing_moves_unless_the_deadman_is_held() -> None:
    pad = FakePad()
    pad.report(EV_ABS, ABS_X, 32767)
    pose, hand = moved(pad)
    assert pose.tolist() == [0, 0, 0, 0, 0, 0, 1] and not hand.twist.any()
    pad.pressed = [BTN_TL]
    pad.report(EV_ABS, ABS_X, 32767)
    pose, hand = moved(pad)
    assert pose[0] == pytest.approx(0.05, abs=1e-4) and hand.twist[0] == pytest.approx(0.05, abs=1e-4)
    gamepad = Gamepad(pad)
    pad.report(EV_KEY, BTN_TL, 0)
    assert hand.step(gamepad.poll(), 0.01).tolist() == pose.tolist() and not hand.twist.any()


@pytest.mark.parametrize(("axis", "place", "sign"), [(ABS_X, 0, 1), (ABS_Y, 1, -1), (ABS_RY, 2, -1)])
def test_sticks_are_velocities(axis: int, place: int, sign: int) -> None:
    pad = FakePad()
    pad.pressed = [BTN_TL]
    pad.report(EV_ABS, axis, 32767)
    pose, _ = moved(pad, 0.5)
    assert pose[place] == pytest.approx(sign * 0.025, abs=1e-4) and np.count_nonzero(np.abs(pose[:3]) > 1e-6) == 1


def test_a_stick_near_its_middle_is_at_rest() -> None:
    pad = FakePad()
    pad.pressed = [BTN_TL]
    pad.report(EV_ABS, ABS_X, 3000)
    assert moved(pad)[0].tolist() == [0, 0, 0, 0, 0, 0, 1]


def test_the_tip_rolls_about_its_own_axis_and_says_so_in_the_base_s() -> None:
    pad = FakePad()
    pad.pressed = [BTN_TL]
    pad.report(EV_ABS, ABS_HAT0X, 32767)
    _, hand = moved(pad, math.pi / 2 / 0.5)  # a quarter about y: now its z points along x
    gamepad = Gamepad(pad)
    pad.report(EV_ABS, ABS_RX, 32767)
    before = hand.pose.copy()
    after = matrix_from_pose(hand.step(gamepad.poll(), 0.01))
    assert rotation_vector(before[:3, :3].T @ after[:3, :3]) == pytest.approx([0, 0, 0.005], abs=1e-6)
    assert hand.twist[3:] == pytest.approx([0.5, 0, 0], abs=5e-3)


def test_the_trigger_is_the_gripper() -> None:
    pad = FakePad()
    gamepad, hand = Gamepad(pad), GamepadTip(0.05, 0.5)
    hand.step(gamepad.poll(), 0.01)
    assert hand.gripper == OPEN_RAD
    pad.report(EV_ABS, ABS_RZ, 255)
    hand.step(gamepad.poll(), 0.01)
    assert hand.gripper == 0.0
    plain = FakePad((ABS_X, ABS_Y))
    gamepad = Gamepad(plain)
    plain.report(EV_KEY, BTN_TR2, 1)
    hand.step(gamepad.poll(), 0.01)
    assert hand.gripper == 0.0, "a button in its place"


def test_what_stalled_does_not_become_a_jump() -> None:
    pad = FakePad()
    pad.pressed = [BTN_TL]
    pad.info[ABS_X].value = 32767
    assert GamepadTip(0.05, 0.5).step(Gamepad(pad).poll(), 5.0)[0] == pytest.approx(0.001, abs=1e-5)


def test_events_that_the_kernel_dropped_are_looked_up() -> None:
    pad = FakePad()
    gamepad = Gamepad(pad)
    pad.info[ABS_X].value, pad.pressed = -32768, [BTN_EAST]
    pad.report(EV_SYN, SYN_DROPPED, 0)
    sticks = gamepad.poll()
    assert sticks.axes[ABS_X] == -1.0 and sticks.keys == {BTN_EAST}


def test_an_axis_without_a_range_stands_still() -> None:
    pad = FakePad()
    pad.info[ABS_X] = SimpleNamespace(min=0, max=0, value=0)
    pad.report(EV_ABS, ABS_X, 100)
    assert Gamepad(pad).poll().axes[ABS_X] == 0.0


class FakeMaster:
    """A place in a system that a test plays, for three cycles."""

    def __init__(self, buttons: tuple[str, ...]) -> None:
        self.buttons, self.now_ns, self.cycles = buttons, 0, 3
        self.pressed: dict[str, bool] = {}
        self.written: list[Any] = []

    def tick(self) -> bool:
        self.now_ns += 5_000_000
        self.cycles -= 1
        return self.cycles >= 0

    def press(self, button: str, pressed: bool) -> None:
        self.pressed[button] = pressed

    def write(self, pose: Any, twist: Any, *, gripper: float) -> None:
        self.written.append((pose, gripper))


def test_the_console_s_buttons_are_those_it_asks_for() -> None:
    pad, master, reported = FakePad(), FakeMaster(("clutch", "operator_present")), list[str]()
    pad.report(EV_KEY, BTN_EAST, 1)
    gamepad_master.drive(master, Gamepad(pad), GamepadTip(0.05, 0.5), reported.append)  # type: ignore[arg-type]
    assert master.pressed == {"operator_present": False, "clutch": True} and len(master.written) == 3 and not reported
    other = FakeMaster(())
    gamepad_master.drive(other, Gamepad(pad), GamepadTip(0.05, 0.5), reported.append)  # type: ignore[arg-type]
    assert not other.pressed and "does not take operator_present" in reported[0]


def test_a_gamepad_that_is_pulled_out_ends_it() -> None:
    pad, master = FakePad(), FakeMaster(())
    gamepad = Gamepad(pad)
    pad.gone = True
    with pytest.raises(Problem, match="the gamepad is gone"):
        gamepad_master.drive(master, gamepad, GamepadTip(0.05, 0.5), lambda text: None)  # type: ignore[arg-type]
    assert not master.written


def test_the_first_gamepad_is_taken() -> None:
    mouse = FakePad((), (0x110,))
    mouse.name, mouse.path = "A mouse", "/dev/input/event1"
    there = {each.path: each for each in (mouse, FakePad())}
    package = SimpleNamespace(list_devices=lambda: list(there), InputDevice=there.__getitem__)
    assert not is_gamepad(mouse) and gamepad_master.chosen(package, "").name == "A pad"
    del there[FakePad.path]
    with pytest.raises(Problem, match="event1 A mouse"):
        gamepad_master.chosen(package, "")

    def denied(path: str) -> Any:
        raise PermissionError(13, "Permission denied")

    with pytest.raises(Problem, match="event9 cannot be read: Permission denied"):
        gamepad_master.chosen(SimpleNamespace(InputDevice=denied), "/dev/input/event9")


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(Problem, match=r"pip install 'trocar\[gamepad\]'"):
        gamepad_master.evdev()
