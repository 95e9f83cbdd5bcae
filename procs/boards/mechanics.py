"""From the document's kinematic chains to one MuJoCo model of all arms, built in code.

One body per joint, in the joint's own frame, one MuJoCo joint per actuator of every robot, in document order: a PSM's
jaw is its seventh joint, its discs are four when it holds no instrument. Coupling is no part of this: the model lives
in joint space. Snake instruments and robots that no arm describes get plain axes, that turn or slide but reach nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from procs.boards.inertia import (
    DISC,
    LINK_INERTIA,
    LINK_MASS,
    LOOSE,
    LOOSE_SLIDE,
    ArmInertia,
    JointInertia,
    arm_inertia,
    wrist_inertia,
)
from procs.lib.denavit import split_row
from procs.lib.document import Actuator, Arm, Link, Robot, Tool
from procs.lib.poses import pose_from_matrix, renormalised

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s²
DISC_RANGE = math.radians(172)
MARGIN = 0.03  # rad: an arm's own stops lie beyond its file's limits, so that the host's limits are met first
MARGIN_SLIDE = 0.003  # m
INSERTION = 2  # the link along the shaft of a PSM or ECM
SNAKE_PAIRS = (0, 1, 2)  # of a snake's five links: roll, and the first of each pair that one actuator drives


@dataclass(frozen=True, slots=True)
class Axis:
    """One joint: placed at `before` in its parent's `after` frame, moving about or along its z."""

    name: str
    slides: bool
    parent: int  # index of another axis of this robot; -1: the base
    before: Array
    after: Array
    lower: float  # lower >= upper: without stops
    upper: float
    inertia: JointInertia
    mass: float = LINK_MASS
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in the body's frame
    rotational: tuple[float, float, float] = (LINK_INERTIA,) * 3
    has_weight: bool = False  # else counter-balanced


@dataclass(frozen=True, slots=True)
class Mechanism:
    """One robot: its axes in actuator order, its base in the world and its tip in the last link's frame."""

    robot: str
    axes: tuple[Axis, ...]
    base: Array
    tip_axis: int
    tip: Array


def mechanism(robot: Robot, arm: Arm | None, tool: Tool | None) -> Mechanism:
    """The mechanism of a robot; with loose axes when no arm describes it or the files do not fit its actuators."""
    count = len(robot.actuators)
    row = description(arm, count)
    if arm is None or row is None:
        loose = tuple(_loose_axis(f"axis {i}", actuator) for i, actuator in enumerate(robot.actuators))
        return Mechanism(robot.name, loose, np.eye(4), count - 1, np.eye(4))
    links = arm.chain.links
    axes = [
        _link_axis(arm.chain.convention, link, i - 1, row.joints[i], row.shaft if i == INSERTION else None)
        for i, link in enumerate(links)
    ]
    tip_axis, tip = len(links) - 1, np.eye(4)
    if tool is not None:
        axes += _snake_axes(tool, tip_axis) if tool.snake else _tool_axes(arm.chain.convention, tool, tip_axis)
        if not tool.snake:
            tip_axis, tip = len(axes) - 2, renormalised(np.array(tool.tip))
    axes += [
        _plain_axis(f"disc {i + 1}", len(links) - 1, -DISC_RANGE, DISC_RANGE, DISC) for i in range(count - len(axes))
    ]
    if len(axes) != count:
        raise ValueError(f"{arm.name}: chain and instrument have {len(axes)} joints, its robot {count} actuators")
    base = np.array(arm.chain.base) if arm.chain.base is not None else np.eye(4)
    return Mechanism(robot.name, tuple(axes), _mounting(arm.mounting_pitch or 0.0) @ base, tip_axis, tip)


def description(arm: Arm | None, actuators: int) -> ArmInertia | None:
    """The table's row for an arm whose robot has so many actuators; None when its axes have to be loose."""
    row = arm_inertia(arm.type, arm.generation) if arm is not None else None
    if arm is None or row is None or len(row.joints) != len(arm.chain.links) or len(row.initial) != actuators:
        return None
    return row


