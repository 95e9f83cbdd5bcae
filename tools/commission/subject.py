"""Subjects of commissioning: every robot with boards in a system's files, and its axes' positions in io's record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.document.cart import CLASSIC, Cart
from trocar.procs.document.system import Actuator, IoConfig, Robot, SystemConfig

UNITS = {"PRISMATIC": "m"}
SETUP: Final = "SUJ"  # kind
SETUP_JOINTS: Final = 6
"""Of a Classic setup arm with potentiometers, at most."""


@dataclass(frozen=True, slots=True)
class Subject:
    """One robot. `axes` and `drives` are places in the fields of its io's record, `row` is its own among the robots."""

    io: str
    robot: Robot
    row: int
    axes: slice
    drives: tuple[int, ...]  # its actuators, then its brakes
    arm: str  # the process that drives it; empty: a gripper
    kind: str  # PSM, ECM, MTM, SUJ; empty: a gripper
    names: tuple[str, ...]
    tolerance: tuple[float, ...]  # tracking error that trips, of each axis; empty without a joint controller
    deadband: tuple[float, ...]  # position error that its joint controller leaves alone

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def is_setup(self) -> bool:
        """Whether its actuators are the brakes of setup arms."""
        return self.kind == SETUP

    @property
    def boards(self) -> str:
        """Its boards, in words."""
        ids = sorted({a.board_id for a in self.robot.actuators} | {b.board_id for b in self.robot.brakes})
        return f"board{'s' if len(ids) > 1 else ''} {', '.join(map(str, ids))}"

    def whole(self) -> str:
        """Location of a finding about the whole robot."""
        return f"{self.name}, {self.boards}"

    def where(self, axis: int) -> str:
        """Location of a finding about an axis."""
        return f"{self.title(axis)}, board {self.actuator(axis).board_id}"

    def title(self, axis: int) -> str:
        """The axis in words."""
        return f"{self.name} axis {axis} ({self.names[axis]})"

    def actuator(self, axis: int) -> Actuator:
        """File data of an axis."""
        return self.robot.actuators[axis]

    def slides(self, axis: int) -> bool:
        """Whether an axis is prismatic."""
        return self.actuator(axis).joint_type == "PRISMATIC"

    def unit(self, axis: int) -> str:
        """Unit of its positions."""
        return UNITS.get(self.actuator(axis).joint_type, "rad")

    def has_motor(self, axis: int) -> bool:
        """Whether there is something to drive, and to see it move by."""
        actuator = self.actuator(axis)
        return actuator.maximum_current > 0.0 and actuator.effort_to_current != 0.0 and actuator.encoder is not None

    def has_pot(self, axis: int) -> bool:
        """Whether its potentiometer measures its position."""
        known = self.actuator(axis).potentiometer is not None or bool(self.robot.lookup)
        rows = self.robot.tolerances
        return known and (axis >= len(rows) or rows[axis].distance > 0.0)

    def has_brake(self, axis: int) -> bool:
        """Whether a brake holds it."""
        return axis < len(self.robot.brakes)

    def range_of(self, axis: int) -> tuple[float, float]:
        """Its position limits, equal if it has none."""
        encoder = self.actuator(axis).encoder
        return (encoder.lower, encoder.upper) if encoder is not None else (0.0, 0.0)


def subjects_of(system: SystemConfig, arms: list[str] | None = None) -> tuple[Subject, ...]:
    """All robots of arms and grippers, or those of some arms; without setup joints and KINEMATIC ones."""
    return tuple(subject for io in system.ios if io.port for subject in _of(system, io)
                 if not arms or _owner(system, subject) in arms)


def carts_of(system: SystemConfig, arms: list[str] | None = None) -> tuple[Cart, ...]:
    """Classic setup joints with boards, all or those of these names."""
    return tuple(cart for cart in system.carts if cart.kind == CLASSIC and cart.io and (not arms or cart.name in arms))


def setup_subject(system: SystemConfig, cart: Cart) -> Subject:
    """The robot of Classic setup joints, with the brakes of each setup arm as one actuator."""
    place = system.io(cart.io).place(cart.robot)
    names = tuple(f"brakes of plug {plug}" for plug in range(1, len(place.robot.actuators) + 1))
    return Subject(cart.io, place.robot, place.row, place.axes, tuple(place.drives), cart.name, SETUP, names, (), ())


def _of(system: SystemConfig, io: IoConfig) -> list[Subject]:
    carts = {cart.name for cart in system.carts}  # their brakes are driven like motors
    found, driven = [], {pid.robot: pid for pid in io.pids if pid.arm not in carts}
    grippers = {arm.gripper for arm in system.arms if arm.io == io.name}
    for place in io.places:
        robot, pid = place.robot, driven.get(place.robot.name)
        where = (io.name, robot, place.row, place.axes, tuple(place.drives))
        if pid is not None:
            found.append(Subject(*where, pid.arm, system.arm(pid.arm).type, tuple(a.name for a in pid.axes),
                                 tuple(a.tolerance for a in pid.axes), tuple(a.p_deadband for a in pid.axes)))
        elif robot.name in grippers:
            found.append(Subject(*where, "", "", ("gripper",) * len(robot.actuators), (), ()))
    return found


def _owner(system: SystemConfig, subject: Subject) -> str:
    """The arm of a robot."""
    return subject.arm or next((arm.name for arm in system.arms if arm.gripper == subject.name), "")
