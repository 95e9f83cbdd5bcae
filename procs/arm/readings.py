"""What the arm reads of io's record: its own robot's axes and flags, and the same numbers in joint space."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procs.arm.joints import AXES, Joints

Array = NDArray[np.float64]
Fields = Callable[[str], NDArray[Any]]

SILENT_NS = 30_000_000  # io writes 1500 records a second; none for this long means that it is gone


class Readings:
    """Views on one robot in io's record, resolved once; `update` converts to joint space into (7,) arrays."""

    def __init__(self, field: Fields, robot: int, first_axis: int) -> None:
        """`field` gives the record's arrays, `robot` is the place among io's robots, `first_axis` its first axis."""
        axes = slice(first_axis, first_axis + AXES)

        def axis(name: str) -> NDArray[Any]:
            return field(name)[axes]

        def flag(name: str) -> NDArray[Any]:
            return field(name)[robot : robot + 1].reshape(())

        self.stamp_ns = 0
        self.epoch = 0
        self.fresh = False
        self.age_ns = field("age_ns")
        self.actuator_position, self.actuator_velocity = axis("position"), axis("velocity")
        self.actuator_effort = axis("effort")
        self.actuator_setpoint, self.actuator_setpoint_velocity = axis("setpoint_position"), axis("setpoint_velocity")
        self.actuator_setpoint_effort = axis("setpoint_effort")
        self.at_limit = axis("at_limit")
        self.power_wanted, self.powered, self.amps_on = flag("power_wanted"), flag("powered"), flag("amps_on")
        self.biased, self.biasing, self.bias_generation = flag("biased"), flag("biasing"), flag("bias_generation")
        self.pid_enabled, self.pid_generation = flag("pid_enabled"), flag("pid_generation")
        self.limits_enforced, self.tracking_check = flag("limits_enforced"), flag("tracking_check")
        self.velocity_used, self.pot_check = flag("velocity_used"), flag("pot_check")
        self.fault = flag("fault")
        self.position, self.velocity, self.effort = np.zeros(AXES), np.zeros(AXES), np.zeros(AXES)
        self.setpoint, self.setpoint_velocity = np.zeros(AXES), np.zeros(AXES)
        self.setpoint_effort = np.zeros(AXES)

    def update(self, now_ns: int, stamp_ns: int, epoch: int, joints: Joints) -> None:
        """A new cycle: the record was stamped `stamp_ns` (0: there is none yet) by io's life number `epoch`."""
        self.stamp_ns, self.epoch = stamp_ns, epoch
        self.fresh = stamp_ns > 0 and now_ns - stamp_ns <= SILENT_NS
        coupling = joints.coupling
        if coupling.is_identity:
            self.position[...] = self.actuator_position
            self.velocity[...] = self.actuator_velocity
            self.effort[...] = self.actuator_effort
            self.setpoint[...] = self.actuator_setpoint
            self.setpoint_velocity[...] = self.actuator_setpoint_velocity
            self.setpoint_effort[...] = self.actuator_setpoint_effort
            return
        coupling.joint_position(self.actuator_position, self.position)
        coupling.joint_position(self.actuator_velocity, self.velocity)
        coupling.joint_effort(self.actuator_effort, self.effort)
        coupling.joint_position(self.actuator_setpoint, self.setpoint)
        coupling.joint_position(self.actuator_setpoint_velocity, self.setpoint_velocity)
        coupling.joint_effort(self.actuator_setpoint_effort, self.setpoint_effort)

    @property
    def has_power(self) -> bool:
        """Supply, relay and watchdog are good and every amplifier is on."""
        return bool(self.powered.item() and self.amps_on.item())

    @property
    def valid(self) -> bool:
        """Joint values mean something: fresh, powered, biased."""
        return bool(
            self.fresh and self.powered.item() and self.biased.item() and 0 <= self.age_ns.item() <= SILENT_NS
        )