def compile_model(mechanisms: tuple[Mechanism, ...], period_s: float) -> mujoco.MjModel:
    """One model for all mechanisms, without contacts; a site `<robot>/base` and `<robot>/tip` for each."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    option = spec.option
    option.timestep = period_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.gravity = (0.0, 0.0, -GRAVITY)
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for one in mechanisms:
        _add(spec, one, period_s)
    return spec.compile()


def _add(spec: mujoco.MjSpec, one: Mechanism, period_s: float) -> None:
    base = spec.worldbody.add_body(name=f"{one.robot}/base", **_placement(one.base))
    base.add_site(name=f"{one.robot}/base")
    bodies: list[mujoco.MjsBody] = []
    for index, axis in enumerate(one.axes):
        parent = base if axis.parent < 0 else bodies[axis.parent]
        inside = np.eye(4) if axis.parent < 0 else one.axes[axis.parent].after
        body = parent.add_body(
            name=f"{one.robot}/{index}",
            mass=axis.mass,
            ipos=axis.com,
            inertia=axis.rotational,
            explicitinertial=True,
            gravcomp=0.0 if axis.has_weight else 1.0,
            **_placement(inside @ axis.before),
        )
        body.add_joint(
            name=f"{one.robot}/{index}",
            type=mujoco.mjtJoint.mjJNT_SLIDE if axis.slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=(0.0, 0.0, 1.0),
            armature=axis.inertia.armature,
            damping=axis.inertia.viscous,
            frictionloss=axis.inertia.coulomb,
            # hard enough that a stuck joint does not creep, and that friction changes sign with velocity
            solref_friction=(4.0 * period_s, 1.0),
            solimp_friction=(0.99, 0.999, 0.001, 0.5, 2.0),
            limited=axis.lower < axis.upper,
            range=(axis.lower, axis.upper),
        )
        bodies.append(body)
    end = bodies[one.tip_axis] if bodies else base
    inside = one.axes[one.tip_axis].after if bodies else np.eye(4)
    end.add_site(name=f"{one.robot}/tip", **_placement(inside @ one.tip))


def _link_axis(
    convention: str,
    link: Link,
    parent: int,
    inertia: JointInertia,
    shaft: tuple[float, float, float] | None = None,
) -> Axis:
    """A row of a kinematic file; masses of the file have weight, links without one are counter-balanced."""
    before, after = split_row(convention, link)
    slides = link.joint_type == "prismatic"
    margin = MARGIN_SLIDE if slides else MARGIN
    com = after @ np.array((*link.com, 1.0))
    return Axis(
        name=link.name,
        slides=slides,
        parent=parent,
        before=before,
        after=after,
        lower=link.lower - margin,
        upper=link.upper + margin,
        inertia=inertia,
        mass=link.mass if link.mass > 0.0 else LINK_MASS,
        com=(float(com[0]), float(com[1]), float(com[2])) if link.mass > 0.0 else (0.0, 0.0, 0.0),
        rotational=shaft if shaft is not None and any(shaft) else (LINK_INERTIA,) * 3,
        has_weight=link.mass > 0.0,
    )


def _plain_axis(name: str, parent: int, lower: float, upper: float, inertia: JointInertia) -> Axis:
    """A hinge in its parent's frame: a disc, a jaw, or an axis without geometry."""
    return Axis(name, False, parent, np.eye(4), np.eye(4), lower - MARGIN, upper + MARGIN, inertia)


def _tool_axes(convention: str, tool: Tool, parent: int) -> list[Axis]:
    """An instrument's joints as its file has them, then the jaw on the last of them."""
    inertia = wrist_inertia(np.array(tool.actuator_to_joint))
    axes = [_link_axis(convention, link, parent + i, inertia[i]) for i, link in enumerate(tool.links)]
    return [*axes, _plain_axis("jaw", parent + len(tool.links), tool.jaw.lower, tool.jaw.upper, inertia[-1])]


def _snake_axes(tool: Tool, parent: int) -> list[Axis]:
    """Roll, the two bends and the jaw as actuators drive them: each bend is the sum of two joints of the file."""
    inertia = wrist_inertia(np.array(tool.actuator_to_joint))
    axes = []
    for place in SNAKE_PAIRS:
        link, share = tool.links[place], 1.0 if place == 0 else 2.0
        axes.append(_plain_axis(link.name, parent, share * link.lower, share * link.upper, inertia[place]))
    return [*axes, _plain_axis("jaw", parent, tool.jaw.lower, tool.jaw.upper, inertia[-1])]


def _loose_axis(name: str, actuator: Actuator) -> Axis:
    slides = actuator.joint_type == "PRISMATIC"
    lower, upper = (actuator.encoder.lower, actuator.encoder.upper) if actuator.encoder is not None else (0.0, 0.0)
    margin = MARGIN_SLIDE if slides else MARGIN
    if lower < upper:
        lower, upper = lower - margin, upper + margin
    return Axis(name, slides, -1, np.eye(4), np.eye(4), lower, upper, LOOSE_SLIDE if slides else LOOSE)


def _mounting(pitch: float) -> Array:
    """The base in the world (z up), such that up is (0, sin pitch, cos pitch) in the base's axes."""
    c, s = math.cos(pitch), math.sin(pitch)
    return np.array(((1.0, 0.0, 0.0, 0.0), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0)))


def _placement(matrix: Array) -> dict[str, Array]:
    """MuJoCo's pos and quat (w first) of a transform."""
    pose = pose_from_matrix(matrix)
    return {"pos": pose[:3], "quat": pose[[6, 3, 4, 5]]}
