"""A master with free tip position and locked orientation: the arm in effort mode, the wrist in position mode.

The first three joints place the tip; the other four move so that the tip keeps its locked orientation. A trajectory
removes the initial error, and the error after a jump of the wrist's goal, so that the wrist never jumps. The platform
keeps its position at the time of locking, as far as the limits of the wrist yaw allow. Any other mode or space ends the
lock.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.arm_commands import ArmCommandRow, Ready, Table
from trocar.procs.arm.control import Control
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.kinematics.inverse.master import Master
from trocar.procs.kinematics.poses import Array, given_pose
from trocar.procs.kinematics.trajectory import Trajectory
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

WRIST: Final = 3  # the first joint that follows
ROLL: Final = 6
FOLLOWING: Final = 4
SAME: Final = 1e-6  # rad: a smaller change of the goal is ignored
ROOM: Final = 1e-4  # rad: distance kept from a limit


class OrientationLock:
    """`table` has its commands; call `step` in each cycle of effort mode, `watch` in every cycle."""

    def __init__(self, control: Control) -> None:
        self._control = control
        self._master = Master(control.arm.chain)
        self.locked = False
        self._rotation, self._seed = np.eye(3), np.zeros(control.joints.size)
        self._goal, self._velocity = np.zeros((2, FOLLOWING))
        self._trajectory = Trajectory(FOLLOWING)  # of the remaining error
        self._missing, self._missing_velocity, self._nothing = np.zeros((3, FOLLOWING))
        self._start_ns = self._stepped_ns = 0
        self._failing = False
        self.table: Table = {
            "lock_orientation": ArmCommandRow(self._lock, Ready.CARTESIAN),
            "unlock_orientation": ArmCommandRow(self._unlock),
        }

    # commands

    def _lock(self, request: Request) -> None:
        """Lock at a quaternion x y z w of the tip in the reference frame, or at the present orientation."""
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
        """End the lock when the arm has left Cartesian effort mode."""
        if self.locked and not self._is_free():
            self._report(False)

    def step(self) -> None:
        """Set the goals of the last four joints in this cycle."""
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
        """Update the goal of this cycle; the part of a change beyond the joints' speed is added to the remaining error.
        """
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
        """Velocities of pitch, yaw and roll that keep the tip from turning, with the platform at rest."""
        control = self._control
        turning, rates = control.cartesian.jacobian[3:], control.io.velocity[:WRIST]
        self._velocity[...] = 0.0
        if not self._failing:
            v_max = control.joints.v_max[WRIST + 1 :]
            needed = np.linalg.solve(turning[:, WRIST + 1 :], -(turning[:, :WRIST] @ rates))
            np.clip(needed, -v_max, v_max, out=self._velocity[1:])

    def _solve(self) -> Array:
        """Joints (4,) for the locked orientation at the tip's present place; without a solution, the previous ones."""
        found = self._master.facing(self._rotation, self._control.io.position, self._seed)
        if found is None or self._beyond(found):
            if not self._failing:
                self._failing = True
                self._control.report(codes.ORIENTATION_LOCK,
                                     f"the locked orientation cannot be kept: {self._why(found)}")
            return self._goal
        self._failing = False
        self._seed[WRIST + 1 :] = found[WRIST + 1 :]  # not the platform's: it returns to where it was locked
        return found[WRIST:]

    # its parts

    def _is_free(self) -> bool:
        motion = self._control.motion
        return motion.mode is Mode.EFFORT and motion.space is Space.CARTESIAN

    def _report(self, locked: bool) -> None:
        self.locked = locked
        self._control.reports.emit("orientation_locked", value=float(locked))

    def _begin(self, position: Array, velocity: Array) -> None:
        """Start from these joints (4,) and this velocity."""
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
        if error is None:  # else the previous one continues
            self._start_ns = now_ns

    def _bring_within(self, found: Array) -> None:
        """Turn the roll by a full turn, away from its limit: the orientation is the same."""
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
            return "no position of the platform fits"
        joints = self._control.joints
        excess = np.maximum(joints.lower - found, found - joints.upper)[WRIST:]
        axis = WRIST + int(np.argmax(excess))
        limit = joints.upper[axis] if found[axis] > joints.upper[axis] else joints.lower[axis]
        return f"{joints.name(axis)} would be {found[axis]:.3f}, its limit is {limit:.3f}"
