"""An MTM: a master, moved by hand or held."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.commands import Table
from trocar.procs.arm.efforts import Law
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.mtm.gripper import GripperLogic
from trocar.procs.arm.mtm.orientation_lock import OrientationLock
from trocar.procs.arm.mtm.platform_spring import Platform
from trocar.procs.arm.recovery import PreviousState
from trocar.procs.arm.stages.homing import Biased, Calibrating
from trocar.procs.arm.stages.roll import ROLL, FindingRoll, SettingRoll
from trocar.procs.arm.stages.stage import Stage
from trocar.procs.arm.states import ArmEvent, ArmState
from trocar.procs.tables import codes

Array = NDArray[np.float64]

OFF_STOP: Final = math.radians(10.0)  # where homing does not go to zero, the roll is not left at its stop
BORNE_NS: Final = 1_000_000_000
AT_TIP: Final = (Law.BODY, Law.IMPEDANCE)


class MtmLogic(ArmLogic):
    """See ArmLogic."""

    checks_tracking = False

    def prepare(self, before: PreviousState | None) -> None:
        """See ArmLogic."""
        control, around = self.control, self._around
        control.cartesian.complete = False  # until the roll was looked at
        self._gripper = GripperLogic(control, around.field, around.gripper, around.state)
        self._platform = Platform(control)
        self._lock = OrientationLock(control)
        if before is not None:
            control.reports.emit("orientation_locked", value=0.0)  # whatever it was: it is not any more
        self._borne = float(before is not None and before.bore_weight)
        self._borne_ns = 0

    def stages(self) -> Mapping[ArmState, Stage]:
        """See ArmLogic."""
        control = self.control
        return {
            ArmState.CALIBRATING: Calibrating(control, (ROLL,)),
            ArmState.BIASED: Biased(control, self._before_homing),
            ArmState.FINDING_ROLL: FindingRoll(control),
            ArmState.SETTING_ROLL: SettingRoll(control),
        }

    def tables(self) -> Iterable[Table]:
        """See ArmLogic."""
        return (self._lock.table,)

    def home(self) -> Array:
        """See ArmLogic."""
        goal = super().home()
        goal[ROLL] = max(goal[ROLL], self.joints.lower[ROLL] + OFF_STOP)
        return goal

    def is_ready(self) -> bool:
        """See ArmLogic."""
        return self.control.is_kinematic or bool(self.io.encoder_set[ROLL])

    def watch(self) -> None:
        """See ArmLogic."""
        self.control.cartesian.complete = self.is_ready()
        self._gripper.step(self.control.now_ns)
        self._lock.watch()

    def bears_weight(self) -> float:
        """See ArmLogic; not while servo positions are followed. It comes and goes slowly where the joints are held."""
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
        """See Arm: a hand may be on it, so it is let go of, but for its weight."""
        control = self.control
        control.report_episode(codes.EFFORT_TIMEOUT,
                               f"no effort command for {control.arm.effort_timeout_s:g} s; let go")
        control.push(Space.CARTESIAN).body(np.zeros(6), control.now_ns, absolute=False)
        control.gravity.used = control.gravity.known

    def shape_efforts(self) -> None:
        """See ArmLogic."""
        if self.control.cartesian.valid and self.control.efforts.law in AT_TIP:
            self._platform.step()
        self._lock.step()

    def _before_homing(self) -> ArmEvent:
        """The roll is found once; it stays where it is known as long as the controllers have power."""
        return ArmEvent.ONWARD if self.is_ready() else ArmEvent.ROLL
