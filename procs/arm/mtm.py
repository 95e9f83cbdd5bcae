"""An MTM: a master, moved by hand or held."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.arm.arm import Arm
from procs.arm.gripper import Gripper
from procs.arm.stages.homing import Biased, Calibrating
from procs.arm.stages.roll import ROLL, FindingRoll, SettingRoll
from procs.arm.stages.stage import Stage
from procs.arm.states import Event, State
from procs.arm.takeover import Predecessor

Array = NDArray[np.float64]

TOLERANCE: Final = math.radians(4.0)
ROLL_TOLERANCE: Final = math.radians(6.0)
OFF_STOP: Final = math.radians(10.0)  # where homing does not go to zero, the roll is not left at its stop


class Mtm(Arm):
    """See Arm."""

    checks_tracking = False

    def prepare(self, before: Predecessor | None) -> None:
        """See Arm."""
        control, around = self.control, self._around
        control.cartesian.complete = False  # until the roll was looked at
        self._gripper = Gripper(control, around.field, around.gripper, around.state)

    def stages(self) -> Mapping[State, Stage]:
        """See Arm."""
        control = self.control
        return {
            State.CALIBRATING: Calibrating(control, (ROLL,)),
            State.BIASED: Biased(control, self._before_homing),
            State.FINDING_ROLL: FindingRoll(control),
            State.SETTING_ROLL: SettingRoll(control),
        }

    def home(self) -> Array:
        """See Arm."""
        goal = super().home()
        goal[ROLL] = max(goal[ROLL], self.joints.lower[ROLL] + OFF_STOP)
        return goal

    def tolerance(self) -> Array:
        """See Arm."""
        tolerance = np.full(self.joints.size, TOLERANCE)
        tolerance[ROLL] = ROLL_TOLERANCE
        return tolerance

    def is_ready(self) -> bool:
        """See Arm."""
        return self.control.is_played or bool(self.io.encoder_set[ROLL])

    def watch(self) -> None:
        """See Arm."""
        self.control.cartesian.complete = self.is_ready()
        self._gripper.step(self.control.now_ns)

    def _before_homing(self) -> Event:
        """The roll is found once; it stays where it is known as long as the controllers have power."""
        return Event.ONWARD if self.is_ready() else Event.ROLL
