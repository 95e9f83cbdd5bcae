"""The arm's view of io's record: its own robot's axes and flags, and the same numbers in joint space."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.joints import JointSpace
from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import CHANGED, FAULTY, FRESH, POWER, READINGS, VALID
from trocar.procs.native.library import chosen
from trocar.procs.node.inputs import LATE_NS, Fields
from trocar.procs.node.io_faults import HARMLESS

ROWS = ("position", "velocity", "effort", "setpoint_position", "setpoint_velocity", "setpoint_effort")


class ArmReadings:
    """Views of one robot in io's record, resolved once; `update` converts to joint space, see `JointSpace`.

    `fresh`: io's record is recent; `has_power`: supply, relay and watchdog are good and every amplifier is on; `valid`:
    joint values are meaningful (fresh, powered, biased). `problem`: number of a latched fault that ends driving, 0:
    none; a timeout of this very process no longer counts once it runs again. `rows` (6, size): all joint values in the
    order of ROWS. `is_faulty`: io's record has a fault.
    """

    LATE_NS = LATE_NS

    def __init__(self, field: Fields, robot: int, first_axis: int, joints: JointSpace) -> None:
        """`field` gives the record's arrays, `robot` is the index of the robot in io, `first_axis` its first axis."""
        axes = slice(first_axis, first_axis + joints.axes)

        def axis(name: str) -> NDArray[Any]:
            return field(name)[axes]

        def flag(name: str) -> NDArray[Any]:
            return field(name)[robot : robot + 1]

        self.stamp_ns = 0
        self.epoch = 0
        self.fresh = False
        self.changed = True
        """Joint values have changed since the previous cycle."""
        self._found = -1
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
        given = [axis(name) for name in ROWS]
        (self.given_position, self.given_velocity, self.given_effort,
         self.given_setpoint, self.given_setpoint_velocity, self.given_setpoint_effort) = given
        self._actuator, self.axes = contiguous_view(given), joints.axes
        self.read = np.zeros((6, joints.axes))
        self.has_power = self.valid = self.is_faulty = False
        self.problem = 0
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Use another joint space: other arrays from now on, filled with the last values."""
        self.rows = np.zeros((6, joints.size))
        self.position, self.velocity, self.effort = self.rows[:3]
        self.setpoint, self.setpoint_velocity, self.setpoint_effort = self.rows[3:]
        self._efforts, self._joint_efforts = self.read[2::3], self.rows[2::3]
        self.size = joints.size
        self.to_joint, self.to_actuator = map(np.ascontiguousarray, (joints.to_joint, joints.to_actuator))
        (self._update,) = chosen(READINGS, self, "by_numpy_")
        self._convert()

    def update(self, now_ns: int, stamp_ns: int, epoch: int) -> None:
        """A new cycle: io's record has the stamp `stamp_ns` (0: none yet) and io's start count `epoch`."""
        self.stamp_ns, self.epoch = stamp_ns, epoch
        found = self._update(now_ns, stamp_ns)
        self.changed = found & CHANGED != 0
        if found == self._found and not found & FAULTY:
            return
        self._found = found
        self.fresh, self.has_power, self.valid = found & FRESH != 0, found & POWER != 0, found & VALID != 0
        self.is_faulty = found & FAULTY != 0
        fault = int(self.fault.item()) if self.is_faulty else 0
        self.problem = 0 if fault in HARMLESS else fault

    def _convert(self) -> None:
        self.read[...] = self._actuator
        np.matmul(self.read, self.to_joint.T, out=self.rows)  # row vectors: (A · x)ᵀ = xᵀ · Aᵀ
        # joint efforts are the actuators' by the transpose of joint → actuator
        np.matmul(self._efforts, self.to_actuator, out=self._joint_efforts)

    # the reference of the native library

    def by_numpy_update(self, now_ns: int, stamp_ns: int) -> int:
        """Convert joint values that have changed; returns what is the case."""
        is_fresh, powered = stamp_ns > 0 and abs(now_ns - stamp_ns) <= LATE_NS, bool(self.powered.item())
        is_valid = is_fresh and powered and self.biased.item() and 0 <= self.age_ns.item() <= LATE_NS
        is_changed = self._actuator.tobytes() != self.read.tobytes()
        if is_changed:
            self._convert()
        return ((FRESH if is_fresh else 0) | (POWER if powered and self.amps_on.item() else 0)
                | (VALID if is_valid else 0) | (CHANGED if is_changed else 0) | (FAULTY if self.fault.item() else 0))


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
