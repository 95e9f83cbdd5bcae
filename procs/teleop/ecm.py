"""Camera teleoperation: two masters and an ECM."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from trocar.procs.document.consoles import TeleopEcmConfig as Settings
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix
from trocar.procs.tables import codes
from trocar.procs.teleop.arms import IN_REFERENCE_FRAME, WRENCH_LASTS_S, TeleopArm
from trocar.procs.teleop.camera import APART, Camera, outside, too_close
from trocar.procs.teleop.teleop import StateRow, Teleop, TeleopContext
from trocar.shm.operator_topics import TeleopState

JOINTS: Final = 4
MAX_STEP: Final = 0.1  # rad, m: no hands move a camera further in a cycle, but crossing hands turn it over
MIN_APART: Final = 0.5 * APART  # m, while following: the masters' forces keep their distance
NEW_TURN: Final = 1e-3  # rad, m: masters are turned again when a joint of the camera has moved by this much


class TeleopEcm(Teleop):
    """States and motion of two masters and an ECM; see Teleop. The head sensor is not used, only the console's timeout.
    """

    def __init__(self, settings: Settings, left: TeleopArm, right: TeleopArm, slave: TeleopArm,
                 context: TeleopContext) -> None:
        super().__init__(settings.name, (left, right, slave), context)
        self.masters, record = (left, right), context.record
        self.camera = Camera(record.scale(settings.scale), settings.camera_roll_offset)
        self._checks_workspace = settings.check_mtms_workspace
        self._first_turns = np.zeros((2, 3, 3))
        self._turned, self._goal = np.zeros(JOINTS), np.zeros(JOINTS)
        self._wrench, self._pose, self._turn = np.zeros(8), np.zeros(7), np.eye(4)
        self._wrench[6:] = WRENCH_LASTS_S, IN_REFERENCE_FRAME
        field = record.field
        self._goal_shown, self._sent = field("goal_jp"), field("sent_ns")
        self._stamps = field("master_stamp_ns"), field("slave_stamp_ns")
        record.show_scale(self.camera.scale)
        field("mtm_is_haptic")[...] = True

    def states(self) -> Mapping[TeleopState, StateRow]:
        return {TeleopState.DISABLED: StateRow(self._leave_masters, self.begin),
                TeleopState.ENABLED: StateRow(self._begin_following, self._run_following)}

    def set_up(self) -> None:
        if not all(arm.has_pose for arm in self.arms):
            self.reason = "waiting: the poses of all three arms in their reference frames are not known yet"
            return
        for master in self.masters if self._checks_workspace else ():
            reason = outside(master.name, master.measured[:3])
            if reason:
                self.stop(codes.MASTER_OUTSIDE, reason, master.name)
                return
        left, right = self.masters
        close = too_close(left.measured[:3], right.measured[:3])
        self.wait(f"waiting: {close}" if close else "")
        if not close:
            self.go(TeleopState.ENABLED)

    def _leave_masters(self) -> None:
        for master in self.masters:
            master.leave()

    def knows_poses(self) -> bool:
        unknown = [arm.name for arm in self.arms if not arm.has_pose]
        if unknown:
            self.stop(codes.POSE_UNKNOWN, f"the pose of {unknown[0]} in its reference frame is not known", unknown[0])
        return not unknown

    def lose(self) -> None:
        if self.operator.is_silent:
            self.stop(codes.OPERATOR_TIMEOUT, self.operator.absence, self.operator.console)

    # ENABLED

    def _begin_following(self) -> None:
        self.was_refused = False
        self.begin_here()
        self._free_masters()
        if not self.clutched:
            self.follow(True)

    def begin_here(self) -> None:
        left, right = self.masters
        self.camera.begin(left.measured[:3], right.measured[:3], self.slave.joint_setpoint[:JOINTS])
        self._goal[...] = self.camera.goal

    def _free_masters(self) -> None:
        """Free the masters' positions and lock their orientations."""
        for turn, master in zip(self._first_turns, self.masters, strict=True):
            turn[...] = matrix_from_pose(master.measured)[:3, :3]
            if master.is_ready:
                master.let_go()
                master.send("lock_orientation")
        self._turned[...] = self.camera.goal

    def _run_following(self) -> None:
        if not self.clutched and self._may_follow() and self.takes_goals() and self._send_goal():
            left, right = self.masters
            self._guide_masters()
            self.reason = self.slave.refusal or self.slave.limit or left.refusal or right.refusal

    def _may_follow(self) -> bool:
        taken = [master.name for master in self.masters if master.is_taken]
        if taken:
            self.stop(codes.ARM_TAKEN, f"{taken[0]} is moved or held by another program", taken[0])
        return not taken

    def _send_goal(self) -> bool:
        """Send the camera's joints for the masters' places; False: it would jump, and following has stopped."""
        left, right = self.masters
        close = too_close(left.measured[:3], right.measured[:3], MIN_APART)
        if close:
            self.stop(codes.CAMERA_JUMP, close)
            return False
        goal = self.camera.step(left.measured[:3], right.measured[:3], left.twist[:3], right.twist[:3])
        if not float(np.abs(goal - self._goal).max()) <= MAX_STEP:
            self.stop(codes.CAMERA_JUMP, "the camera would jump: hands are crossed, or one behind the other")
            return False
        self._goal[...] = goal
        if self.slave.pursue("servo_jp", goal):
            self._goal_shown[...], self._sent[...] = goal, self.now_ns
        return True

    def _guide_masters(self) -> None:
        """Keep their distance by forces, and turn them with the camera."""
        turned = float(np.abs(self._goal - self._turned).max()) > NEW_TURN
        for master, force, first in zip(self.masters, (self.camera.left_force, self.camera.right_force),
                                        self._first_turns, strict=True):
            if master.is_kinematic:
                continue  # a force would only end a move commanded by another program
            self._wrench[:3] = force
            master.send("body/servo_cf", self._wrench)
            if turned:
                self._turn[:3, :3] = self.camera.orientation(first)
                master.send("lock_orientation", pose_from_matrix(self._turn, self._pose)[3:])
        if turned:
            self._turned[...] = self._goal

    # the clutch

    def set_clutch(self, pressed: bool) -> None:
        """See Teleop; while DISABLED, the clutch belongs to the PSM teleoperations of the same masters."""
        if self.is_idle:
            self.clutched = pressed
        else:
            super().set_clutch(pressed)

    def press(self) -> None:
        self._free_masters()

    def rescale(self, scale: float) -> None:
        self.camera.scale = scale
        left, right = self.masters
        if self.following:  # from here on: the change itself moves nothing
            self.camera.begin(left.measured[:3], right.measured[:3], self.camera.goal.copy())
            for turn, master in zip(self._first_turns, self.masters, strict=True):
                turn[...] = matrix_from_pose(master.measured)[:3, :3]
            self._turned[...] = self.camera.goal

    # the record

    def show(self) -> None:
        for place, master in enumerate(self.masters):
            self._stamps[0][place] = master.stamp_ns
        self._stamps[1][...] = self.slave.stamp_ns
