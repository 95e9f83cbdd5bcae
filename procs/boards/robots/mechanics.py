"""From the document's kinematic chains to the mechanisms of the robots: their links and what drives them.

Robots have one joint per actuator, as PID and coupling know them: a PSM's jaw is its seventh joint, its discs are four
when it holds no instrument. Most joints are one axis of the mechanism. A bend of a snake instrument is two axes that
share its motion, and an Si arm has the links of its parallelogram beside the two axes that its kinematics know; those
are the axes that follow. Coupling is not included. Robots without an arm description get plain axes without a tip.

Inertia and friction of arms are in `trocar.procs.tables.arm_types`; here are those of other robots on boards, and of
instruments. Viscous and Coulomb friction of the wrist are from the recording of a real PSM; its inertia was too small
to be identified there, and is the minimum that keeps the stock gains stable at a 1 ms hold: armature >= 2 · Kd · period
on every axis.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from trocar.procs.boards.robots.friction import SHARE
from trocar.procs.document.system import Actuator, ArmConfig, Chain, DhLink, ModelVariation, Robot, Tool
from trocar.procs.kinematics.endoscopes import endoscope
from trocar.procs.kinematics.forward import split_row
from trocar.procs.kinematics.poses import Array, renormalised
from trocar.procs.tables.arm_types import ARM_TYPES, ArmInertia, JointInertia

DISC = JointInertia(4.0e-4, 0.004, 0.004)  # of a PSM without instrument
WRIST_FRICTION = (  # viscous, Coulomb of roll, wrist pitch, wrist yaw, jaw: at the joints, behind the coupling
    (0.0009, 0.0027),
    (0.0088, 0.0071),
    (0.0090, 0.0069),
    (0.0088, 0.0110),
)
LOOSE = JointInertia(1.0e-3, 0.01, 0.002)  # an axis of a robot that no arm describes: grippers, sensors
LOOSE_SLIDE = JointInertia(1.0, 10.0, 2.0)
GRIPPER_RANGE = (-0.2, 1.1)  # rad, of a master's gripper; its file has no limits
GRIPPER_INITIAL = 0.5

SET_UP_SLIDE = JointInertia(30.0, 200.0, 40.0)  # the column of a setup arm; brakes and balance are in the friction
SET_UP_HINGE = JointInertia(2.0, 10.0, 8.0)

LINK_MASS = 0.05  # kg, of links without mass in their file; counter-balanced, so only a small part of the inertia
LINK_INERTIA = 1.0e-5  # kg·m², about every axis of such a link

SET_UP_ARMS = {
    "Classic": ArmInertia(
        joints=(SET_UP_SLIDE, *(SET_UP_HINGE,) * 5),
        initial=(0.05, -0.6, 1.2, -0.4, 0.2, 0.2),
    ),
    "Si": ArmInertia(
        joints=(SET_UP_SLIDE, *(SET_UP_HINGE,) * 6),
        initial=(0.2, -0.3, 1.2, 0.8, 0.0, 0.0, 0.0),
    ),
}


def wrist_inertia(actuator_to_joint: Array) -> tuple[JointInertia, ...]:
    """Rows for an instrument's roll, wrist and jaw, from its coupling (4, 4).

    A motor must feel no less through the instrument than its bare disc, or gains that hold the disc shake the wrist:
    Aᵀ·D·A >= I·1 for the diagonal D wanted here, that is D >= I·(A·Aᵀ)⁻¹. Sums along the rows make sure of it.
    """
    inverse = np.linalg.inv(actuator_to_joint @ actuator_to_joint.T)
    armature = DISC.armature * np.abs(inverse).sum(axis=1)
    return tuple(JointInertia(float(a), *friction) for a, friction in zip(armature, WRIST_FRICTION, strict=True))


def arm_inertia(arm_type: str, generation: str, joints: int) -> ArmInertia | None:
    """The row of an arm type with this many joints; None for types without one (their axes are loose).

    MTML and MTMR count as MTM; setup arms have more or fewer joints.
    """
    if arm_type.startswith("SUJ"):
        row = SET_UP_ARMS.get(generation, SET_UP_ARMS["Classic"])
        return ArmInertia(row.joints[:joints], row.initial[:joints])
    known = ARM_TYPES.get("MTM" if arm_type.startswith("MTM") else arm_type)
    return (known.plant.get(generation) or known.plant.get("Classic")) if known is not None else None


DISC_RANGE = math.radians(172)
MARGIN = 0.03  # rad: an arm's own stops are beyond its file's limits, so that the host's limits act first
MARGIN_SLIDE = 0.003  # m
INSERTION = 2  # the link along the shaft of a PSM or ECM
SNAKE = ((3, 1.0), (4, 0.5), (5, 0.5), (5, 0.5), (4, 0.5))  # the joint that moves each of its links, and its share
NOTHING = JointInertia(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LinkAxis:
    """One link: placed at `before` in its parent's `after` frame, moving about or along its z."""

    name: str
    joint: int  # the robot's joint that moves it
    slides: bool
    parent: int  # index of another axis of this robot; -1: the base
    before: Array
    after: Array
    lower: float  # lower >= upper: without stops
    upper: float
    inertia: JointInertia  # of the joint; nothing for an axis that follows
    ratio: float = 1.0  # its motion per its joint's
    follows: bool = False  # another axis of the same joint
    mass: float = LINK_MASS
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in the body's frame
    rotational: tuple[float, float, float] = (LINK_INERTIA,) * 3
    has_weight: bool = False  # else counter-balanced


