"""What three measured poses of a Classic setup arm say about its potentiometers. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.document.cart import Cart, CartArm
from trocar.tools.commission.finding import Finding
from trocar.tools.commission.window import Floats

FEWEST: Final = 4
"""Joints of the endoscope's setup arm."""
POTS: Final = ("primary", "secondary")
NOMINAL: Final = (0.2555, 1.056, 1.365, 1.365, 1.39, 1.37)
"""Sizes of the scales of four published arms, m or rad per V; they differ by 5 %."""
BOUNDS: Final = ((-0.1, 1.2), *[(-np.radians(290.0), np.radians(290.0))] * 5)
"""Of joints, m and rad."""
MIN_WAY: Final = (0.12, *[np.radians(45.0)] * 5)
"""Way from the first to the second pose: half a volt at least, as a potentiometer's."""
MIN_V: Final = 0.5
RAILS_V: Final = (0.05, 4.45)
RESIDUAL: Final = (0.002, *[np.radians(1.0)] * 5)
"""How far the third pose may be from the line of the others: with more, operation does not know the arm's pose."""
APART: Final = 0.5
"""The same for the primary against the secondary potentiometer, as a share of that."""
SHARE: Final = (1 / 3, 2 / 3)
"""Of the way between the others, where the third pose may have a joint. An error in the first or second pose shows
there by a third of its size at least.
"""
SCALE_WITHIN, ALIKE_WITHIN = 0.15, 0.05
"""A scale against the file's, and against that of the joint's other potentiometer."""
NOISE_V, MOVED_V = 0.01, 0.02


@dataclass(frozen=True, slots=True)
class SetupSubject:
    """One setup arm with potentiometers at its first `joints`."""

    cart: Cart
    place: int
    joints: int

    @property
    def row(self) -> CartArm:
        """Its file data."""
        return self.cart.arms[self.place]

    @property
    def name(self) -> str:
        """SUJ/PSM1."""
        return f"{self.cart.name}/{self.row.name}"

    def where(self, joint: int, pots: int | None = None) -> str:
        """Location of a finding about a joint."""
        which = "" if pots is None else f", {POTS[pots]} potentiometer"
        return f"{self.name} joint {joint + 1}{which}, plug {self.row.plug}"

    def shown(self, joint: int, value: float) -> str:
        """A position in mm or degrees."""
        return f"{value * 1e3:.1f} mm" if joint == 0 else f"{np.degrees(value):.1f}°"

    def was(self, pots: int, joint: int) -> float:
        """The scale in the file; 0: none."""
        return (self.row.primary, self.row.secondary)[pots][joint][0]


@dataclass(frozen=True, slots=True)
class MeasuredPose:
    """Joints that the person has measured, m and rad, and the voltages (setup arms, 2, 6) of all plugs there."""

    position: Floats
    volts: Floats


