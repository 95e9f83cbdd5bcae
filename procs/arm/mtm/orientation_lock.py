"""A master whose tip is free in its place, but not in its orientation: the arm in effort mode, the wrist following.

The first three joints place the tip; whatever they do, the other four go where the tip's axes are those that were
locked. What is missing at first, and wherever that place jumps, is made up for by a trajectory, so that nothing else
does. The platform stays where it was when locked, as far as the limits of the wrist yaw allow. Any other mode or space
ends it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.commands import ArmCommandRow, Ready, Table
from trocar.procs.arm.control import REPORT_NS, Control
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.kinematics.inverse.master import Master
from trocar.procs.kinematics.poses import Array, given_pose
from trocar.procs.kinematics.trajectory import Trajectory
from trocar.procs.node.requests import CommandRefused, Request
from trocar.procs.tables import codes

WRIST: Final = 3  # the first joint that follows
ROLL: Final = 6
FOLLOWING: Final = 4
SAME: Final = 1e-6  # rad: a goal that has moved by less is no new one
ROOM: Final = 1e-4  # rad: at a limit, but not beyond


class OrientationLock:
    """`table` has its commands; `step` comes in each cycle of effort mode, `watch` in every cycle."""

    def __init__(self, control: Control) -> None:
        self._control = control
        self._master = Master(control.arm.chain)
        self.locked = False
        self._rotation, self._seed = np.eye(3), np.zeros(control.joints.size)
        self._goal, self._velocity = np.zeros((2, FOLLOWING))
        self._trajectory = Trajectory(FOLLOWING)  # of what is missing
        self._missing, self._missing_velocity, self._nothing = np.zeros((3, FOLLOWING))
        self._start_ns = self._stepped_ns = 0
        self._failing = False
        self.table: Table = {
            "lock_orientation": ArmCommandRow(self._lock, Ready.CARTESIAN),
            "unlock_orientation": ArmCommandRow(self._unlock),
        }

    # commands

    def _lock(self, request: Request) -> None:
        """A quaternion x y z w of the tip in the reference frame, or none: as it is."""
        control = self._control
        if not self._is_free():
            raise CommandRefused("the arm is not in Cartesian effort mode; send body/servo_cf first")
        rotation = self._wanted(request)
        here = control.io.position
        found = self._master.facing(rotation, here, here)
        if found is not None:
            self._bring_within(found)
        if found is None or self._beyond(found):
            reason = f"unable to solve inverse kinematics ({self._why(found)})"
            raise control.refusal(codes.ORIENTATION_LOCK, request.name, reason, REPORT_NS)
        self._rotation[...] = rotation
        self._seed[...] = found
        self._seed[WRIST] = here[WRIST]
        self._failing = False
        if not self.locked:
            self._goal[...] = found[WRIST:]
            self._begin(here[WRIST:], control.io.velocity[WRIST:])
            self._report(True)

    def _wanted(self, request: Request) -> Array:
        cartesian = self._control.cartesian
        if len(request.values) == 0:
            return cartesian.tip[:3, :3].copy()
        cartesian.need_base()
        return cartesian.to_local(given_pose(np.concatenate((np.zeros(3), request.values))))[:3, :3].copy()

    def _unlock(self, _: Request) -> None:
        if self.locked:
            self._control.motion.in_effort[...] = True
            self._report(False)

    # the cycle

    def watch(self) -> None:
        """Whether it is still what the arm is asked for."""
        if self.locked and not self._is_free():
            self._report(False)

    def step(self) -> None:
        """Where the last four joints are to go in this cycle."""
        self.watch()
        if not self.locked:
            return
        control, motion = self._control, self._control.motion
        if control.io.holding.item():  # io held meanwhile, and so did the joints
            self._begin(control.io.setpoint[WRIST:], np.zeros(FOLLOWING))
        self._advance(control.now_ns)
        motion.in_effort[WRIST:] = False
        motion.effort[WRIST:] = 0.0
        np.add(self._goal, self._missing, out=motion.goal[WRIST:])
        np.add(self._velocity, self._missing_velocity, out=motion.velocity[WRIST:])
        motion.velocity[:WRIST] = control.io.velocity[:WRIST]  # an actuator that follows may move two joints
        motion.has_velocity = True

    def _advance(self, now_ns: int) -> None:
        """The goal of this cycle; how far it is further away than the joints may go is missing from then on."""
        self._trajectory.evaluate((now_ns - self._start_ns) * 1e-9, self._missing, self._missing_velocity)
        most = self._control.joints.v_max[WRIST:] * ((now_ns - self._stepped_ns) * 1e-9)
        self._stepped_ns = now_ns
        change = self._solve() - self._goal
        jump = change - np.clip(change, -most, most)
        self._goal += change
        self._follow_hand()
        if float(np.abs(jump).max()) > SAME:
            self._missing -= jump
            self._plan(now_ns)

    def _follow_hand(self) -> None:
        """How fast pitch, yaw and roll have to turn for the tip not to, with the platform resting."""
        control = self._control
        turning, rates = control.cartesian.jacobian[3:], control.io.velocity[:WRIST]
        self._velocity[...] = 0.0
        if not self._failing:
            v_max = control.joints.v_max[WRIST + 1 :]
            needed = np.linalg.solve(turning[:, WRIST + 1 :], -(turning[:, :WRIST] @ rates))
            np.clip(needed, -v_max, v_max, out=self._velocity[1:])

    def _solve(self) -> Array:
        """Joints (4,) for the locked orientation where the tip is now; where there are none, those of before."""
        found = self._master.facing(self._rotation, self._control.io.position, self._seed)
        if found is None or self._beyond(found):
            if not self._failing:
                self._failing = True
                self._control.report(codes.ORIENTATION_LOCK,
                                     f"the locked orientation cannot be kept: {self._why(found)}")
            return self._goal
        self._failing = False
        self._seed[WRIST + 1 :] = found[WRIST + 1 :]  # not the platform's: it comes back to where it was locked
        return found[WRIST:]

    # its parts

    def _is_free(self) -> bool:
        motion = self._control.motion
        return motion.mode is Mode.EFFORT and motion.space is Space.CARTESIAN

    def _report(self, locked: bool) -> None:
        self.locked = locked
        self._control.reports.emit("orientation_locked", value=float(locked))

    def _begin(self, position: Array, velocity: Array) -> None:
        """The joints (4,) are here, and go at this velocity."""
        limit = self._control.joints.v_max[WRIST:]
        self._follow_hand()
        np.subtract(position, self._goal, out=self._missing)
        self._missing_velocity[...] = np.clip(velocity - self._velocity, -limit, limit)
        self._stepped_ns = self._control.now_ns
        self._plan(self._control.now_ns)

    def _plan(self, now_ns: int) -> None:
        joints, motion = self._control.joints, self._control.motion
        v_max, a_max = joints.v_max[WRIST:] * motion.ratio_v, joints.a_max[WRIST:] * motion.ratio_a
        error = self._trajectory.start(self._missing, self._missing_velocity, self._nothing, v_max, a_max, 0.0)
        if error is None:  # else the one before goes on
            self._start_ns = now_ns

    def _bring_within(self, found: Array) -> None:
        """The roll may come to the same orientation a turn away from its limit."""
        joints = self._control.joints
        if found[ROLL] > joints.upper[ROLL]:
            found[ROLL] -= 2.0 * math.pi
        elif found[ROLL] < joints.lower[ROLL]:
            found[ROLL] += 2.0 * math.pi

    def _beyond(self, found: Array) -> bool:
        joints = self._control.joints
        outside = (found < joints.lower - ROOM) | (found > joints.upper + ROOM)
        return bool(outside[WRIST:].any())

    def _why(self, found: Array | None) -> str:
        if found is None:
            return "no place of the platform will do"
        joints = self._control.joints
        excess = np.maximum(joints.lower - found, found - joints.upper)[WRIST:]
        axis = WRIST + int(np.argmax(excess))
        limit = joints.upper[axis] if found[axis] > joints.upper[axis] else joints.lower[axis]
        return f"{joints.name(axis)} would be {found[axis]:.3f}, its limit is {limit:.3f}"