@dataclass(frozen=True, slots=True)
class Mechanism:
    """One robot: its axes, its base in the world and its tip, with a load there, in the last link's frame."""

    robot: str
    axes: tuple[LinkAxis, ...]
    base: Array
    tip_axis: int
    tip: Array
    payload: float = 0.0


def mechanism(robot: Robot, arm: ArmConfig | None, tool: Tool | None, links: Chain | None,
              like: ModelVariation) -> Mechanism:
    """The mechanism of a robot; with loose axes when no arm describes it or the files do not fit its actuators.

    `links` are those of an Si arm as they really are, with their masses; without them its arm is counter-balanced.
    """
    count = len(robot.actuators)
    row = description(arm, count)
    if arm is None or row is None:
        loose = tuple(_loose_axis(robot.name, i, actuator) for i, actuator in enumerate(robot.actuators))
        return _like(Mechanism(robot.name, loose, np.eye(4), count - 1, np.eye(4)), like)
    axes = _chain_axes(arm.chain, row, bare=links is not None)
    tip_axis, tip = len(axes) - 1, np.eye(4)
    if tool is not None:
        axes += _tool_axes(arm.chain.convention, tool, tip_axis)
        tip_axis, tip = len(axes) - 2, renormalised(np.array(tool.tip))
    moved = len({axis.joint for axis in axes})
    discs = [_plain_axis(f"disc {i}", i, INSERTION, -DISC_RANGE, DISC_RANGE, DISC) for i in range(moved, count)]
    if moved + len(discs) != count:
        raise ValueError(f"{arm.name}: chain and instrument have {moved} joints, its robot {count} actuators")
    axes += discs
    if links is not None:
        axes = _with_real_links(arm, axes, links)
    return _like(Mechanism(robot.name, tuple(axes), _mounting(arm.mounting_pitch or 0.0), tip_axis, tip), like)


def parallelogram(arm: ArmConfig) -> Chain | None:
    """The real links of an arm, if they are more than its kinematics model."""
    return arm.links if arm.links is not None and len(arm.links.links) > len(arm.chain.links) else None


def laden(arm: ArmConfig) -> ArmConfig:
    """An arm with the mass of its endoscope on the link that carries it; other arms unchanged."""
    if not arm.endoscope:
        return arm
    mass = endoscope(arm.endoscope).mass
    if arm.links is not None and parallelogram(arm) is not None:
        return dataclasses.replace(arm, links=_weighted(arm.links, len(arm.links.links) - 1, mass))
    return dataclasses.replace(arm, chain=_weighted(arm.chain, INSERTION, mass))


