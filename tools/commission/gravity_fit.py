"""The weight of a master from the efforts that hold it: poses, regression, and the errors of its prediction.

The model is that of `MasterGravity`: ten terms of the masses, the same for both directions of motion, and for each of
six joints and each direction a polynomial of the joint (cables, springs, friction). The joints are fitted from the
last to the first: each adds the terms that only it and those before it feel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.arms import CABLE_ORDERS, MASS_TERMS, MASTER_JOINTS, MODELLED_JOINTS, MasterGravityParameters
from trocar.procs.kinematics.master_gravity import mass_terms
from trocar.tools.commission.window import Floats

ORDERS: Final = (4, 1, 4, 4, 4, 4)
"""Of the polynomials, joint by joint."""
MIN_POSITIONS: Final = 7
"""Of a sweep: one more than a polynomial has terms, and the first, which is not measured."""
HELD_OUT: Final = 4
"""Each fourth pose of a sweep is left out of the first fit and predicted by it."""
MAX_ERROR: Final = 0.3
SMALL_NM: Final = np.array([0.1, 0.05, 0.05, 0.05, 0.02, 0.02])
"""An error is compared with the effort and these, joint by joint."""
ELBOW: Final = (-11.0, 16.0)
"""deg: sum of joints 2 and 3 at which the arm is kept."""
DEAD_BAND: Final = (0.02, 0.02, 0.02, 0.01, 0.008, 0.008, 0.01)
SATURATION: Final = (0.2,) * MASTER_JOINTS
FRICTION: Final = (0.7, 0.01, 0.5, 0.4, 0.2, 0.2, 1.0)
"""rad/s, rad/s, share: the usual values of gravity files, which are not measured."""


@dataclass(frozen=True, slots=True)
class GravitySweep:
    """Positions (k, 7) through which one joint moves, upwards; rad."""

    joint: int
    positions: Floats


@dataclass(frozen=True, slots=True)
class HeldPoses:
    """Efforts (k, 7) that held a master at positions (k, 7), reached by moving `joint` (k,) upwards or not; N·m, rad.

    `turn` (k,): place in the sweep.
    """

    joint: NDArray[np.intp]
    upwards: NDArray[np.bool_]
    turn: NDArray[np.intp]
    position: Floats
    effort: Floats


def sweeps(left: bool, low: Floats, high: Floats, every: int = 1) -> list[GravitySweep]:
    """The motions of a left or a right master, within limits (7,); rad. `every`: so many times fewer positions."""
    side = 1.0 if left else -1.0
    roll = (-190.0, 80.0) if left else (-80.0, 190.0)
    outward = (-7.0, 40.0) if left else (-40.0, 7.0)
    rest = {4: 90.0}
    rows: list[tuple[int, tuple[float, float], int, dict[int, float]]] = [
        *((5, (-40.0, 40.0), 9, {4: pitch}) for pitch in (-80.0, -40.0, 0.0, 40.0, 90.0)),
        *((4, (-85.0, 175.0), 14, {2: elbow}) for elbow in (-10.0, 5.0, 20.0)),
        *((3, roll, 14, {**rest, 2: elbow}) for elbow in (-10.0, 5.0, 20.0)),
        *((2, (ELBOW[0] - shoulder, ELBOW[1] - shoulder), 9, {**rest, 0: 28.0 * side, 1: shoulder})
          for shoulder in (-14.0, -3.0, 8.0, 20.0)),
        (1, ELBOW, 10, rest), (0, outward, 10, rest)]
    found = []
    for joint, (begin, end), count, others in rows:
        positions = np.zeros((max(MIN_POSITIONS, count // every), MASTER_JOINTS))
        for other, degrees in others.items():
            positions[:, other] = np.radians(degrees)
        positions[:, joint] = np.linspace(np.radians(max(begin, -34.0) if joint == 2 else begin),
                                          np.radians(min(end, 34.0) if joint == 2 else end), len(positions))
        found.append(GravitySweep(joint, np.clip(positions, low, high)))
    return found


def fitted(poses: HeldPoses) -> MasterGravityParameters:
    """The parameters that predict these efforts best."""
    masses = np.zeros(MASS_TERMS)
    polynomials = np.zeros((2, MODELLED_JOINTS, CABLE_ORDERS))
    known = np.zeros(MASS_TERMS, dtype=bool)
    for joint in reversed(range(MODELLED_JOINTS)):
        rows = np.flatnonzero(poses.joint == joint)
        terms = np.array([mass_terms(q)[joint] for q in poses.position[rows]])
        free = ~known & np.any(terms != 0.0, axis=0)
        powers = poses.position[rows, joint][:, None] ** np.arange(ORDERS[joint] + 1)
        ways = [np.where(poses.upwards[rows][:, None] == up, powers, 0.0) for up in (True, False)]
        found, *_ = np.linalg.lstsq(np.hstack([terms[:, free], *ways]),
                                    poses.effort[rows, joint] - terms[:, known] @ masses[known], rcond=None)
        masses[free], known = found[: free.sum()], known | free
        polynomials[:, joint, : ORDERS[joint] + 1] = found[free.sum() :].reshape(2, -1)
    up, down = (tuple(np.concatenate([masses, way.ravel()]).tolist()) for way in polynomials)
    lower, upper = (np.append(np.round(edge(poses.effort[:, :MODELLED_JOINTS], axis=0), 5), 0.0).tolist()
                    for edge in (np.min, np.max))
    return MasterGravityParameters(up, down, tuple(lower), tuple(upper), DEAD_BAND, SATURATION, FRICTION)


def predicted(parameters: MasterGravityParameters, poses: HeldPoses) -> Floats:
    """Efforts (k, 6) by a model without its limits, each by the parameters of its direction of motion."""
    found = np.zeros((len(poses.joint), MODELLED_JOINTS))
    sets = [np.array(values) for values in (parameters.negative, parameters.positive)]
    for k, (q, up) in enumerate(zip(poses.position, poses.upwards, strict=True)):
        values = sets[int(up)]
        powers = q[:MODELLED_JOINTS, None] ** np.arange(CABLE_ORDERS)
        cables = values[MASS_TERMS:].reshape(MODELLED_JOINTS, CABLE_ORDERS)
        found[k] = mass_terms(q) @ values[:MASS_TERMS] + (powers * cables).sum(axis=1)
    return found


def errors(parameters: MasterGravityParameters, poses: HeldPoses) -> Floats:
    """Of each joint (6,) in its own sweeps, rms, N·m."""
    off = predicted(parameters, poses) - poses.effort[:, :MODELLED_JOINTS]
    return np.array([_rms(off[poses.joint == joint, joint]) for joint in range(MODELLED_JOINTS)])


def allowed(poses: HeldPoses) -> Floats:
    """The largest acceptable `errors` (6,)."""
    return np.array([MAX_ERROR * (_rms(poses.effort[poses.joint == joint, joint]) + SMALL_NM[joint])
                     for joint in range(MODELLED_JOINTS)])


def halves(poses: HeldPoses) -> Iterator[HeldPoses]:
    """Those that a first fit uses, then those that it has to predict."""
    for chosen in (poses.turn % HELD_OUT != HELD_OUT - 1, poses.turn % HELD_OUT == HELD_OUT - 1):
        yield HeldPoses(*(values[chosen] for values in (poses.joint, poses.upwards, poses.turn, poses.position,
                                                        poses.effort)))


def held(rows: Sequence[tuple[int, bool, int, Floats, Floats]]) -> HeldPoses:
    """From (joint, upwards, turn, position, effort) of each pose."""
    joint, upwards, turn, position, effort = zip(*rows, strict=True)
    return HeldPoses(np.array(joint), np.array(upwards), np.array(turn), np.array(position), np.array(effort))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
