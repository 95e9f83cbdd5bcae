"""The joint space of an arm: names, limits and ratings of its axes, with or without an instrument.

A joint vector (size,) holds the kinematic joints and then the jaw, if there is one; rad, m. Matrices map it to and from
the actuators' vector, so that no other module needs to know how an instrument couples its discs. A PSM without an
instrument has seven joints (three of the arm, four bare discs), no tip and no jaw. A snake-like instrument has eight;
the last two bend with the two before them: five and eight share an actuator's motion, and so do six and seven.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import ArmConfig, Tool
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.endoscopes import NONE, endoscope
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import BENDS, inverse_of
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import Array
from trocar.procs.kinematics.walls.body import CAMERA, THICK, THIN, ArmBody
from trocar.procs.tables.arm_types import ARM_TYPES

BARE_NAMES: Final = ("yaw", "pitch", "insertion", "disc_1", "disc_2", "disc_3", "disc_4")
BARE_SLIDES: Final = (False, False, True)
DISC_RANGE: Final = math.radians(172.0)
DISC_EFFORT: Final = 0.343642  # N·m, for a PSM without an instrument
SNAKE_JOINTS: Final = 8
SNAKE_PAIRS: Final = ((4, 7), (5, 6))  # joints that share a coordinate, each bending by half of it


@dataclass(frozen=True, slots=True)
class JointSpace:
    """`count` joints are published as the arm's; one more is the jaw. joint = `to_joint` · actuator.

    `tool` is the instrument or endoscope. `v_max`, `a_max` are those of moves at ratio 1; for `arrival`, `effort_…` and
    `servo_…` see `trocar.procs.tables.arm_types`; `rated` are the largest efforts in the kinematic files (ftmax), inf
    where unspecified. Positions and velocities map alike; efforts map with the transposed matrices in the opposite
    direction, so that power is the same on both sides.
    """

    tool: str
    names: tuple[str, ...]
    count: int
    lower: Array
    upper: Array
    v_max: Array
    a_max: Array
    arrival: Array
    effort_speed: Array
    effort_zone: Array
    servo_speed: Array
    servo_acceleration: Array
    rated: Array
    to_joint: Array
    to_actuator: Array
    kinematics: Kinematics | None
    inverse: InverseSolver | None
    one_to_one: int
    """This many joints are actuators themselves; the others are coupled."""
    none: NDArray[np.bool_]
    """A mask (size,) without any joint."""
    free: Array | None = None
    """For a snake (8, 6): its joints from its independent coordinates."""
    paired: Array | None = None
    """For a snake (9, 9): makes a vector consistent for joints that bend together."""

    @property
    def size(self) -> int:
        """Size of a joint vector."""
        return len(self.lower)

    @property
    def axes(self) -> int:
        """Number of actuators."""
        return len(self.to_actuator)

    @property
    def lacks_inverse(self) -> str:
        """Why the arm has no `inverse`."""
        return "there is no instrument, so no tip" if self.kinematics is None else "no inverse kinematics of this arm"

    @property
    def has_jaw(self) -> bool:
        """Whether an instrument with a jaw is attached; the jaw's angle is the last number of a joint vector."""
        return self.count < self.size

    def clip(self, values: Array, here: Array | None = None) -> NDArray[np.bool_]:
        """Clip `values` (size,) to the limits, in place; returns which ones were outside.

        Joints of a snake that bend together get their mean. Values that are `here` already may stay: an instrument may
        have been attached beyond its limits, and must not jump.
        """
        if self.paired is not None:
            values[...] = self.paired @ values
        clipped = np.maximum(values, self.lower)
        np.minimum(clipped, self.upper, out=clipped)
        if clipped.tobytes() == values.tobytes():
            return self.none
        if here is not None:
            clipped = np.clip(values, np.minimum(self.lower, here), np.maximum(self.upper, here))
        outside: NDArray[np.bool_] = clipped != values
        values[...] = clipped
        return outside

    def name(self, axis: int) -> str:
        """The axis name for messages."""
        return self.names[axis] if axis < self.count else "jaw"

    def unit(self, axis: int) -> str:
        """Unit of its position: rad or m."""
        slides = BARE_SLIDES if self.kinematics is None else self.kinematics.is_prismatic
        return "m" if axis < len(slides) and slides[axis] else "rad"

    def short(self, goal: Array, position: Array) -> str:
        """Joints that have not arrived at a goal (size,), and by how much: 17.2° short (pitch); "": all have."""
        far = np.abs(goal - position)
        return ", ".join(f"{far[i] * 1e3:.1f} mm short ({self.name(i)})" if self.unit(i) == "m" else
                         f"{math.degrees(far[i]):.1f}° short ({self.name(i)})"
                         for i in (~(far <= self.arrival)).nonzero()[0].tolist())

    def named(self, which: NDArray[np.bool_]) -> str:
        """The names of the joints of a mask (size,)."""
        return ", ".join(self.name(int(i)) for i in which.nonzero()[0])

    def changed(self, which: NDArray[np.bool_], before: Array, after: Array) -> str:
        """Joints of a mask (size,), with their values before and after: insertion 5.000 → 0.240 m."""
        return ", ".join(f"{self.name(i)} {before[i]:.3f} → {after[i]:.3f} {self.unit(i)}"
                         for i in which.nonzero()[0].tolist())


