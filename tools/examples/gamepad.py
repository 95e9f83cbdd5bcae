"""A gamepad as Linux describes it, and the master's tip that it moves; no device is touched here.

Codes are those of linux/input-event-codes.h, the layout of buttons that of the kernel's documentation (gamepad.rst).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import pose_from_matrix, rotation_from_vector

Array = NDArray[np.float64]

EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED: Final = 3
ABS_X, ABS_Y, ABS_RX, ABS_RY, ABS_RZ, ABS_HAT0X, ABS_HAT0Y = 0x00, 0x01, 0x03, 0x04, 0x05, 0x10, 0x11
BTN_SOUTH, BTN_EAST, BTN_WEST, BTN_TL, BTN_TR2 = 0x130, 0x131, 0x134, 0x136, 0x139
MOTIONS: Final = (ABS_X, ABS_Y, ABS_RY, ABS_HAT0Y, ABS_HAT0X, ABS_RX)  # x y z, then about the tip's own x y z
AXES: Final = (*MOTIONS, ABS_RZ)

DEADMAN: Final = BTN_TL
BUTTONS: Final = {"operator_present": BTN_TL, "clutch": BTN_EAST, "camera": BTN_WEST}
DEAD_ZONE: Final = 0.12  # of a stick's way: maximum offset at rest
OPEN_RAD: Final = math.radians(60.0)  # the gripper with the released trigger
MAX_STEP_S: Final = 0.02  # a longer stall does not cause motion


class GamepadEvent(Protocol):
    """One event of a device."""

    type: int
    code: int
    value: int


class Range(Protocol):
    """Range of an axis, and its value."""

    min: int
    max: int
    value: int


class Device(Protocol):
    """An input device; evdev.InputDevice is one."""

    name: str
    path: str

    def read(self) -> Iterable[GamepadEvent]:
        """Events since the last call; BlockingIOError if there are none, OSError if the device is gone."""

    def absinfo(self, axis_num: int) -> Range:
        """Current state of an axis."""

    def active_keys(self) -> list[int]:
        """Buttons that are pressed now."""

    def capabilities(self, *, absinfo: bool) -> dict[int, list[int]]:
        """Supported codes, by type."""


def is_gamepad(device: Device) -> bool:
    """Whether it has a left stick and a gamepad's first button."""
    codes = device.capabilities(absinfo=False)
    return ABS_X in codes.get(EV_ABS, []) and BTN_SOUTH in codes.get(EV_KEY, [])


@dataclass(slots=True)
class Sticks:
    """Positions of the sticks, -1 to 1, and the pressed buttons."""

    axes: dict[int, float] = field(default_factory=dict)
    keys: set[int] = field(default_factory=set)


class Gamepad:
    """The state of a device, from its events."""

    def __init__(self, device: Device) -> None:
        """The current state."""
        self._device = device
        self._has = frozenset(device.capabilities(absinfo=False).get(EV_ABS, []))
        self._ranges = {code: device.absinfo(code) for code in AXES if code in self._has}
        self.sticks = Sticks()
        self._take_all()

    def poll(self) -> Sticks:
        """The current state; OSError: the device is gone."""
        try:
            for event in self._device.read():
                self._hear(event)
        except BlockingIOError:  # nothing has changed
            pass
        return self.sticks

    def _hear(self, event: GamepadEvent) -> None:
        if event.type == EV_ABS and event.code in self._ranges:
            self.sticks.axes[event.code] = self._part(event.code, event.value)
        elif event.type == EV_KEY:
            (self.sticks.keys.add if event.value else self.sticks.keys.discard)(event.code)
        elif event.type == EV_SYN and event.code == SYN_DROPPED:  # the kernel could not keep all events
            self._take_all()

    def _take_all(self) -> None:
        for code in self._ranges:
            self.sticks.axes[code] = self._part(code, self._device.absinfo(code).value)
        self.sticks.keys = set(self._device.active_keys())

    def _part(self, code: int, value: int) -> float:
        """A value as -1 to 1; an axis without a range does not move."""
        lowest, highest = self._ranges[code].min, self._ranges[code].max
        if highest <= lowest:
            return 0.0
        return min(1.0, max(-1.0, 2.0 * (value - lowest) / (highest - lowest) - 1.0))


class GamepadTip:
    """The tip moved by the sticks, in its own axes except for its position; it moves only while the deadman is held."""

    def __init__(self, speed: float, turn: float) -> None:
        """With a stick at its end: m/s, rad/s."""
        self._speed, self._turn = speed, turn
        self.pose = np.eye(4)
        self.twist = np.zeros(6)
        self.gripper = OPEN_RAD

    def step(self, sticks: Sticks, passed_s: float) -> Array:
        """Its pose (7,) after this time."""
        self.gripper = OPEN_RAD * (1.0 - self._pull(sticks))
        if DEADMAN not in sticks.keys:
            self.twist[...] = 0.0
            return pose_from_matrix(self.pose)
        x, y, z, *turns = (_beyond(sticks.axes.get(code, 0.0)) for code in MOTIONS)
        own = self._turn * np.array(turns)
        self.twist[:3] = self._speed * np.array((x, -y, -z))  # sticks count downwards
        self.twist[3:] = self.pose[:3, :3] @ own
        step_s = min(passed_s, MAX_STEP_S)
        self.pose[:3, 3] += self.twist[:3] * step_s
        self.pose[:3, :3] = self.pose[:3, :3] @ rotation_from_vector(own * step_s)
        return pose_from_matrix(self.pose)

    def _pull(self, sticks: Sticks) -> float:
        """How far the right trigger is pulled, 0 to 1; some gamepads have a button in its place."""
        if ABS_RZ in sticks.axes:
            return 0.5 * (sticks.axes[ABS_RZ] + 1.0)
        return float(BTN_TR2 in sticks.keys)


def _beyond(part: float) -> float:
    """A stick's way beyond its dead zone, from 0 on."""
    return math.copysign(max(0.0, abs(part) - DEAD_ZONE) / (1.0 - DEAD_ZONE), part)
