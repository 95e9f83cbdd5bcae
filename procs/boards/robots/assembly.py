"""One MuJoCo model of all mechanisms, built in code, and the positions of their joints in it.

One body per axis, in the axis's own frame. Only features that the arms need are enabled: no contacts, no friction (see
friction.py), explicit damping, as it is small against inertia over one period, and gravity only if a body has weight.
So a step factors M once and runs no solver unless a joint is at its stop.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.boards.robots.mechanics import LinkAxis, Mechanism
from trocar.procs.kinematics.poses import Array, pose_from_matrix

Ints = NDArray[np.intp]

GRAVITY = 9.81  # m/s²
PAYLOAD_INERTIA = 1.0e-6  # kg·m²
STOP_S = 0.02  # time constant of the stops
TIED_STOP_PERIODS = 4.0  # the same where other axes follow: the stop feels only the weight of the one that leads


@dataclass(frozen=True, slots=True)
class Assembly:
    """The model and its maps: joints (nv,) = `spread` · robots' joints (n,), which are `gather` · joints."""

    model: mujoco.MjModel
    spread: Array
    gather: Array
    coulomb: Array  # friction (nv,), N·m or N
    joints: dict[str, Ints]  # of each robot, in the model
    ties: dict[str, Array]  # rows (followers, nv) of each robot that has any: row · joints = 0


def assemble(mechanisms: tuple[Mechanism, ...], period_s: float) -> Assembly:
    """Compile the model. Robots' joints are numbered on, mechanism after mechanism."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    option, disable = spec.option, mujoco.mjtDisableBit
    option.timestep = period_s
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    has_weight = any(one.payload > 0.0 or any(axis.has_weight for axis in one.axes) for one in mechanisms)
    option.gravity = (0.0, 0.0, -GRAVITY if has_weight else 0.0)
    option.disableflags |= disable.mjDSBL_CONTACT | disable.mjDSBL_EULERDAMP
    for one in mechanisms:
        _add(spec, one, has_weight, period_s)
    model = spec.compile()
    count = sum(axis.follows is False for one in mechanisms for axis in one.axes)
    result = Assembly(model, np.zeros((model.nv, count)), np.zeros((count, model.nv)), np.zeros(model.nv), {}, {})
    first = 0
    for one in mechanisms:
        _map(result, one, first)
        first += sum(not axis.follows for axis in one.axes)
    return result


def _add(spec: mujoco.MjSpec, one: Mechanism, has_weight: bool, period_s: float) -> None:
    bodies: list[mujoco.MjsBody] = []
    is_tied = any(axis.follows for axis in one.axes)
    for index, axis in enumerate(one.axes):
        parent = spec.worldbody if axis.parent < 0 else bodies[axis.parent]
        inside = one.base if axis.parent < 0 else one.axes[axis.parent].after
        body = parent.add_body(
            name=f"{one.robot}/{index}",
            mass=axis.mass,
            ipos=axis.com,
            inertia=axis.rotational,
            explicitinertial=True,
            gravcomp=1.0 if has_weight and not axis.has_weight else 0.0,
            **_placement(inside @ axis.before),
        )
        body.add_joint(
            name=f"{one.robot}/{index}",
            type=mujoco.mjtJoint.mjJNT_SLIDE if axis.slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=(0.0, 0.0, 1.0),
            armature=axis.inertia.armature / axis.ratio**2,
            damping=axis.inertia.viscous / axis.ratio**2,
            limited=axis.lower < axis.upper,
            range=(axis.lower, axis.upper),
            solref_limit=(TIED_STOP_PERIODS * period_s if is_tied else STOP_S, 1.0),
        )
        bodies.append(body)
    if one.payload > 0.0 and bodies:
        place = one.axes[one.tip_axis].after @ one.tip
        bodies[one.tip_axis].add_body(
            name=f"{one.robot}/payload",
            mass=one.payload,
            inertia=(PAYLOAD_INERTIA,) * 3,
            explicitinertial=True,
            **_placement(place),
        )


def _map(result: Assembly, one: Mechanism, first: int) -> None:
    """Positions of a robot's joints; `first` is that of its first one among all robots' joints."""
    places = [int(result.model.joint(f"{one.robot}/{i}").dofadr[0]) for i in range(len(one.axes))]
    leaders: dict[int, tuple[int, LinkAxis]] = {}
    ties: list[Array] = []
    for place, axis in zip(places, one.axes, strict=True):
        result.spread[place, first + axis.joint] = axis.ratio
        if axis.follows:
            led_by, leader = leaders[axis.joint]
            row = np.zeros(result.model.nv)
            row[place], row[led_by] = 1.0, -axis.ratio / leader.ratio
            ties.append(row)
        else:
            leaders[axis.joint] = place, axis
            result.gather[first + axis.joint, place] = 1.0 / axis.ratio
            result.coulomb[place] = axis.inertia.coulomb / abs(axis.ratio)
    result.joints[one.robot] = np.array(places, dtype=np.intp)
    if ties:
        result.ties[one.robot] = np.array(ties)


def _placement(matrix: Array) -> dict[str, Array]:
    """MuJoCo's pos and quat (w first) of a transform."""
    pose = pose_from_matrix(matrix)
    return {"pos": pose[:3], "quat": pose[[6, 3, 4, 5]]}