def joints(arm: ArmConfig, tool: Tool | None = None) -> JointSpace:
    """The joint space of `arm` with or without an instrument; ValueError if the arm cannot drive it."""
    row = ARM_TYPES[arm.type]
    axes = row.actuators
    if row.joints < axes:
        return _bare(arm) if tool is None else _with_tool(arm, tool)
    tip = endoscope(arm.endoscope or NONE).tip if row.has_endoscope else None
    kinematics = Kinematics(arm.chain, tip=tip)
    if kinematics.n != axes:
        raise ValueError(f"{arm.name}: {arm.chain.source} has {kinematics.n} joints; an {arm.type} has {axes}")
    map_ = coupling(axes, arm.chain)
    return JointSpace(arm.endoscope, kinematics.names, axes, kinematics.lower, kinematics.upper, *_rates(arm.type),
                      _rated(kinematics.effort_max), map_.actuator_to_joint, map_.joint_to_actuator,
                      kinematics, inverse_of(arm.type, arm.chain, tip=tip) if row.inverse else None,
                      axes if map_.is_identity else 0, np.zeros(axes, np.bool_))


Rates = tuple[Array, Array, Array, Array, Array, Array, Array]


def _rates(arm_type: str) -> Rates:
    """v_max, a_max, arrival, effort_speed, effort_zone, servo_speed, servo_acceleration of an arm with all its axes."""
    moves, pushes, servo = ARM_TYPES[arm_type].moves, ARM_TYPES[arm_type].efforts, ARM_TYPES[arm_type].servo
    return (np.array(moves.velocity), np.array(moves.acceleration), np.array(moves.arrival), np.array(pushes.speed),
            np.array(pushes.zone), np.array(servo.speed), np.array(servo.acceleration))


def _rated(efforts: Iterable[float]) -> Array:
    values = np.array([*efforts])
    return np.where(values > 0.0, values, np.inf)


def _bare(arm: ArmConfig) -> JointSpace:
    own, axes = ARM_TYPES[arm.type].joints, ARM_TYPES[arm.type].actuators
    links = arm.chain.links
    if len(links) < own:
        raise ValueError(f"{arm.name}: {arm.chain.source} has {len(links)} joints; a {arm.type} has {own}")
    lower = np.array([link.lower for link in links[:own]] + [-DISC_RANGE] * (axes - own))
    upper = np.array([link.upper for link in links[:own]] + [DISC_RANGE] * (axes - own))
    rated = _rated((*(link.effort_max for link in links[:own]), *(DISC_EFFORT,) * (axes - own)))
    return JointSpace("", BARE_NAMES, axes, lower, upper, *_rates(arm.type), rated, np.eye(axes), np.eye(axes), None,
                      None, axes, np.zeros(axes, np.bool_))


def _with_tool(arm: ArmConfig, tool: Tool) -> JointSpace:
    kinematics = Kinematics(arm.chain, tool)
    n, axes = kinematics.n, ARM_TYPES[arm.type].actuators
    expected = SNAKE_JOINTS if tool.snake else axes - 1
    if n != expected:
        raise ValueError(f"{arm.name}: with {tool.name} there are {n} joints; {expected} were expected")
    map_ = coupling(axes, arm.chain, tool)
    spread, gather = np.eye(axes), np.eye(axes)
    rates = _rates(arm.type)
    free = paired = None
    if tool.snake:
        spread, gather = _snake(axes)
        free, paired = BENDS, spread @ gather
        v_max, a_max, near, speed, zone, servo, gain = (np.insert(values, n - 2, values[n - 3 : n - 1])
                                                        for values in rates)
        rates = (v_max, a_max, near, speed, zone, servo, gain)
    rated = _rated((*kinematics.effort_max, tool.jaw.effort_max))
    return JointSpace(tool.name, kinematics.names, n, np.append(kinematics.lower, tool.jaw.lower),
                      np.append(kinematics.upper, tool.jaw.upper), *rates, rated,
                      np.matmul(spread, map_.actuator_to_joint),
                      np.matmul(map_.joint_to_actuator, gather).astype(np.float64), kinematics,
                      inverse_of(arm.type, arm.chain, tool), ARM_TYPES[arm.type].joints, np.zeros(n + 1, np.bool_),
                      free, paired)


def _snake(axes: int) -> tuple[Array, Array]:
    """Coordinates to joints (9, 7): each joint of a pair has half; joints to coordinates (7, 9): their sum."""
    size = SNAKE_JOINTS + 1
    spread, gather = np.zeros((size, axes)), np.zeros((axes, size))
    for coordinate, joint in ((0, 0), (1, 1), (2, 2), (3, 3), (axes - 1, size - 1)):
        spread[joint, coordinate] = gather[coordinate, joint] = 1.0
    for coordinate, pair in zip((4, 5), SNAKE_PAIRS, strict=True):
        for joint in pair:
            spread[joint, coordinate], gather[coordinate, joint] = 0.5, 1.0
    return spread, gather


def body_of(arm: ArmConfig, joints: JointSpace) -> ArmBody:
    """The body of an arm with the instrument or endoscope of a joint space."""
    assert joints.kinematics is not None
    thick = CAMERA if ARM_TYPES[arm.type].has_endoscope else THIN if joints.free is not None else THICK
    return ArmBody(joints.kinematics, thick, arm.jaw_length if joints.has_jaw else 0.0)


def kinematic_home(arm: ArmConfig, joints: JointSpace) -> Array:
    """Homing position of a KINEMATIC arm (size,): inserted, so that it can move its tip from there."""
    row, goal = ARM_TYPES[arm.type], np.zeros(joints.size)
    goal[: row.joints] = row.kinematic_home[: row.joints]
    return goal
