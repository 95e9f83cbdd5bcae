"""An arm's own records, filled each cycle: its state, and the setpoints for io."""

from __future__ import annotations

import numpy as np

from trocar.procs.arm.joints import JointSpace
from trocar.procs.arm.motion import EFFORT, Mode, Motion, Space
from trocar.procs.arm.readings import ROWS, ArmReadings, contiguous_view
from trocar.procs.arm.states import PUBLISHED, ArmState
from trocar.procs.arm.supervision import Generations
from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import SETPOINT
from trocar.procs.native.library import chosen
from trocar.procs.node.inputs import Fields
from trocar.shm.memory.layout import shorten

JAW_ROWS = ("jaw_position", "jaw_velocity", "jaw_effort", "jaw_setpoint_position", "jaw_setpoint_effort")
Shown = tuple[ArmState, str, ArmState, bool, bool, int, Mode, Space]


class ArmRecord:
    """Fills the `state` record except its Cartesian part; arrays are resolved once."""

    def __init__(self, field: Fields, io: ArmReadings, *, simulated: bool) -> None:
        """`field` gives the arrays of the arm's record, `io` their values."""
        self._io = io
        self._valid, self._count, self._names = field("valid"), field("count"), field("names")
        self._joint_rows = contiguous_view([field(name) for name in ROWS])
        self._has_jaw, self._jaw_rows = field("has_jaw"), contiguous_view([field(name) for name in JAW_ROWS])
        self._tool = field("tool")
        self._state, self._sub_state, self._desired = field("state"), field("sub_state"), field("desired_state")
        self._is_homed, self._is_busy = field("is_homed"), field("is_busy")
        self._mode, self._space, self._generation = (
            field("control_mode"), field("control_space"), field("bias_generation"))
        self._ratios = (field("trajectory_ratio"), field("trajectory_ratio_v"), field("trajectory_ratio_a"))
        self._gravity = field("gravity_effort")
        self._reason, self._why = field("reason"), "?"
        self._stops, self._stopped_by = field("stops"), field("stopped_by")
        self._stops[...], self._stopped_by[...] = 0, b""
        self._shown: Shown | None = None
        self._is_blank, self._is_new, self._borne = False, True, b""
        field("simulated")[...] = simulated
        self._copies: list[tuple[Array, Array]] = []
        self._jaw = False
        self._joints = 0

    def use(self, joints: JointSpace) -> None:
        """Use another joint space; `ArmReadings` must have it already."""
        n, rows = joints.count, self._io.rows
        self._joints = n
        self._count[...] = n
        self._names[...] = b""
        self._names[:n] = [name.encode() for name in joints.names]
        self._tool[...] = joints.tool.encode()
        self._joint_rows[...] = self._gravity[...] = 0.0
        self._has_jaw[...] = False
        self._jaw_rows[...] = 0.0
        self._jaw, self._is_new, self._borne = joints.has_jaw, True, b""
        self._copies = [(self._joint_rows[:, :n], rows[:, :n])]
        if joints.has_jaw:  # the jaw has no setpoint velocity
            self._copies += [(self._jaw_rows[:4], rows[:4, n]), (self._jaw_rows[4:], rows[5:, n])]

    def show_ratios(self, motion: Motion) -> None:
        """Show the ratios of moves."""
        for cell, value in zip(self._ratios, (motion.ratio, motion.ratio_v, motion.ratio_a), strict=True):
            cell[...] = value

    def show_state(self, shown: Shown) -> None:
        """Show the operating state of this cycle: states, desired one, homed, busy, bias generation, mode, space."""
        if shown == self._shown:
            return
        self._shown = shown
        state, sub_state, desired, is_homed, is_busy, generation, mode, space = shown
        self._state[...] = PUBLISHED[state].encode()
        self._sub_state[...] = sub_state.encode()
        self._desired[...] = desired.encode()
        self._is_homed[...] = is_homed
        self._is_busy[...] = is_busy
        self._generation[...] = generation
        self._mode[...] = mode
        self._space[...] = space

    def show_reason(self, reason: str) -> None:
        """Show the cause of FAULT, or the awaited condition."""
        if reason != self._why:
            self._why = reason
            self._reason[...] = shorten(reason, self._reason.dtype.itemsize)

    def show_stop(self, who: str) -> None:
        """Show a stop by `who`."""
        self._stops += 1
        self._stopped_by[...] = shorten(who, self._stopped_by.dtype.itemsize)

    def show_motion(self, gravity: Array) -> None:
        """Show joint values; zero and invalid unless powered, biased and fresh. `gravity` (size,): efforts against it.
        """
        if not self._io.valid:
            if not self._is_blank:
                self._blank()
            return
        if self._is_blank or self._is_new:
            self._valid[...] = True
            self._has_jaw[...] = self._jaw
        if self._io.changed or self._is_blank or self._is_new:
            for out, source in self._copies:
                out[...] = source
        self._is_blank = self._is_new = False
        borne = gravity.tobytes()
        if borne != self._borne:
            self._borne = borne
            self._gravity[: self._joints] = gravity[: self._joints]

    def _blank(self) -> None:
        self._is_blank, self._borne = True, b""
        self._valid[...] = False
        self._has_jaw[...] = False
        self._joint_rows[...] = self._gravity[...] = 0.0
        self._jaw_rows[...] = 0.0