class Tips:
    """The tips of all robots of a model; everything in a robot's own base frame."""

    def __init__(self, assembly: Assembly, data: mujoco.MjData, mechanisms: tuple[Mechanism, ...]) -> None:
        """`moved` has to be called whenever joints have moved."""
        self._model, self._data = assembly.model, data
        self._bodies: dict[str, int] = {}
        self._bases: dict[str, Array] = {}
        self._places: dict[str, Array] = {}
        for one in mechanisms:
            self._bodies[one.robot] = int(assembly.model.body(f"{one.robot}/{one.tip_axis}").id) if one.axes else 0
            self._bases[one.robot] = one.base
            self._places[one.robot] = one.axes[one.tip_axis].after @ one.tip if one.axes else one.base
        self._linear, self._angular = np.zeros((3, assembly.model.nv)), np.zeros((3, assembly.model.nv))
        self._is_stale = True

    def moved(self) -> None:
        """Bodies' poses must be recomputed when next used."""
        self._is_stale = True

    def pose(self, robot: str) -> Array:
        """(4, 4)."""
        pose: Array = np.linalg.inv(self._bases[robot]) @ self._world(robot)
        return pose

    def twist(self, robot: str) -> Array:
        """(6,), linear then angular: of the tip itself, in the axes of the base."""
        point = self._world(robot)[:3, 3]
        mujoco.mj_jac(self._model, self._data, self._linear, self._angular, point, self._bodies[robot])
        turn = self._bases[robot][:3, :3].T
        return np.concatenate((turn @ (self._linear @ self._data.qvel), turn @ (self._angular @ self._data.qvel)))

    def add_pull(self, robot: str, wrench: Array, efforts: Array) -> None:
        """Add to joints' efforts (nv,) those due to a force and torque (6,) at the tip."""
        point, turn = self._world(robot)[:3, 3], self._bases[robot][:3, :3]
        force, torque = turn @ wrench[:3], turn @ wrench[3:]
        mujoco.mj_applyFT(self._model, self._data, force, torque, point, self._bodies[robot], efforts)

    def _world(self, robot: str) -> Array:
        """Pose of a tip in the world."""
        if self._is_stale:
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_comPos(self._model, self._data)
            self._is_stale = False
        body = self._bodies[robot]
        matrix = np.eye(4)
        matrix[:3, :3] = self._data.xmat[body].reshape(3, 3)
        matrix[:3, 3] = self._data.xpos[body]
        pose: Array = matrix @ self._places[robot]
        return pose
