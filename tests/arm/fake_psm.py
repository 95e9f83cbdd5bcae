"""A PSM with switches for its sterile adapter and its instrument, on the fake io."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tests.arm.arm_configs import TOOL, bare_arm
from tests.arm.fake_io import ArmHarness
from trocar.procs.document.system import ArmInputs

INPUTS = {"PSM1_arm_clutch": 0, "PSM1_adapter": 1, "PSM1_tool": 2}
NAMES = ArmInputs(clutch="PSM1_arm_clutch", adapter="PSM1_adapter", tool="PSM1_tool")
DRIVER = "LARGE_NEEDLE_DRIVER:400006"
OTHER = dataclasses.replace(TOOL, name="MEGA_NEEDLE_DRIVER_400194", names=("MEGA_NEEDLE_DRIVER",), model="400194")
LONG_NS = 5_000_000  # what is engaged takes seconds
FASTEST = np.array((1.58, 1.58, 0.2, 18.9, 18.9, 18.9, 18.9)) * LONG_NS * 1e-9 * 1.01


class SwitchedPsm(ArmHarness):
    """A PSM with switches for adapter and instrument; every cycle's step of every actuator is looked at."""

    def __init__(self, **changes: Any) -> None:
        detection = {"tool_detection": "MANUAL", "tools": (TOOL, OTHER), **changes}
        super().__init__(bare_arm(inputs=NAMES, instrument_reader="PSM1_dallas", **detection), LONG_NS, inputs=INPUTS)
        self.largest = np.zeros(7)

    def step(self, *requests: Any) -> None:
        before = self.io.setpoint.copy()
        super().step(*requests)
        self.largest = np.maximum(self.largest, np.abs(self.io.setpoint - before))

    def homed(self) -> SwitchedPsm:
        with self.hurried():
            self.run(0.6)
        super().homed()
        self.largest[...] = 0.0
        return self

    def retracted(self) -> SwitchedPsm:
        """So far out that an instrument is not beyond the cannula."""
        move = self.send("move_jp", (0.1, -0.1, 0.01, *self.state["setpoint_position"][3:7]))
        self.until(lambda: "done" in move.outcomes)
        return self

    def put_on(self, *names: str) -> None:
        for name in names:
            self.press(f"PSM1_{name}")
        self.run(0.01)

    def take_off(self, *names: str) -> None:
        for name in names:
            self.press(f"PSM1_{name}", False)
        self.run(0.01)

    @property
    def reported(self) -> list[str]:
        return [e[1].removeprefix("PSM1: ") for e in self.reports.of("status") if "engaging" in e[1]]

    @property
    def types(self) -> list[tuple[str, str]]:
        return [e[:2] for e in self.reports.of("tool_type", "tool_type_request")]

    @property
    def homed_flag(self) -> bool:
        return bool(self.state["is_homed"])

    def nothing_jumped(self) -> bool:
        return bool((self.largest <= FASTEST).all())


def with_adapter(**changes: Any) -> SwitchedPsm:
    psm = SwitchedPsm(**changes)
    psm.put_on("adapter")
    return psm.homed()


def restart(psm: SwitchedPsm, away_s: float = 0.3) -> None:
    """kill -9; io holds for a while; a new process begins on the records as they are."""
    for _ in range(round(away_s * 1e9 / psm.period_ns)):
        psm.now_ns += psm.period_ns
        psm.setpoint.set("mode", 0)
        psm.setpoint["in_effort"][...] = False
        psm.io.cycle(psm.now_ns, psm.setpoint)
    psm.start_arm()
    psm.largest[...] = 0.0
