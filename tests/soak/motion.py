"""The truth about one emulated robot: what its boards recorded, turned into speeds of joints and of the tip.

A speed is the mean over WINDOW records of the boards (a record a physics step): what moves less than WINDOW steps times
a limit is no motion that a hand could feel, and the ripple of a controller's current is not its speed. Time that the
boards were held up is left out, because their robots stand still meanwhile; restarts of the boards cut the record.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import ArmConfig, SystemConfig
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.tables.arm_types import ARM_TYPES

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Truth = NDArray[Any]
"""Records of the boards' state, with `epoch` (of the writer) in front of them."""

WINDOW = 10  # records
GOING = 40  # records: when io or the bus is gone, the last currents flow until the boards' watchdog cuts them
BLINK = 60  # records: io lets an amplifier be off for 50 ms before it calls that a fault
MIN_LEVER_M = 0.004  # a joint that turns the tip on the spot moves its surface: an instrument is 8 mm thick


def bounds(kind: str) -> Array:
    """How fast setpoints of a type's joints go at most, by streams or moves."""
    return np.maximum(ARM_TYPES[kind].servo.speed, ARM_TYPES[kind].moves.velocity)


@dataclass(frozen=True, slots=True)
class Motion:
    """One robot, k speeds: when they were (ns), of its joints (k, n), levers (k, n), of the tip; what is `powered`:
    had power all the time, and was not about to lose it (GOING).

    A lever is how fast the tip moves for a joint's speed of 1: m/rad, at least MIN_LEVER_M; 1 of a prismatic one.
    The jaw is the last joint of an arm that has one.
    """

    robot: str
    kind: str
    stamp_ns: NDArray[np.int64]
    speed: Array
    lever: Array
    linear: Array
    angular: Array
    powered: Flags


@dataclass(frozen=True, slots=True)
class SetpointTrace:
    """Where one robot's joints (k, n) were asked to be, `who` says by whose record.

    `follows`: a joint controller goes there; `in_effort`: efforts are applied instead. `run` is another number after
    whatever sets setpoints anew: another process, the joint controller on again, encoders set.
    """

    robot: str
    who: str
    stamp_ns: NDArray[np.int64]
    position: Array
    follows: Flags
    in_effort: Flags
    run: NDArray[np.int64]
    is_prismatic: Flags


class MotionTruth:
    """Where a robot lies in the boards' record, and its kinematics."""

    def __init__(self, system: SystemConfig, arm: ArmConfig) -> None:
        """`arm` has a robot and, a PSM, its one instrument."""
        first = 0
        for io in system.ios:  # of which there is one
            for place, robot in enumerate(io.robots):
                if robot.name == arm.robot:
                    self.place, self.axes = place, slice(first, first + len(robot.actuators))
                first += len(robot.actuators)
        self.name, self.kind = arm.name, arm.type
        self._coupling = coupling(self.axes.stop - self.axes.start, arm.chain, arm.tool)
        self._chain = Kinematics(arm.chain, arm.tool)
        self._is_prismatic = np.zeros(self._coupling.n, dtype=np.bool_)
        self._is_prismatic[: self._chain.n] = self._chain.is_prismatic

    def powered(self, truth: Truth) -> Flags:
        """Records (k,) in which every amplifier of the robot is on."""
        on: Flags = truth["amp_on"][:, self.axes].all(axis=1)
        return on

    def up(self, truth: Truth) -> Flags:
        """Records (k,) in which the robot has power: as `powered`, but while one amplifier blinks and others are on."""
        up, some = self.powered(truth), truth["amp_on"][:, self.axes].any(axis=1)
        edges = np.flatnonzero(np.diff(up.astype(np.int8), prepend=1, append=1))
        for begin, end in edges.reshape(-1, 2):
            if begin > 0 and end < len(up) and end - begin <= BLINK and some[begin:end].all():
                up[begin:end] = True
        return up

    def switched_on(self, truth: Truth) -> Flags:
        """Records (k,) in which an amplifier of the robot is on that was off in the one before, but for blinking."""
        on, up = truth["amp_on"][:, self.axes], self.up(truth)
        rising: Flags = on.any(axis=1)
        rising[1:] = (on[1:] & ~on[:-1]).any(axis=1) & ~(up[1:] & up[:-1])
        return rising

    def setpoints(self, io: Truth) -> SetpointTrace:
        """By io's records."""
        in_effort: Flags = io["effort_mode"][:, self.axes].any(axis=1)
        driven = io["pid_enabled"][:, self.place]
        return SetpointTrace(
            self.name, "io", io["stamp_ns"], io["setpoint_position"][:, self.axes] @ self._coupling.actuator_to_joint.T,
            driven & ~in_effort, driven & in_effort, self._runs(
                io["epoch"], io["pid_generation"][:, self.place], io["bias_generation"][:, self.place], in_effort),
            self._is_prismatic)

    def asked(self, arm: Truth) -> SetpointTrace:
        """By what the arm asks io for."""
        count = self.axes.stop - self.axes.start
        in_effort: Flags = arm["in_effort"][:, :count].any(axis=1)
        drives = arm["mode"] == 1
        return SetpointTrace(
            self.name, "the arm", arm["stamp_ns"], arm["position"][:, :count] @ self._coupling.actuator_to_joint.T,
            drives & ~in_effort, drives & in_effort,
            self._runs(arm["epoch"], arm["pid_generation"], arm["bias_generation"], in_effort), self._is_prismatic)

    def _runs(self, *columns: NDArray[Any]) -> NDArray[np.int64]:
        begins = np.zeros(len(columns[0]), dtype=np.bool_)
        for column in columns:
            begins[1:] |= column[1:] != column[:-1]
        return np.cumsum(begins)

    def motion(self, truth: Truth, period_s: float) -> Motion:
        """Speeds over every WINDOW records; windows without power all the time are there, and say so."""
        starts = np.arange(0, len(truth) - WINDOW, WINDOW)
        ends = starts + WINDOW
        whole = (truth["epoch"][starts] == truth["epoch"][ends]) & (
            truth["sequence"][ends] - truth["sequence"][starts] == WINDOW)
        starts, ends = starts[whole], ends[whole]
        joints = truth["position"][:, self.axes] @ self._coupling.actuator_to_joint.T
        change = joints[ends] - joints[starts]
        span_s = WINDOW * period_s
        on = np.concatenate(([0], np.cumsum(self.powered(truth))))
        afterwards = np.minimum(ends + 1 + GOING, len(truth))
        powered = on[afterwards] - on[starts] == afterwards - starts
        lever = np.ones_like(change)
        twist = np.zeros((len(change), 6))
        n = self._chain.n
        for k in range(len(change)):
            jacobian = self._chain.body_jacobian(np.ascontiguousarray(joints[starts[k], :n]))
            lever[k, :n] = np.linalg.norm(jacobian[:3], axis=0)
            twist[k] = jacobian @ change[k, :n]
        lever[:, ~self._is_prismatic] = np.maximum(lever[:, ~self._is_prismatic], MIN_LEVER_M)
        lever[:, n:] = MIN_LEVER_M
        return Motion(self.name, self.kind, truth["stamp_ns"][ends], np.abs(change) / span_s, lever,
                      np.linalg.norm(twist[:, :3], axis=1) / span_s, np.linalg.norm(twist[:, 3:], axis=1) / span_s,
                      powered)
