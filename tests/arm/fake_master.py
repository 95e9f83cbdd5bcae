"""A fake io whose robot is a master: its roll has a stop, and its encoder is set by itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tests import stock
from tests.arm.fake_io import AXES, SECOND, ArmHarness, FakeIo
from trocar.procs.arm.mtm.mtm import MtmLogic
from trocar.procs.document.system import ArmConfig

ROLL = 6
STOP = math.radians(-480.0)
SLOW_NS = 10_000_000  # ways of masters are long
AT_START = (0.05, 0.1, 0.05, 0.1, 0.1, 0.05, 1.0)


def master(**changes: Any) -> ArmConfig:
    """MTML of the stock files."""
    values: dict[str, Any] = {"homing_zero_position": True, **changes}
    return ArmConfig("MTML", "MTM", "Classic", "22723", "IO1", "MTML", "NONE", 1 / 1500, stock.chain("MTML"), **values)


class MasterIo(FakeIo):
    """`turned`: how far the roll truly is above its stop; its encoder may read anything."""

    def __init__(self) -> None:
        super().__init__(AXES, name="MTML")
        self.position[...] = AT_START
        self.setpoint[...] = self.position
        self.has_stop = True
        self.spring = 0.0
        self.turned = 5.0

    def _do(self, name: str, values: tuple[float, ...]) -> None:
        encoder_set = self.record["encoder_set"][2:]
        if name == "set_encoder":
            axis, place = int(values[0]), values[1]
            assert not self.flag("pid_enabled") or self.record["effort_mode"][2 + axis]
            self.position[axis] = place + self.spring
            encoder_set[axis] = True
            self.flag("bias_generation", self.flag("bias_generation") + 1)
            return
        super()._do(name, values)
        if name == "bias_encoders" and (values[0] > 0 or not encoder_set.all()):
            left_out = [int(value) for value in values[1:]]
            encoder_set[...] = True
            encoder_set[left_out] = False
            self.position[left_out] = 0.0

    def _move(self) -> None:
        roll = float(self.position[ROLL])
        self.position[...] = np.where(self.record["effort_mode"][2:], self.position, self.setpoint)
        if self.has_stop:
            self.position[ROLL] = max(float(self.position[ROLL]), roll - self.turned)
        self.record["velocity"][2 + ROLL] = (self.position[ROLL] - roll) * SECOND / SLOW_NS
        self.turned += float(self.position[ROLL]) - roll


class MasterHarness(ArmHarness):
    """An MTM on it."""

    io: MasterIo

    def __init__(self, arm: ArmConfig | None = None, period_ns: int = SLOW_NS) -> None:
        super().__init__(arm or master(), period_ns, kind=MtmLogic)

    def make_io(self) -> MasterIo:
        return MasterIo()


    def put(self, *joints: float) -> None:
        """A hand brings the arm somewhere (7,), at rest; actuators that follow positions go back to theirs."""
        self.io.position[...] = self.io.setpoint[...] = actuator_of(joints)
        self.run(0.02)


def actuator_of(joints: Any) -> Any:
    """Actuator positions for joint positions of the stock masters."""
    to_joint = np.eye(AXES)
    to_joint[2, 1], to_joint[3, 1], to_joint[3, 2] = -1.0, 0.6697, -0.6697
    return np.linalg.solve(to_joint, joints)
