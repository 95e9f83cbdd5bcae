"""An arm's own records, filled each cycle: its state, and the set-points for io."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procs.arm.cartesian import Cartesian
from procs.arm.joints import Joints
from procs.arm.motion import Mode, Motion
from procs.arm.readings import ROWS, Fields, Readings
from procs.arm.stack import stacked
from procs.arm.states import PUBLISHED, State
from procs.arm.supervision import Generations
from procs.lib.coupling import Coupling

Array = NDArray[np.float64]

JAW = 6
JAW_ROWS = ("jaw_position", "jaw_velocity", "jaw_effort", "jaw_setpoint_position", "jaw_setpoint_effort")


class ArmRecord:
    """Fills the `state` record; arrays are resolved once."""

    def __init__(self, field: Fields, io: Readings, cartesian: Cartesian, *, simulated: bool) -> None:
        """`field` gives the arrays of the arm's record, `io` what they are filled from."""
        self._io, self._cartesian = io, cartesian
        self._valid, self._count, self._names = field("valid"), field("count"), field("names")
        self._joint_rows = stacked([field(name) for name in ROWS])
        self._has_jaw = field("has_jaw")
        self._jaw_rows = stacked([field(name) for name in JAW_ROWS])
        self._jacobian, self._tool, self._frame = field("jacobian"), field("tool"), field("reference_frame")
        self._state, self._sub_state, self._desired = field("state"), field("sub_state"), field("desired_state")
        self._is_homed, self._is_busy = field("is_homed"), field("is_busy")
        self._mode, self._generation = field("control_mode"), field("bias_generation")
        self._ratios = (field("trajectory_ratio"), field("trajectory_ratio_v"), field("trajectory_ratio_a"))
        self._shown: tuple[State, State, bool, bool, int, Mode] | None = None
        self._was_valid = True
        field("simulated")[...] = simulated
        self._copies: list[tuple[Array, Array]] = []
        self._kinematic: tuple[Array, Array, Array] = (io.position, io.velocity, io.setpoint)

    def show_joints(self, joints: Joints) -> None:
        """Names and sizes, after a change of instrument."""
        self._count[...] = joints.count
        self._names[...] = b""
        self._names[: joints.count] = [name.encode() for name in joints.names]
        self._tool[...] = joints.tool.encode()
        self._jacobian[...] = 0.0
        self._joint_rows[...] = 0.0
        self._has_jaw[...] = False
        self._jaw_rows[...] = 0.0
        self._cartesian.clear()
        self._bind(joints.count)

    def _bind(self, n: int) -> None:
        rows = self._io.rows
        self._copies = [(self._joint_rows[:, :n], rows[:, :n])]
        if n == JAW:  # the jaw has no set-point velocity
            self._copies += [(self._jaw_rows[:4], rows[:4, JAW]), (self._jaw_rows[4:], rows[5:, JAW])]
        self._kinematic = (self._io.position[:n], self._io.velocity[:n], self._io.setpoint[:n])

    def show_frame(self, name: str) -> None:
        """The reference frame's name."""
        self._frame[...] = name.encode()

    def show_ratios(self, motion: Motion) -> None:
        """Ratios of moves."""
        for cell, value in zip(self._ratios, (motion.ratio, motion.ratio_v, motion.ratio_a), strict=True):
            cell[...] = value

    def show_state(
        self, state: State, desired: State, is_homed: bool, is_busy: bool, generation: int, mode: Mode
    ) -> None:
        """The operating state as of this cycle."""
        shown = (state, desired, is_homed, is_busy, generation, mode)
        if shown == self._shown:
            return
        self._shown = shown
        self._state[...] = PUBLISHED[state].encode()
        self._sub_state[...] = state.encode()
        self._desired[...] = desired.encode()
        self._is_homed[...] = is_homed
        self._is_busy[...] = is_busy
        self._generation[...] = generation
        self._mode[...] = mode

    def show_motion(self, joints: Joints) -> None:
        """Joint and Cartesian values; zero and invalid unless powered, biased and fresh."""
        if not self._io.valid:
            if self._was_valid:
                self._blank()
            return
        self._was_valid = True
        self._valid[...] = True
        for out, source in self._copies:
            out[...] = source
        if joints.kinematics is not None:
            self._has_jaw[...] = True
            self._cartesian.update(joints.kinematics, *self._kinematic)

    def _blank(self) -> None:
        self._was_valid = False
        self._valid[...] = False
        self._has_jaw[...] = False
        self._joint_rows[...] = 0.0
        self._jaw_rows[...] = 0.0
        self._cartesian.clear()


class SetpointRecord:
    """Fills the `setpoint` record that io follows, in actuator space."""

    def __init__(self, field: Fields) -> None:
        """`field` gives the arrays of the arm's set-point record."""
        self._mode, self._has_velocity, self._count = field("mode"), field("has_velocity"), field("count")
        self._in_effort = field("in_effort")
        self._bias_generation, self._pid_generation = field("bias_generation"), field("pid_generation")
        self._rows = stacked([field("position")[: JAW + 1], field("velocity")[: JAW + 1]])
        self._effort = field("effort")[: JAW + 1]
        self._done = b""
        self._coupling: Coupling | None = None
        self._mode[...] = 0
        self._count[...] = JAW + 1
        for name in ("position", "velocity", "effort", "feed_forward"):
            field(name)[...] = 0.0

    def show(self, motion: Motion, joints: Joints, driving: Generations | None) -> None:
        """What io is asked for and which bias and enable that is meant for; None: alive, asking for nothing."""
        if driving is None:
            self._mode[...] = 0
            return
        self._bias_generation[...] = driving.bias
        self._pid_generation[...] = driving.pid
        coupling = joints.coupling
        self._mode[...] = 1
        self._in_effort[...] = motion.mode is Mode.EFFORT
        if motion.mode is Mode.EFFORT:
            coupling.actuator_effort(motion.effort, self._effort)
            return
        self._has_velocity[...] = motion.has_velocity
        wanted = motion.rows.tobytes()
        if wanted != self._done or coupling is not self._coupling:  # an arm that holds needs this once
            self._done, self._coupling = wanted, coupling
            np.matmul(motion.rows, coupling.joint_to_actuator.T, out=self._rows)  # row vectors: xᵀ · Aᵀ
