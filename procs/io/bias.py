"""Encoder bias: encoders are set from potentiometers, averaged while the arm may move.

Every good sample adds potentiometer − encoder; the mean of that plus the present encoder is where the actuator is, also
when it moved meanwhile. The preload is written, and believed when the encoder shows it two samples later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from procs.io.port import Port, PortError
from procs.io.record import Flags, Floats, Record
from procs.io.reports import Reports
from procs.io.robots import Robots, Samples
from procs.lib import conversion, faults, registers

SETTLE_SAMPLES: Final = 2
ATTEMPTS: Final = 3
NEAR_RAD: Final = 0.05
NEAR_M: Final = 0.005


@dataclass(slots=True)
class Collection:
    """One robot's bias under way."""

    wanted: int
    sums: Floats
    taken: int = 0
    settle: int = 0  # samples to wait until the encoders are looked at; 0: still collecting
    attempts: int = 0
    goal: Floats | None = None


class Bias:
    """Biases of all robots; `preset` tells whose encoders kept a preload from before."""

    def __init__(self, robots: Robots, port: Port, samples: Samples, record: Record, reports: Reports,
                 preset: Sequence[bool]) -> None:
        self._robots, self._port, self._samples, self._record = robots, port, samples, record
        self._reports = reports
        self.preset = list(preset)
        self._running: dict[int, Collection] = {}
        self._near = np.where([a.joint_type == "PRISMATIC" for a in robots.actuators], NEAR_M, NEAR_RAD)
        self._usable: Flags = robots.has_encoder & robots.has_pot

    def objection(self, robot: int, samples: int) -> str:
        """Why the robot can never be biased so, or ""."""
        if samples < 0 and self.preset[robot]:
            return ""
        axes = self._robots.slices[robot]
        if not (self._usable[axes] == self._robots.has_encoder[axes]).all():
            return "some of its encoders have no potentiometer"
        return "" if self._usable[axes].any() else "it has no encoders"

    def begin(self, robot: int, samples: int) -> None:
        """Start with |samples| potentiometer samples; negative accepts preset encoders."""
        if samples < 0 and self.preset[robot]:
            self._finish(robot)
            return
        axes = self._robots.slices[robot]
        self._running[robot] = Collection(abs(samples), np.zeros(axes.stop - axes.start))
        self._record.biasing[robot] = True
        self._record.biased[robot] = False

    def stop(self, robot: int) -> None:
        """Give up; what was there before is not trusted any more."""
        if self._running.pop(robot, None) is not None:
            self._record.biasing[robot] = False

    def step(self) -> None:
        """One good sample."""
        if self._running:
            for robot in list(self._running):
                self._advance(robot, self._running[robot])

    def _advance(self, robot: int, job: Collection) -> None:
        axes = self._robots.slices[robot]
        if job.goal is None:
            job.sums += self._samples.pot_error[axes]
            job.taken += 1
            if job.taken >= job.wanted:
                job.goal = job.sums / job.taken + self._samples.position[axes]
                self._set(robot, job)
            return
        job.settle -= 1
        if job.settle > 0:
            return
        usable = self._usable[axes]
        error = np.abs(self._samples.position[axes] - job.goal)[usable]
        if np.all(error <= self._near[axes][usable]):
            self._finish(robot)
        elif job.attempts < ATTEMPTS:
            self._set(robot, job)
        else:
            self._fail(robot, job)

    def _set(self, robot: int, job: Collection) -> None:
        """Write the preloads; a lost datagram is noticed by the look that follows."""
        job.attempts, job.settle = job.attempts + 1, SETTLE_SAMPLES
        self.preset[robot] = False  # until they are seen to have taken it
        assert job.goal is not None
        try:
            self.preload(robot, job.goal)
        except (ValueError, PortError) as error:
            self._reports.status(f"bias: {error}", self._robots.names[robot])
            if isinstance(error, ValueError):
                self._fail(robot, job)

    def preload(self, robot: int, position: Floats) -> None:
        """Make the robot's encoders read `position`; ValueError where that is not possible, nothing is written then."""
        axes, robots = self._robots.slices[robot], self._robots
        usable = robots.has_encoder[axes]
        bits = conversion.preload_bits(position[usable], robots.position_scale[axes][usable],
                                       robots.position_offset[axes][usable])
        places = np.arange(axes.start, axes.stop)[usable]
        for axis, value in zip(places.tolist(), bits.tolist(), strict=True):
            board = robots.board_ids[int(robots.board_row[axis])]
            address = registers.axis_register(int(robots.channel[axis]), registers.ENCODER_PRELOAD)
            self._port.write_quadlet(board, address, value)
        self._samples.encoders_were_set()

    def zero(self, robot: int) -> None:
        """The encoders mean nothing any more (overflow): mid-range, not biased."""
        self.stop(robot)
        self._record.biased[robot] = False
        self.preset[robot] = False
        axes = self._robots.slices[robot]
        try:
            self.preload(robot, self._robots.position_offset[axes])
        except (ValueError, PortError) as error:
            self._reports.status(f"encoders could not be set to mid-range: {error}", self._robots.names[robot])

    def _finish(self, robot: int) -> None:
        self._running.pop(robot, None)
        record = self._record
        record.biasing[robot], record.biased[robot] = False, True
        record.bias_generation[robot] += 1
        self.preset[robot] = True
        self._reports.status("encoders biased", self._robots.names[robot])

    def _fail(self, robot: int, job: Collection) -> None:
        self.stop(robot)
        axes = self._robots.slices[robot]
        assert job.goal is not None
        error = np.where(self._usable[axes], np.abs(self._samples.position[axes] - job.goal), 0.0)
        axis = int(np.argmax(np.where(np.isfinite(error), error, np.inf)))
        self._reports.trip(faults.BIAS_FAILED, robot, axis, float(self._samples.position[axes][axis]),
                           float(job.goal[axis]))