def _weighted(chain: Chain, place: int, mass: float) -> Chain:
    links = list(chain.links)
    links[place] = dataclasses.replace(links[place], mass=mass)
    return dataclasses.replace(chain, links=tuple(links))


def description(arm: ArmConfig | None, actuators: int) -> ArmInertia | None:
    """The table's row for an arm whose robot has this many actuators; None if its axes must be loose."""
    row = arm_inertia(arm.type, arm.generation, len(arm.chain.links)) if arm is not None else None
    if arm is None or row is None or len(row.joints) != len(arm.chain.links) or len(row.initial) != actuators:
        return None
    return row


def _chain_axes(chain: Chain, row: ArmInertia, bare: bool) -> list[LinkAxis]:
    """The links of an arm; `bare`: their masses are elsewhere."""
    axes = []
    for i, link in enumerate(chain.links):
        shaft = row.shaft if i == INSERTION else None
        link = dataclasses.replace(link, mass=0.0) if bare else link
        axis = _link_axis(chain.convention, link, i, i - 1, row.joints[i], shaft)
        axes.append(dataclasses.replace(axis, lower=link.lower) if i == row.homed_at_stop else axis)
    if chain.base is not None:
        axes[0] = dataclasses.replace(axes[0], before=np.array(chain.base) @ axes[0].before)
    return axes