def lines(poses: Sequence[MeasuredPose], arm: SetupSubject) -> Floats:
    """Scale and offset (2, joints, 2) of both potentiometers of each joint, through the first two poses."""
    first, second = (pose.position for pose in poses[:2])
    volts = np.array([pose.volts[arm.place, :, :arm.joints] for pose in poses[:2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = (first - second) / (volts[0] - volts[1])
    found: Floats = np.stack([scale, first - scale * volts[0]], axis=2)
    return found


def judge_rest(spread: Floats, arm: SetupSubject, *, moved: bool = False) -> list[Finding]:
    """Changes (setup arms, 2, 6) of its voltages at rest; `moved`: from before its joints were typed until after."""
    limit = MOVED_V if moved else NOISE_V
    own = np.abs(spread[arm.place, :, :arm.joints])
    if not (own > limit).any():
        return []
    pots, joint = np.unravel_index(int(own.argmax()), own.shape)
    what, remedy = "changes at rest", "its contact is bad or its cable loose, or the arm was moved"
    if moved:
        what, remedy = "changed while its joints were measured", "the arm has moved: let its brakes hold, measure again"
    return [Finding(arm.where(int(joint), int(pots)), f"its voltage {what} by {own.max():.3f} V", f"{limit:g} V",
                    remedy)]


def judge_poses(poses: Sequence[MeasuredPose], arm: SetupSubject) -> list[Finding]:
    """Whether the typed joints can be used at all."""
    first, second, third = (pose.position for pose in poses)
    found = []
    for joint in range(arm.joints):
        where, (low, high) = arm.where(joint), BOUNDS[joint]
        wrong = next((value for value in (first[joint], second[joint], third[joint]) if not low <= value <= high), None)
        way, least = abs(second[joint] - first[joint]), MIN_WAY[joint]
        if wrong is not None:
            found.append(Finding(where, f"{arm.shown(joint, wrong)} was typed",
                                 f"{arm.shown(joint, low)} to {arm.shown(joint, high)}", "is it in mm, or in degrees?"))
        elif not way >= least:
            found.append(Finding(where, f"the first two poses are {arm.shown(joint, way)} apart",
                                 f"{arm.shown(joint, least)} at least", "measure poses that are far apart"))
        elif not SHARE[0] <= (third[joint] - first[joint]) / (second[joint] - first[joint]) <= SHARE[1]:
            found.append(Finding(where, f"{arm.shown(joint, third[joint])} in the third pose",
                                 "between the others, near the middle", "bring it near the pose that was requested"))
    return found or _alike(poses, arm)


def _alike(poses: Sequence[MeasuredPose], arm: SetupSubject) -> list[Finding]:
    """Joints whose plugs could be swapped, and nothing would show it."""
    first, second, third = (pose.position for pose in poses)
    shares, ways = (third - first) / (second - first), np.abs(second - first)
    for one in range(arm.joints):
        for other in range(one):
            off = abs(shares[one] - shares[other]) * np.array([ways[one], ways[other]])
            if not (off > 1.5 * np.array([RESIDUAL[one], RESIDUAL[other]])).all():
                return [Finding(arm.where(one), f"in the third pose it is at the same share of its way as joint "
                                f"{other + 1}", "another share for each joint: else swapped plugs look right",
                                "bring both near the pose that was requested")]
    return []


def judge_pots(poses: Sequence[MeasuredPose], arm: SetupSubject) -> list[Finding]:
    """Problems of its potentiometers: dead ones, wrong plugs, slack, senses, scales."""
    moved = np.abs(poses[1].volts - poses[0].volts)
    alive = (moved[:, :, :FEWEST] >= MIN_V).mean(axis=(1, 2))
    if alive[arm.place] < 0.5 and alive.max() > 0.5:
        other = int(alive.argmax())
        return [Finding(arm.name, f"its potentiometers did not change, those of {arm.cart.arms[other].name} did",
                        f"plug {arm.row.plug} changes",
                        "are the plugs of these two arms swapped, or was another arm moved?")]
    found = [each for pots in range(2) for joint in range(arm.joints) for each in _dead(poses, arm, pots, joint)]
    found = found or list(_off(poses, arm))
    return found or [each for joint in range(arm.joints) for each in _scales(poses, arm, joint)]


def _dead(poses: Sequence[MeasuredPose], arm: SetupSubject, pots: int, joint: int) -> Iterator[Finding]:
    volts = np.array([pose.volts[arm.place, pots, joint] for pose in poses])
    where = arm.where(joint, pots)
    if not (volts.min() >= RAILS_V[0] and volts.max() <= RAILS_V[1]):
        yield Finding(where, f"{volts.min():.3f} to {volts.max():.3f} V", f"{RAILS_V[0]:g} to {RAILS_V[1]:g} V",
                      "its cable is loose or short-circuited, or its end is within the arm's range")
    elif not abs(volts[1] - volts[0]) >= MIN_V:
        yield Finding(where, f"its voltage changed by {abs(volts[1] - volts[0]):.3f} V from the first to the second "
                      "pose", f"{MIN_V:g} V at least", "it is dead, its cable is loose, or this joint was not moved")


def _off(poses: Sequence[MeasuredPose], arm: SetupSubject) -> Iterator[Finding]:
    """Joints whose third pose is not on the line of the others."""
    off = _residuals(poses, arm)
    limits = np.array(RESIDUAL[:arm.joints])
    for joint in range(arm.joints):
        for pots in range(2):
            limit, miss, other_miss = limits[joint], off[joint, pots, joint], off[joint, 1 - pots, joint]
            apart = miss - other_miss
            if abs(miss) <= limit and abs(apart) <= APART * limit:
                continue
            others = np.abs(off[joint])
            others[:, joint] = np.inf
            if abs(miss) > limit and others.min() <= limit:
                which, other = np.unravel_index(int(others.argmin()), others.shape)
                yield Finding(arm.where(joint, pots), "it does not follow its joint; the "
                              f"{POTS[which]} potentiometer of joint {other + 1} does", "its own joint",
                              "are their plugs swapped?")
            elif abs(apart) <= APART * limit:
                yield Finding(arm.where(joint), f"the third pose is {arm.shown(joint, miss)} off, by both "
                              "potentiometers", arm.shown(joint, limit), "one of its three values is mistyped or not "
                              "well measured, or the joint has slack: measure again")
                break
            elif abs(miss) >= abs(other_miss):
                yield Finding(arm.where(joint, pots), f"it is {arm.shown(joint, miss)} off in the third pose, the "
                              f"other one {arm.shown(joint, other_miss)}",
                              f"{arm.shown(joint, limit)}, and half of that between them",
                              "it has slack, or is worn or loose")


def _residuals(poses: Sequence[MeasuredPose], arm: SetupSubject) -> Floats:
    """(joints, 2, joints): each joint in the third pose by the line of each potentiometer through the first two, less
    the measured one.
    """
    first, second, third = (pose.position for pose in poses)
    volts = np.array([pose.volts[arm.place, :, :arm.joints] for pose in poses])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (volts[2] - volts[0]) / (volts[1] - volts[0])
    found: Floats = first[:, None, None] + (second - first)[:, None, None] * share - third[:, None, None]
    return found


def _scales(poses: Sequence[MeasuredPose], arm: SetupSubject, joint: int) -> Iterator[Finding]:
    scales, unit = lines(poses, arm)[:, joint, 0], "m/V" if joint == 0 else "rad/V"
    for pots, scale in enumerate(scales):
        was = arm.was(pots, joint)
        if was and was * scale < 0.0:
            yield Finding(arm.where(joint, pots), f"it runs the other way: scale {scale:+.4g} {unit}, in the file "
                          f"{was:+.4g}", "the file's sign", "was the joint measured with the wrong sign, or is its "
                          "plug reversed? If the file is wrong, change its sign first")
        elif not abs(abs(scale) / abs(was or NOMINAL[joint]) - 1.0) <= SCALE_WITHIN:
            yield Finding(arm.where(joint, pots), f"scale {scale:+.4g} {unit}",
                          f"{was or NOMINAL[joint]:.4g} {unit} within {100 * SCALE_WITHIN:g} %, as "
                          f"{'in the file' if was else 'of published arms'}",
                          "is a value mistyped, or is this another arm?")
    if not abs(scales[0] / scales[1] - 1.0) <= ALIKE_WITHIN:
        yield Finding(arm.where(joint), f"scales {scales[0]:+.4g} and {scales[1]:+.4g} {unit}",
                      f"alike within {100 * ALIKE_WITHIN:g} %",
                      "one of its potentiometers is broken or not the right one")
