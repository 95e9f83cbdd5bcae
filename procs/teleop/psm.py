"""PSM teleoperation: one master and one PSM."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from trocar.procs.document.consoles import TeleopPsmConfig as Settings
from trocar.procs.kinematics.poses import Array, angle_between
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.procs.node.requests import CommandRefused, Handler, switch
from trocar.procs.tables import codes
from trocar.procs.tables.operator_waits import ALIGN_ONLY, CLUTCHED
from trocar.procs.teleop.arms import WRENCH_LASTS_S, BaseFrame, TeleopArm
from trocar.procs.teleop.teleop import StateRow, Teleop, TeleopContext
from trocar.procs.teleop.teleoperation import JawMapping, PoseMapping, Presence, Start, roll_between, waiting_for
from trocar.procs.teleop.wall_force import WallForce
from trocar.shm.mailbox.received import Request
from trocar.shm.operator_topics import TeleopState

AGAIN_NS: Final = 500_000_000  # until a failed alignment of a master is repeated
SAME_JAW: Final = 1e-6  # rad: already reached

JawRange = Callable[[str], tuple[float, float] | None]
"""Lower and upper limit of an instrument's jaw, None: not known."""


class TeleopPsm(Teleop):
    """States and motion of one master and one PSM; see Teleop."""

    words: Mapping[str, TeleopState] = {**Teleop.words, "align_MTM": TeleopState.ALIGNING}

    def __init__(self, settings: Settings, master: TeleopArm, slave: TeleopArm, context: TeleopContext,
                 jaw_range: JawRange, base: BaseFrame | None = None) -> None:
        super().__init__(settings.name, (master, slave), context)
        self.settings, self.master, self.base, record = settings, master, base, context.record
        self.mapping = PoseMapping(record.scale(settings.scale), rotation_locked=settings.rotation_locked,
                                   translation_locked=settings.translation_locked)
        self.align = settings.align_mtm
        self.presence = Presence(settings.start_gripper_threshold, settings.start_roll_threshold)
        self.jaw = JawMapping(settings.gripper_zero, settings.gripper_max, settings.jaw_rate,
                              settings.jaw_rate_after_clutch)
        self._jaw_range = jaw_range
        self._was_active = False  # before the clutch
        self._tool = ""
        self._aligned_to = np.zeros(7)
        self._aligned_ns = 0
        self._wrench: Array | None = None
        self._wrench_values = np.full(7, WRENCH_LASTS_S)
        self._wall = WallForce(settings.wall_force if settings.mtm_is_haptic else 0.0)
        self._pushes = False  # its last wrench was a force
        self._values = np.zeros(13)
        field = record.field
        self._goal_shown, self._jaw_shown, self._sent = field("goal_cp"), field("jaw_goal"), field("sent_ns")
        self._error_shown, self._offset_shown = field("angle_error"), field("alignment_offset")
        self._ghost, self._active = field("gripper_ghost"), field("operator_active")
        self._ranges = field("gripper_range"), field("roll_range")
        self._stamps = field("master_stamp_ns"), field("slave_stamp_ns")
        self._poses = field("mtm_measured_cp"), field("psm_setpoint_cp")
        self._twist = field("mtm_measured_cv")
        record.show_scale(self.mapping.scale)
        self._show_options()

    def commands(self) -> Mapping[str, Handler]:
        return {
            "lock_rotation": self._lock_rotation,
            "lock_translation": self._lock_translation,
            "set_align_MTM": self._set_align,
            "following/mtm/body/servo_cf": self._take_wrench,
        }

    # states

    def look(self) -> None:
        if self.base is not None:
            self.base.look(self.now_ns)

    def states(self) -> Mapping[TeleopState, StateRow]:
        return {TeleopState.DISABLED: StateRow(self.release, self.begin),
                TeleopState.ALIGNING: StateRow(self._begin_alignment, self._run_alignment),
                TeleopState.ENABLED: StateRow(self._begin_following, self._run_following)}

    def set_up(self) -> None:
        self.go(TeleopState.ALIGNING)

    def knows_poses(self) -> bool:
        who = next((arm for arm in self.arms if not arm.has_pose), None) or self.base
        if who is None or (who is self.base and self.base.pose is not None):
            return True
        reason = who.doubt or f"the pose of {who.name} in its reference frame is not known"
        if self.state is TeleopState.ENABLED:
            self.stop(codes.POSE_UNKNOWN, reason, who.name)
        else:
            self.wait(f"waiting: {reason}")
        return False

    @property
    def is_steady(self) -> bool:
        """Whether it follows, and nothing but following happened in this cycle."""
        arms_are_fine = all(arm.whole and arm.has_pose and not (arm.is_silent or arm.refusal) for arm in self.arms)
        return (self.following and self.state is self.desired is TeleopState.ENABLED and arms_are_fine
                and not (self.clutched or self.reason or self.slave.limit or self.slave.refuses_goals
                         or self.was_refused or self.operator.absence or self.operator.is_silent)
                and self._wrench is None and not self._pushes and (self.base is None or self.base.pose is not None))

    def lose(self) -> None:
        self.forget_presence()
        if self.state is TeleopState.ENABLED:
            self.events.report(codes.OPERATOR_ABSENT, f"{self.name}: {self.operator.absence}; following has stopped",
                               self.name)
            self.go(TeleopState.ALIGNING)

    def forget_presence(self) -> None:
        self.presence.forget()
        self._was_active = False

    def keep_presence(self) -> None:
        self._was_active = self.presence.is_active

    # ALIGNING_MTM

    def _begin_alignment(self) -> None:
        self.settle()
        self.events.emit("scale", value=self.mapping.scale)
        self.presence.is_active, self._was_active = self._was_active, False
        self.presence.reset()
        self._aligned_to[...] = self.slave.setpoint
        if not self.settings.mtm_is_haptic:
            return
        if self.align and self.slave.has_pose:
            self._send_alignment()
        else:
            self.master.leave()

    def _send_alignment(self) -> None:
        """Turn the master, in place, to the slave's orientation."""
        pose = self.master.setpoint.copy()
        pose[3:] = self.slave.setpoint[3:]
        self._aligned_to[...], self._aligned_ns = self.slave.setpoint, self.now_ns
        self.master.move(pose)

    def _run_alignment(self) -> None:
        master, slave, settings = self.master, self.slave, self.settings
        if not (settings.ignore_jaw or slave.has_jaw):
            self.stop(codes.NO_JAW, f"{slave.name} has no jaw", slave.name)
            return
        if self.desired is TeleopState.DISABLED:
            return
        if self.align and settings.mtm_is_haptic and not self.clutched:
            self._keep_aligned()
        error = angle_between(master.measured, slave.setpoint)
        self._error_shown[...] = error
        if self.clutched:
            self.reason = f"waiting: {CLUTCHED}"
            return
        if self.desired is TeleopState.ALIGNING:
            self.reason = f"waiting: {ALIGN_ONLY}"
            return
        if self.operator.absence:
            self.wait(f"waiting: {self.operator.absence}")
            return
        self._look_for_hand()
        start = Start(error if self.align else 0.0, settings.start_orientation_tolerance, self.presence.is_active,
                      master.is_busy)
        reason = waiting_for(master.name, start)
        if not reason:
            self.go(TeleopState.ENABLED)
        else:
            self.wait(f"{reason} ({master.refusal})" if master.refusal else reason)

    def _look_for_hand(self) -> None:
        master = self.master
        if master.is_busy or self.slave.is_busy:  # the roll that alignment causes is not the operator's
            self.presence.forget_roll()
            self.presence.look(master.gripper, math.nan)
        else:
            self.presence.look(master.gripper, roll_between(master.measured, self._aligned_to))

    def _keep_aligned(self) -> None:
        """Align again when the slave has turned, or the master did not arrive."""
        master = self.master
        turned = angle_between(self._aligned_to, self.slave.setpoint) > self.settings.start_orientation_tolerance
        failed = not (master.is_moving or master.has_arrived) and self.now_ns - self._aligned_ns > AGAIN_NS
        if turned or failed:
            self._send_alignment()

    # ENABLED

    def _begin_following(self) -> None:
        self.reason, self.was_refused, self._tool = "", False, self.slave.tool
        self.jaw.use(*(self._jaw_range(self._tool) or (0.0, self.settings.gripper_max)))
        self.begin_here()
        self._free_master(self.mapping.rotation_locked)
        self._wrench, self._pushes = None, False
        self.follow(True)

    def begin_here(self) -> None:
        self.mapping.begin(self.master.measured, self.slave.setpoint, self._base_pose)
        self.jaw.begin(self.slave.jaw)
        self._wall.forget()

    @property
    def _base_pose(self) -> Array | None:
        return None if self.base is None else self.base.pose

    def _free_master(self, locked: bool) -> None:
        """Free the master's position; its orientation, too, unless `locked`."""
        if self.settings.mtm_is_haptic:
            self.master.let_go()
            if self.master.is_ready:
                self.master.send("lock_orientation" if locked else "unlock_orientation")

    def _run_following(self) -> None:
        master, slave, settings = self.master, self.slave, self.settings
        if self.desired is not TeleopState.ENABLED:
            self.go(self.desired)
        elif not self.clutched and self._may_follow() and self.takes_goals():
            self._send_goal()
            if not settings.ignore_jaw:
                self._send_jaw()
            if self._wrench is not None and settings.mtm_is_haptic:
                self._pass_wrench(self._wrench)
            elif self._wall.most:
                self._push_back()
            self._error_shown[...] = angle_between(master.measured, slave.setpoint)
            self.reason = slave.refusal or slave.limit or master.refusal

    def _may_follow(self) -> bool:
        """Whether instrument and master are as they were when following began."""
        master, slave = self.master, self.slave
        if not (self.settings.ignore_jaw or slave.has_jaw):
            self.stop(codes.NO_JAW, f"{slave.name} no longer has a jaw", slave.name)
        elif slave.tool != self._tool:
            self.stop(codes.TOOL_CHANGED, f"the instrument of {slave.name} was changed", slave.name)
        elif self.settings.mtm_is_haptic and master.is_taken:
            self.interrupt(codes.ARM_TAKEN, f"{master.name} is moved or held by another program", master.name)
        else:
            return True
        return False

    def _send_goal(self) -> None:
        values, settings = self._values, self.settings
        values[:7] = self.mapping.step(self.master.measured, self._base_pose)
        linear, angular = settings.use_mtm_linear_velocity, settings.use_mtm_angular_velocity
        if linear or angular:
            values[7:] = self.mapping.velocity(self.master.twist, linear=linear, angular=angular)
        if self.slave.pursue("servo_cp", values if linear or angular else values[:7]):
            self._goal_shown[...], self._sent[...] = values[:7], self.now_ns

    def _send_jaw(self) -> None:
        jaw = self.jaw.step(self.master.gripper, self.passed_s)
        self._jaw_shown[...], self._ghost[...] = jaw, self.jaw.ghost
        if abs(jaw - self.slave.jaw) > SAME_JAW:
            self.slave.send("jaw/servo_jp", (jaw,))

    def _push_back(self) -> None:
        """At a wall, push the hand back to where the slave is; away from it, end the force at once."""
        wall, mapping = self._wall, self.mapping
        if self.slave.is_at_wall and not mapping.translation_locked:
            wall.push(mapping.ahead(self.slave.setpoint, self._base_pose), self.now_ns)
        else:
            wall.forget()
        was_pushing, self._pushes = self._pushes, wall.is_on
        if was_pushing or self._pushes:
            self.master.send("body/servo_cf", wall.wrench)

    def _pass_wrench(self, wrench: Array) -> None:
        """Pass a wrench to the master, as long as its sender repeats it; one of zeros once."""
        self._wall.forget()
        if not wrench.any():
            self._wrench = None
        elif self.now_ns >= self._wrench_end_ns:
            self._wrench = None
            self.master.let_go()
            text = f"no new wrench for {self.settings.wrench_timeout_s:g} s; the wrench has ended"
            self.events.report(codes.EFFORT_TIMEOUT, f"{self.name}: {text}", self.name)
            return
        self._wrench_values[:6] = wrench
        self.master.send("body/servo_cf", self._wrench_values)

    # the clutch

    def press(self) -> None:
        self.keep_presence()
        self._free_master(self.align or self.mapping.rotation_locked)

    def release(self) -> None:
        if self.settings.mtm_is_haptic:
            self.master.leave()

    def set_clutch(self, pressed: bool) -> None:
        """See Teleop; a click while not clutched also restarts, and does not end presence."""
        if not pressed and not self.clutched:
            self.keep_presence()
        if not (pressed and self.clutched):  # else restore the presence from before
            super().set_clutch(pressed)

    # commands

    def _rebase(self) -> None:
        if self.following:
            self.mapping.rebase(self.master.measured, self._base_pose)
            self._wall.forget()
        self._show_options()

    def rescale(self, scale: float) -> None:
        self.mapping.scale = scale
        self._rebase()

    def _lock_rotation(self, request: Request) -> None:
        self.mapping.rotation_locked = locked = switch(request)
        self._rebase()
        self.events.emit("rotation_locked", value=float(locked))
        if locked and self.following and self.settings.mtm_is_haptic:
            self.master.send("lock_orientation")
        elif not locked and self.state is not TeleopState.DISABLED:
            self.go(TeleopState.DISABLED)  # the desired state stays, so alignment is repeated

    def _lock_translation(self, request: Request) -> None:
        self.mapping.translation_locked = locked = switch(request)
        self._rebase()
        self.events.emit("translation_locked", value=float(locked))

    def _set_align(self, request: Request) -> None:
        on = switch(request)
        if on and not self.settings.mtm_is_haptic:
            raise CommandRefused(f"{self.master.name} is not haptic, it cannot be turned")
        self.align = on
        self._show_options()
        self.events.emit("align_MTM", value=float(on))
        if self.state is TeleopState.ENABLED:
            self.go(TeleopState.DISABLED)

    def _take_wrench(self, request: Request) -> None:
        if not self.following:
            raise CommandRefused("not following")
        self._wrench = np.array(request.values)
        self._wrench_end_ns = self.now_ns + (round(self.settings.wrench_timeout_s * 1e9) or FOR_EVER_NS)

    # the record

    def _show_options(self) -> None:
        field, mapping = self.record.field, self.mapping
        field("rotation_locked")[...], field("translation_locked")[...] = (
            mapping.rotation_locked, mapping.translation_locked)
        field("align_mtm")[...], field("mtm_is_haptic")[...] = self.align, self.settings.mtm_is_haptic

    def show(self) -> None:
        master, slave, presence = self.master, self.slave, self.presence
        self._active[...] = presence.is_active
        self._ranges[0][...], self._ranges[1][...] = presence.gripper_range, presence.roll_range
        self._stamps[0][0], self._stamps[1][...] = master.stamp_ns, slave.stamp_ns
        if master.whole and slave.whole:
            self._poses[0][...], self._poses[1][...] = master.measured, slave.setpoint
            self._twist[...] = master.twist
        if self.following:
            self._offset_shown[...] = self.mapping.offset
        if math.isnan(self._error_shown.item()):
            self._error_shown[...] = 0.0
