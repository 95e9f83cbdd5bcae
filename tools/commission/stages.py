"""THE TABLE of stages, in the order in which a robot is commissioned."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from trocar.tools.commission.finding import Outcome


@dataclass(frozen=True, slots=True)
class CommissionStage:
    """One stage: the module of its name has `run(bench)`.

    `live`: io runs meanwhile, else (on real boards) there is no system.

    `real_time`: a rehearsal needs it, too; for the others simulated time suffices, which waits for a busy computer.
    """

    name: str
    text: str
    stops: str  # the findings at which it stops
    live: bool = True
    real_time: bool = False

    def load(self) -> Callable[..., Outcome]:
        """Its function."""
        run: Callable[..., Outcome] = importlib.import_module(f"trocar.tools.commission.{self.name}").run
        return run


STAGES: Final = (
    CommissionStage("scan", "boards on the bus, their hardware, firmware and serial numbers",
                    "a board that is missing, double, or of another kind than its file says", live=False),
    CommissionStage("read", "sensors and switches without power, every axis moved by hand",
                    "bad samples, a dead or noisy sensor, currents without power, wrong signs and scales"),
    CommissionStage("power", "relays and motor supplies, all amplifiers off",
                    "a supply that does not switch on or off, an amplifier that is on"),
    CommissionStage("axis", "one motor at a time, a small current, a little way",
                    "a wrong motion, another axis that moves, or none; a brake that slips or sticks"),
    CommissionStage("stop", "emergency stop and watchdog",
                    "an amplifier that stays on, or comes back by itself",
                    real_time=True),
    CommissionStage("calibrate", "potentiometers and grippers, into an IO file",
                    "a potentiometer that is not linear or far from its file"),
    CommissionStage("home", "every arm homed",
                    "a fault while homing, potentiometers that disagree with encoders"),
    CommissionStage("move", "every joint a little way, slowly, and one to its limit",
                    "a joint that does not follow, does not arrive, or passes its limit"),
)
NAMES: Final = tuple(stage.name for stage in STAGES)
