"""THE TABLE of stages, in the order in which a robot is commissioned."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from trocar.tools.commission.finding import Outcome


@dataclass(frozen=True, slots=True)
class CommissionStage:
    """One stage: the module of its name has `run(bench)`, or `run(bench, folder, write=…)` where it `writes`.

    `live`: io runs meanwhile, else (on real boards) there is no system.

    `real_time`: a rehearsal needs it, too; for the others simulated time suffices, which waits for a busy computer.

    `writes`: it makes new files: IO files, tables, gravity files.
    """

    name: str
    text: str
    stops: str  # the findings at which it stops
    live: bool = True
    real_time: bool = False
    writes: bool = False

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
    CommissionStage("currents", "currents without a command, into an IO file",
                    "a current that is large, noisy, or moves an axis", writes=True),
    CommissionStage("tables", "potentiometer tables of Si arms, moved by hand, into a file",
                    "a range that is not that of the arm, readings that are missing or not repeated", writes=True),
    CommissionStage("brakes", "currents that release brakes and keep them released, by hand, into an IO file",
                    "a brake that does not hold or does not release", writes=True),
    CommissionStage("axis", "one motor at a time, a small current, a little way",
                    "a wrong motion, another axis that moves, or none; a brake that slips or sticks"),
    CommissionStage("stop", "emergency stop and watchdog",
                    "an amplifier that stays on, or comes back by itself",
                    real_time=True),
    CommissionStage("calibrate", "potentiometers and grippers, into an IO file",
                    "a potentiometer that is not linear or far from its file", writes=True),
    CommissionStage("depth", "insertion of PSMs at the remote centre, by hand, into an IO file",
                    "a place that is not repeated, or further off than any arm's", writes=True),
    CommissionStage("home", "every arm homed", "a fault while homing, potentiometers that disagree with encoders"),
    CommissionStage("move", "every joint a little way, slowly, and one to its limit",
                    "a joint that does not follow, does not arrive, or passes its limit"),
    CommissionStage("gravity", "weight of masters, from many poses, into a gravity file",
                    "a model that does not predict other poses", writes=True),
    CommissionStage("setup_joints", "potentiometers of Classic setup joints, from measured poses, into their file",
                    "a dead, loose, worn or swapped potentiometer, a mistyped value", writes=True),
)
NAMES: Final = tuple(stage.name for stage in STAGES)
