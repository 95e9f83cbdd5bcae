"""An arm's own records, filled each cycle: its state, and the set-points for io."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procs.arm.cartesian import Cartesian
from procs.arm.joints import Joints
from procs.arm.motion import Mode, Motion
from procs.arm.readings import Fields, Readings
from procs.arm.states import PUBLISHED, State

Array = NDArray[np.float64]

JAW = 6


class ArmRecord:
    """Fills the `state` record; arrays are resolved once."""

    def __init__(self, field: Fields, cartesian: Cartesian) -> None:
        """`field` gives the arrays of the arm's record."""
        self._cartesian = cartesian
        self._valid, self._count, self._names = field("valid"), field("count"), field("names")
        self._position, self._velocity, self._effort = field("position"), field("velocity"), field("effort")
        self._setpoint, self._setpoint_velocity = field("setpoint_position"), field("setpoint_velocity")
        self._setpoint_effort = field("setpoint_effort")
        self._joint_arrays = (self._position, self._velocity, self._effort, self._setpoint,
                              self._setpoint_velocity, self._setpoint_effort)
        self._has_jaw = field("has_jaw")
        self._jaw = tuple(
            field(name)
            for name in ("jaw_position", "jaw_velocity", "jaw_effort", "jaw_setpoint_position", "jaw_setpoint_effort")
        )
        self._jacobian, self._tool, self._frame = field("jacobian"), field("tool"), field("reference_frame")
        self._state, self._sub_state, self._desired = field("state"), field("sub_state"), field("desired_state")
        self._is_homed, self._is_busy = field("is_homed"), field("is_busy")
        self._mode, self._generation = field("control_mode"), field("bias_generation")
        self._ratios = (field("trajectory_ratio"), field("trajectory_ratio_v"), field("trajectory_ratio_a"))
        self._shown: tuple[State, State] | None = None
        self._was_valid = True

    def show_joints(self, joints: Joints) -> None:
        """Names and sizes, after a change of instrument."""
        self._count[...] = joints.count
        self._names[...] = b""
        self._names[: joints.count] = [name.encode() for name in joints.names]
        self._tool[...] = joints.tool.encode()
        self._jacobian[...] = 0.0
        for array in self._joint_arrays:
            array[...] = 0.0
        if not joints.has_jaw:
            self._has_jaw[...] = False
            for cell in self._jaw:
                cell[...] = 0.0

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
        if (state, desired) != self._shown:  # texts are slow to write
            self._shown = (state, desired)
            self._state[...] = PUBLISHED[state].encode()
            self._sub_state[...] = state.encode()
            self._desired[...] = desired.encode()
        self._is_homed[...] = is_homed
        self._is_busy[...] = is_busy
        self._generation[...] = generation
        self._mode[...] = mode

    def show_motion(self, io: Readings, joints: Joints) -> None:
        """Joint and Cartesian values; zero and invalid unless powered, biased and fresh."""
        if not io.valid:
            if self._was_valid:
                self._blank()
            return
        self._was_valid = True
        self._valid[...] = True
        n = joints.count
        self._position[:n] = io.position[:n]
        self._velocity[:n] = io.velocity[:n]
        self._effort[:n] = io.effort[:n]
        self._setpoint[:n] = io.setpoint[:n]
        self._setpoint_velocity[:n] = io.setpoint_velocity[:n]
        self._setpoint_effort[:n] = io.setpoint_effort[:n]
        if joints.kinematics is None:
            return
        self._has_jaw[...] = True
        values = (io.position, io.velocity, io.effort, io.setpoint, io.setpoint_effort)
        for cell, array in zip(self._jaw, values, strict=True):
            cell[...] = array[JAW]
        self._cartesian.update(joints.kinematics, io.position[:n], io.velocity[:n], io.setpoint[:n])

    def _blank(self) -> None:
        self._was_valid = False
        self._valid[...] = False
        self._has_jaw[...] = False
        for array in (*self._joint_arrays, *self._jaw):
            array[...] = 0.0
        self._cartesian.clear()


class SetpointRecord:
    """Fills the `setpoint` record that io follows, in actuator space."""

    def __init__(self, field: Fields) -> None:
        """`field` gives the arrays of the arm's set-point record."""
        self._mode, self._has_velocity, self._count = field("mode"), field("has_velocity"), field("count")
        self._bias_generation, self._pid_generation = field("bias_generation"), field("pid_generation")
        self._position, self._velocity = field("position")[: JAW + 1], field("velocity")[: JAW + 1]
        self._effort = field("effort")[: JAW + 1]
        self._mode[...] = 0
        self._count[...] = JAW + 1
        for name in ("position", "velocity", "effort", "feed_forward"):
            field(name)[...] = 0.0

    def show(self, motion: Motion, joints: Joints, io: Readings, active: bool) -> None:
        """What io is asked for; not `active`: the arm is alive and asks for nothing."""
        if not active:
            self._mode[...] = 0
            return
        self._bias_generation[...] = io.bias_generation
        self._pid_generation[...] = io.pid_generation
        coupling = joints.coupling
        if motion.mode is Mode.EFFORT:
            self._mode[...] = 2
            coupling.actuator_effort(motion.effort, self._effort)
            return
        self._mode[...] = 1
        self._has_velocity[...] = motion.has_velocity
        coupling.actuator_position(motion.goal, self._position)
        coupling.actuator_position(motion.velocity, self._velocity)
