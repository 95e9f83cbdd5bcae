"""What commands and faults need of a robot's devices: those on boards have it, and those that are kinematic.

The real ones are in the modules of their names, the kinematic ones of KINEMATIC robots in `kinematic.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from trocar.procs.io.record import Flags, Floats
from trocar.procs.node.requests import Request


class MeasuredDevice(Protocol):
    """Where the actuators are and how fast: arrays (n,) that stay the same objects."""

    position: Floats
    velocity: Floats


class PowerDevice(Protocol):
    """Power of every robot."""

    changed: bool  # limits that depend on power must be looked at again
    reached: Flags  # all amplifiers of the robot have been on since it was asked for

    def on(self, robot: int, now_ns: int) -> None:
        """Begin to power on; asked again, nothing changes."""

    def supply(self, robot: int, now_ns: int, for_s: float) -> str:
        """Motor supply on for a while, amplifiers off; returns why not, or ""."""

    def off(self, robot: int, open_relays: bool = False) -> None:
        """Power off at once."""


class AxisDriveDevice(Protocol):
    """One motor driven by itself; see `axis_drive.py`."""

    def objection(self, robot: int, axis: int, current_a: float, rise_s: float, travel: float) -> str:
        """Why it cannot be done, or ""."""

    def begin(self, robot: int, axis: int, current_a: float, rise_s: float, travel: float, release: bool,
              asker: Request, now_ns: int) -> None:
        """Start it."""

    def stop(self, robot: int, why: str) -> None:
        """End it."""


class BiasDevice(Protocol):
    """Encoders that are set from potentiometers, or one by one. `left_out` (actuators of the robot,): not these."""

    def objection(self, robot: int, samples: int, left_out: Flags) -> str:
        """Why the robot can never be biased so, or ""."""

    def begin(self, robot: int, samples: int, left_out: Flags) -> None:
        """Start with |samples| potentiometer samples."""

    def set_objection(self, robot: int, axis: int, position: float) -> str:
        """Why an encoder cannot be set so, or ""."""

    def set_one(self, robot: int, axis: int, position: float) -> None:
        """Make one encoder read `position`."""

    def stop(self, robot: int) -> None:
        """Give up."""


class SafetyDevice(Protocol):
    """Checks of the samples."""

    def forget_pots(self, axes: slice) -> None:
        """The potentiometer check was switched: durations start again."""


class DigitalOutputsDevice(Protocol):
    """Pins that can be switched."""

    names: tuple[str, ...]

    def owner(self, place: int) -> str:
        """The command, and its robot, that sets it; empty: whoever asks."""

    def set(self, place: int, high: bool) -> None:
        """High or low."""

    def set_pwm(self, place: int, duty: float) -> str:
        """A duty cycle; returns why not, or ""."""


class CartDevice(Protocol):
    """What hangs on the interface board of a Classic patient cart."""

    def lift(self, robot: int, velocity: float, now_ns: int) -> str:
        """Move the lift for a moment, 0: stop; returns why not, or ""."""

    def multiplexer(self, robot: int, on: bool) -> str:
        """To the next channel, or to the first one; returns why not, or ""."""


class SetupBrakesDevice(Protocol):
    """Brakes of setup joints."""

    def set(self, robot: int, on: bool, now_ns: int) -> str:
        """Let them go for a moment, or have them hold; returns why not, or ""."""


class GainsDevice(Protocol):
    """Gains of the joint controllers."""

    def change(self, robot: int, axis: int, keys: Sequence[str], values: Sequence[float], who: str) -> str:
        """Other values from this cycle on; returns why not, or ""."""

    def objection(self, robot: int) -> str:
        """Why a joint controller is not switched on with its gains, or ""."""

    def switched_on(self, robot: int) -> None:
        """A joint controller is on with its gains."""


class InstrumentsDevice(Protocol):
    """Readers of the memory of instruments."""

    names: tuple[str, ...]

    def begin(self, reader: int, asker: Request, now_ns: int) -> str:
        """Read an instrument; returns why not, or ""."""
