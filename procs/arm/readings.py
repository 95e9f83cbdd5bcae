"""The arm's view of io's record: its own robot's axes and flags, and the same numbers in joint space."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.joints import JointSpace
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.inputs import LATE_NS, Fields
from trocar.procs.tables.codes import ARM_LOST, ERROR, FAULTS

ROWS = ("position", "velocity", "effort", "setpoint_position", "setpoint_velocity", "setpoint_effort")
HARMLESS = frozenset((0, ARM_LOST.number, *(fault.number for fault in FAULTS if fault.severity < ERROR)))


class ArmReadings:
    """Views of one robot in io's record, resolved once; `update` converts to joint space, see `JointSpace`.

    `fresh`: io's record is recent; `has_power`: supply, relay and watchdog are good and every amplifier is on; `valid`:
    joint values are meaningful (fresh, powered, biased). `problem`: number of a latched fault that ends driving, 0:
    none; a timeout of this very process no longer counts once it runs again. `rows` (6, size): all joint values in the
    order of ROWS.
    """

    def __init__(self, field: Fields, robot: int, first_axis: int, joints: JointSpace) -> None:
        """`field` gives the record's arrays, `robot` is the index of the robot in io, `first_axis` its first axis."""
        axes = slice(first_axis, first_axis + joints.axes)

        def axis(name: str) -> NDArray[Any]:
            return field(name)[axes]

        def flag(name: str) -> NDArray[Any]:
            return field(name)[robot : robot + 1].reshape(())

        self.stamp_ns = 0
        self.epoch = 0
        self.fresh = False
        self.changed = True
        """Joint values have changed since the previous cycle."""
        self._raw = b""
        self.input = field("input")
        self.age_ns = flag("sample_age_ns")
        self.at_limit, self.in_effort, self.encoder_set = axis("at_limit"), axis("effort_mode"), axis("encoder_set")
        self.power_requested, self.powered, self.amps_on = flag("power_requested"), flag("powered"), flag("amps_on")
        self.biased, self.biasing, self.bias_generation = flag("biased"), flag("biasing"), flag("bias_generation")
        self.pid_enabled, self.pid_generation = flag("pid_enabled"), flag("pid_generation")
        self.limits_enforced, self.tracking_check = flag("limits_enforced"), flag("tracking_check")
        self.use_setpoint_velocity, self.pot_check = flag("use_setpoint_velocity"), flag("pot_check")
        self.brakes_released = flag("brakes_released")
        self.fault, self.holding = flag("fault"), flag("holding")
        self.desired_generation, self.desired_void, self.desired_refused = (
            flag("desired_generation"), flag("desired_void"), flag("desired_refused"))
        # (6, axes): position, velocity, effort, measured and then as setpoint
        self._actuator = contiguous_view([axis(name) for name in ROWS])
        self._read = np.zeros((6, joints.axes))
        self.has_power = self.valid = False
        self.problem = 0
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Use another joint space: other arrays from now on, filled with the last values."""
        self.rows = np.zeros((6, joints.size))
        self.position, self.velocity, self.effort = self.rows[:3]
        self.setpoint, self.setpoint_velocity, self.setpoint_effort = self.rows[3:]
        self._efforts, self._joint_efforts = self._read[2::3], self.rows[2::3]
        # row vectors: (A · x)ᵀ = xᵀ · Aᵀ; joint efforts are the actuators' by the transpose of joint → actuator
        self._motion_map, self._effort_map = joints.to_joint.T, joints.to_actuator
        self._raw = b""
        self._convert()

    def update(self, now_ns: int, stamp_ns: int, epoch: int) -> None:
        """A new cycle: io's record has the stamp `stamp_ns` (0: none yet) and io's start count `epoch`."""
        self.stamp_ns, self.epoch = stamp_ns, epoch
        self.fresh = stamp_ns > 0 and abs(now_ns - stamp_ns) <= LATE_NS
        powered = self.powered.item()
        self.has_power = bool(powered and self.amps_on.item())
        fault = int(self.fault.item())
        self.problem = 0 if fault in HARMLESS else fault
        self.valid = bool(
            self.fresh and powered and self.biased.item() and 0 <= self.age_ns.item() <= LATE_NS
        )
        self._convert()

    def _convert(self) -> None:
        self._read[...] = self._actuator
        raw = self._read.tobytes()
        self.changed = raw != self._raw
        if not self.changed:  # a kinematic robot at rest
            return
        self._raw = raw
        self._read.dot(self._motion_map, self.rows)  # takes half as long as matmul
        np.matmul(self._efforts, self._effort_map, out=self._joint_efforts)


def contiguous_view(rows: Sequence[NDArray[Any]]) -> Array:
    """A view (len(rows), …) of equal float64 arrays at even distances in one buffer: copied in one call.

    ValueError otherwise: the order of fields in the topic table has changed.
    """
    addresses = [int(row.__array_interface__["data"][0]) for row in rows]
    step = addresses[1] - addresses[0]
    first = rows[0]
    even = all(b - a == step for a, b in itertools.pairwise(addresses))
    alike = all(r.dtype == np.float64 and r.shape == first.shape and r.strides == first.strides for r in rows)
    if not (even and alike and step >= first.nbytes):
        raise ValueError("these fields do not lie evenly in their record; put them side by side in shm/topics.py")
    view: Array = np.lib.stride_tricks.as_strided(first, (len(rows), *first.shape), (step, *first.strides))
    return view