class SetpointRecord:
    """Fills the `setpoint` record that io follows, in actuator space."""

    def __init__(self, field: Fields, axes: int) -> None:
        """`field` gives the arrays of the arm's setpoint record."""
        self._mode, self._has_velocity = field("mode"), field("has_velocity")
        self._bias_generation, self._pid_generation = field("bias_generation"), field("pid_generation")
        self.axes = axes
        self.position, self.velocity, self.effort, self.feed_forward, self.in_effort = (
            field(name)[:axes] for name in ("position", "velocity", "effort", "feed_forward", "in_effort"))
        self._mode[...] = 0
        field("count")[...] = axes
        field("in_effort")[...] = False
        for name in ("position", "velocity", "effort", "feed_forward"):
            field(name)[...] = 0.0
        self._pushed = False
        self._driving: Generations | None = None
        self._carries = False
        self._has_velocity[...] = False

    def use(self, joints: JointSpace, motion: Motion, gravity: Array, measured: Array) -> None:
        """Use another joint space, and its arrays.

        `gravity` (size,): efforts added in every mode; `measured` (size,): positions of the joints in effort mode.
        """
        self.size, self.motion, self.gravity, self.measured = joints.size, motion, gravity, measured
        self.to_joint, self.to_actuator = map(np.ascontiguousarray, (joints.to_joint, joints.to_actuator))
        (self._show,) = chosen(SETPOINT, self, "by_numpy_")

    def show(self, driving: Generations | None) -> None:
        """Show the setpoints for io, with the bias and the enable they are meant for; None: alive without a command."""
        motion = self.motion
        if driving is not self._driving:
            self._drive(driving)
        if driving is None:
            return
        is_pushed = motion.mode is EFFORT
        if self._pushed and not is_pushed:
            self.effort[...] = 0.0
            self.in_effort[...] = False
        self._pushed = is_pushed
        self._show(is_pushed)
        if motion.has_velocity is not self._carries:
            self._has_velocity[...] = self._carries = motion.has_velocity

    def _drive(self, driving: Generations | None) -> None:
        self._driving = driving
        self._mode[...] = driving is not None
        if driving is not None:
            self._bias_generation[...] = driving.bias
            self._pid_generation[...] = driving.pid

    # the reference of the native library

    def by_numpy_show(self, in_effort: int) -> int:
        """Map goals, velocities and efforts to the actuators; `in_effort`: of joints in effort mode too."""
        motion = self.motion
        np.matmul(self.gravity + motion.feed, self.to_joint, out=self.feed_forward)  # rows: xᵀ · A = (Aᵀ · x)ᵀ
        if in_effort:
            np.matmul(motion.effort, self.to_joint, out=self.effort)
            np.logical_not((self.to_actuator != 0.0) @ ~motion.in_effort, out=self.in_effort)  # moves none that follows
            np.copyto(motion.goal, self.measured, where=motion.in_effort)  # one that follows may move two joints
        np.matmul(motion.goal, self.to_actuator.T, out=self.position)
        np.matmul(motion.velocity, self.to_actuator.T, out=self.velocity)
        return 0