def _link_axis(
    convention: str,
    link: DhLink,
    joint: int,
    parent: int,
    inertia: JointInertia,
    shaft: tuple[float, float, float] | None = None,
) -> LinkAxis:
    """A row of a kinematic file; masses of the file have weight, links without one are counter-balanced."""
    before, after = split_row(convention, link)
    slides = link.joint_type == "prismatic"
    margin = MARGIN_SLIDE if slides else MARGIN
    com = after @ np.array((*link.com, 1.0))
    return LinkAxis(
        name=link.name,
        joint=joint,
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


def _plain_axis(name: str, joint: int, parent: int, lower: float, upper: float, inertia: JointInertia) -> LinkAxis:
    """A hinge in its parent's frame: a disc, a jaw, or an axis without geometry."""
    return LinkAxis(name, joint, False, parent, np.eye(4), np.eye(4), lower - MARGIN, upper + MARGIN, inertia)


def _tool_axes(convention: str, tool: Tool, parent: int) -> list[LinkAxis]:
    """An instrument's links as in its file, then the jaw on the last of them.

    Its stops are also beyond the engage positions: in some files these are outside the file's own limits.
    """
    inertia = wrist_inertia(np.array(tool.actuator_to_joint))
    first = parent + 1
    moved_by = SNAKE if tool.snake else tuple((first + i, 1.0) for i in range(len(tool.links)))
    if len(moved_by) != len(tool.links):
        raise ValueError(f"{tool.name}: {len(tool.links)} links; a snake has {len(SNAKE)}")
    axes: list[LinkAxis] = []
    for link, (joint, ratio) in zip(tool.links, moved_by, strict=True):
        follows = any(axis.joint == joint for axis in axes)
        own = NOTHING if follows else inertia[joint - first]
        axis = _link_axis(convention, link, joint, parent, own)
        engaged = ratio * tool.engage_lower[joint - first], ratio * tool.engage_upper[joint - first]
        lower, upper = min(axis.lower, engaged[0] - MARGIN), max(axis.upper, engaged[1] + MARGIN)
        axes.append(dataclasses.replace(axis, ratio=ratio, follows=follows, lower=lower, upper=upper))
        parent += 1
    jaw = first + len(inertia) - 1
    return [*axes, _plain_axis("jaw", jaw, parent, tool.jaw.lower, tool.jaw.upper, inertia[-1])]


def _with_real_links(arm: ArmConfig, axes: list[LinkAxis], chain: Chain) -> list[LinkAxis]:
    """An Si arm with the links of its parallelogram, which have the masses, beside the axes that its kinematics know.

    Both turn about the same first axis; the file of the real links has its base elsewhere along it.
    """
    moved_by = ARM_TYPES[arm.type].parallelogram
    if len(moved_by) != len(chain.links):
        raise ValueError(f"{arm.name}: {len(chain.links)} links with masses; allowed: {len(moved_by)}")
    rows = [split_row(chain.convention, link) for link in chain.links]
    ends = [np.eye(4), np.eye(4)]
    for axis in axes[: INSERTION + 1]:
        ends[0] = ends[0] @ axis.before @ axis.after
    for before, after in rows:
        ends[1] = ends[1] @ before @ after
    along = axes[0].before[:3, 2]
    shift = np.eye(4)
    shift[:3, 3] = along * (along @ (ends[0] - ends[1])[:3, 3])
    pending = np.linalg.inv(axes[0].before) @ shift
    parent = 0
    result = list(axes)
    for link, (before, after), moved in zip(chain.links, rows, moved_by, strict=True):
        pending = pending @ before
        if moved == (0, 1.0):
            result[0] = _carrying(axes[0], link, pending @ after)
        elif moved is not None:
            free = dataclasses.replace(link, lower=0.0, upper=0.0)
            axis = _link_axis(chain.convention, free, moved[0], parent, NOTHING)
            result.append(dataclasses.replace(axis, before=pending, after=np.eye(4), lower=0.0, upper=0.0,
                                              ratio=moved[1], follows=True))
            parent, pending = len(result) - 1, np.eye(4)
        pending = pending @ after
    return result


def _carrying(axis: LinkAxis, link: DhLink, place: Array) -> LinkAxis:
    """An axis with the mass of a link at `place` on it."""
    com = place @ np.array((*link.com, 1.0))
    return dataclasses.replace(axis, mass=link.mass, com=(float(com[0]), float(com[1]), float(com[2])), has_weight=True)


def _loose_axis(robot: str, joint: int, actuator: Actuator) -> LinkAxis:
    slides = actuator.joint_type == "PRISMATIC"
    lower, upper = (actuator.encoder.lower, actuator.encoder.upper) if actuator.encoder is not None else (0.0, 0.0)
    if lower >= upper and is_gripper(robot):
        lower, upper = GRIPPER_RANGE
    margin = MARGIN_SLIDE if slides else MARGIN
    if lower < upper:
        lower, upper = lower - margin, upper + margin
    inertia = LOOSE_SLIDE if slides else LOOSE
    return LinkAxis(f"axis {joint}", joint, slides, -1, np.eye(4), np.eye(4), lower, upper, inertia)


def is_gripper(robot: str) -> bool:
    """Whether a robot is the gripper of a master, by its name in the site's files."""
    return robot.endswith("_gripper")


def has_play(like: ModelVariation) -> bool:
    """Whether any drive of a robot has play; all its motors are masses of their own then."""
    return any(gap > 0.0 for gap in like.backlash)


def _like(one: Mechanism, like: ModelVariation) -> Mechanism:
    """As the robot really is."""
    joints = 1.0 - SHARE if has_play(like) else 1.0  # the part not due to the motors
    if (like.friction, like.inertia, like.mass, like.payload, joints) == (1.0, 1.0, 1.0, 0.0, 1.0):
        return one
    axes = []
    for axis in one.axes:
        old = axis.inertia
        inertia = JointInertia(
            armature=joints * like.inertia * old.armature,
            viscous=like.friction * old.viscous,
            coulomb=joints * like.friction * old.coulomb,
        )
        mass = like.mass * axis.mass if axis.has_weight else axis.mass
        axes.append(dataclasses.replace(axis, inertia=inertia, mass=mass))
    return dataclasses.replace(one, axes=tuple(axes), payload=like.payload)


def _mounting(pitch: float) -> Array:
    """The base in the world (z up), such that up is (0, sin pitch, cos pitch) in the base's axes."""
    c, s = math.cos(pitch), math.sin(pitch)
    return np.array(((1.0, 0.0, 0.0, 0.0), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0)))
