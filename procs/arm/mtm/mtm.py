"""An MTM: a master, moved by hand or held."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.control import Control
from trocar.procs.arm.efforts import Law
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.mtm.gripper import GripperLogic
from trocar.procs.arm.mtm.orientation_lock import OrientationLock
from trocar.procs.arm.stages.roll import ROLL, FindingRoll, SettingRoll
from trocar.procs.arm.states import ArmEvent, ArmState
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.poses import Array
from trocar.procs.tables import codes

OFF_STOP: Final = math.radians(10.0)  # where homing does not go to zero, the roll is moved off its stop
BORNE_NS: Final = 1_000_000_000
AT_TIP: Final = (Law.BODY, Law.IMPEDANCE)
PLATFORM, PITCH, YAW = 3, 4, 5
STIFFNESS: Final = 1.0  # N·m/rad
DAMPING: Final = 0.1  # N·m·s/rad
MAX_WAY: Final = 0.05 * math.pi  # rad: a larger error does not increase the pull
MAX_EFFORT: Final = 0.4  # N·m


class Platform:
    """A master's platform follows the wrist in effort mode, which keeps the wrist yaw away from its limits.

    With wrenches at the tip the seven joints have one freedom more than the tip, and no command controls it. A spring
    is stretched by the angle of the yaw about the platform's axis.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self._gain = control.arm.platform_gain
        self._low, self._high = control.joints.lower[PLATFORM], control.joints.upper[PLATFORM]

    def step(self) -> None:
        """Add its effort to those of this cycle."""
        io = self._control.io
        position = io.position[PLATFORM]
        way = min(max(io.position[YAW] * math.cos(io.position[PITCH]), -MAX_WAY), MAX_WAY)
        goal = min(max(position + way, self._low), self._high)
        effort = self._gain * (STIFFNESS * (goal - position) - DAMPING * io.velocity[PLATFORM])
        self._control.motion.effort[PLATFORM] += min(max(effort, -MAX_EFFORT), MAX_EFFORT)


class MtmLogic(ArmLogic):
    """See ArmLogic."""

    checks_tracking = False
    not_by_pots = (ROLL,)

    def __init__(self, arm: ArmConfig, around: ArmContext) -> None:
        super().__init__(arm, around)
        control, before = self.control, self._previous_state
        control.cartesian.complete = False  # until the state of the roll is known
        self._gripper = GripperLogic(control, around.field, around.gripper, around.state)
        self._platform = Platform(control)
        self._lock = OrientationLock(control)
        if before is not None:
            control.reports.emit("orientation_locked", value=0.0)  # a lock of an earlier process has ended
        self._borne = float(before is not None and before.bore_weight)
        self._borne_ns = 0
        self._commands.rows.update(self._lock.table)
        self._stages |= {ArmState.FINDING_ROLL: FindingRoll(self), ArmState.SETTING_ROLL: SettingRoll(self)}

    def home(self) -> Array:
        goal = super().home()
        goal[ROLL] = max(goal[ROLL], self.joints.lower[ROLL] + OFF_STOP)
        return goal

    def is_ready(self) -> bool:
        return self.control.is_kinematic or bool(self.io.encoder_set[ROLL])

    def watch(self) -> None:
        self.control.cartesian.complete = self.is_ready()
        self._gripper.step(self.control.now_ns)
        self._lock.watch()

    def bears_weight(self) -> float:
        """See ArmLogic; not while servo positions are followed. It changes slowly where the joints are held."""
        control, mode = self.control, self.control.motion.mode
        step = (control.now_ns - self._borne_ns) / BORNE_NS
        self._borne_ns = control.now_ns
        if control.driving is None:
            self._borne = 0.0
        elif mode is Mode.EFFORT:
            self._borne = 1.0
        elif mode is Mode.TRAJECTORY:
            self._borne = min(1.0, self._borne + step)
        elif mode is Mode.POSITION:
            self._borne = max(0.0, self._borne - step)
        return self._borne

    def end_efforts(self) -> None:
        """See ArmLogic: an operator may hold the arm, so it is released, except for gravity compensation."""
        control = self.control
        control.report_episode(codes.EFFORT_TIMEOUT,
                               f"no effort command for {control.arm.effort_timeout_s:g} s; released")
        control.push(Space.CARTESIAN).body(np.zeros(6), control.now_ns, absolute=False)
        control.gravity.used = control.gravity.known

    def shape_efforts(self) -> None:
        if self.control.cartesian.valid and self.control.efforts.law in AT_TIP:
            self._platform.step()
        self._lock.step()

    def before_homing(self) -> ArmEvent:
        """The roll is found once; it stays known as long as the controllers have power."""
        return ArmEvent.ONWARD if self.is_ready() else ArmEvent.ROLL
