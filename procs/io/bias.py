"""Encoder bias: set encoders from potentiometers, averaged while the arm may move, or one by one to a given value.

Every good sample adds potentiometer − encoder. The mean of that plus the present encoder value is the actuator's
position, also when the actuator moved meanwhile. The preload is written, and accepted when the encoder shows it two
samples later. Actuators whose potentiometer does not measure the position (the roll of a master) are left out of a
bias: their encoders go to mid-range, which means "not set", until each is set at a known position (a stop).

Each setting changes the meaning of positions, so each counts as a new bias generation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.fpga import conversion
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import IoData
from trocar.procs.tables import codes
from trocar.procs.tables.generation import next_generation

SETTLE_SAMPLES: Final = 2
ATTEMPTS: Final = 3
NEAR_RAD: Final = 0.05
NEAR_M: Final = 0.005
BIASED: Final = "encoders biased"
BEYOND: Final = 0.1  # of its range: how far outside its limits an encoder may be set; a stop may be there


@dataclass(slots=True)
class EncoderSetting:
    """Encoders of one robot that are being set."""

    text: str  # what was done, reported at the end
    which: Flags  # actuators that get their value; those that a bias leaves out get mid-range
    written: Flags
    wanted: int = 0
    sums: Floats | float = 0.0
    taken: int = 0
    settle: int = 0  # samples to wait before the encoders are checked; 0: still collecting
    attempts: int = 0
    goal: Floats | None = None


class Bias:
    """Biases of all robots; the record's `encoder_set` shows which encoders kept an earlier preload."""

    def __init__(self, data: IoData, encoders_set: Callable[[int, Flags], None]) -> None:
        """`encoders_set` is called with every sample in which encoders of a robot may start to read something else."""
        robots, record = data.robots, data.record
        self._robots, self._port, self._samples, self._record = robots, data.port, data.samples, record
        self._reports, self._encoders_set = data.reports, encoders_set
        self.running: dict[int, EncoderSetting] = {}
        self._near = np.where([a.joint_type == "PRISMATIC" for a in robots.actuators], NEAR_M, NEAR_RAD)
        for robot in range(len(robots.names)):
            record.biased[robot] = self._preset(robot)

    def _preset(self, robot: int) -> bool:
        """Whether the robot has encoders and all of them are set."""
        axes = self._robots.slices[robot]
        there = self._robots.has_encoder[axes]
        return bool(there.any() and self._record.encoder_set[axes][there].all())

    def objection(self, robot: int, samples: int, left_out: Flags) -> str:
        """Why this bias is impossible for the robot, or ""."""
        if samples < 0 and self._preset(robot):
            return ""
        axes, robots = self._robots.slices[robot], self._robots
        which = robots.has_encoder[axes] & ~left_out
        if not robots.has_pot[axes][which].all():
            return "some of its encoders have no potentiometer"
        return "" if which.any() else "it has no encoders, or all of them are left out"

    def begin(self, robot: int, samples: int, left_out: Flags) -> None:
        """Start with |samples| potentiometer samples; negative accepts preset encoders."""
        axes, record = self._robots.slices[robot], self._record
        there = self._robots.has_encoder[axes]
        if samples < 0 and self._preset(robot):
            self._finish(robot, EncoderSetting(BIASED, there, there))
            return
        self.running[robot] = EncoderSetting(BIASED, there & ~left_out, there, abs(samples),
                                              np.zeros(axes.stop - axes.start))
        record.biasing[robot] = True
        record.biased[robot] = False

    def set_objection(self, robot: int, axis: int, position: float) -> str:
        """Why this encoder cannot be set to this position, or ""."""
        place, robots = self._robots.slices[robot].start + axis, self._robots
        if not robots.has_encoder[place]:
            return f"axis {axis} has no encoder"
        low, high = float(robots.lower[place]), float(robots.upper[place])
        room = BEYOND * (high - low)
        if low < high and not low - room <= position <= high + room:
            return f"{position:g} is outside the position limits of axis {axis}, {low:g} to {high:g}"
        try:
            conversion.preload_bits(np.array([position]), robots.position_scale[[place]],
                                    robots.position_offset[[place]])
        except ValueError as error:
            return str(error)
        return ""

    def set_one(self, robot: int, axis: int, position: float) -> None:
        """Make one encoder read `position`, rad or m."""
        axes = self._robots.slices[robot]
        which = np.arange(axes.stop - axes.start) == axis
        self.running[robot] = job = EncoderSetting(f"encoder of axis {axis} set to {position:g}", which, which,
                                                     goal=np.where(which, position, 0.0))
        self._record.biasing[robot] = True
        self._set(robot, job)

    def stop(self, robot: int) -> None:
        """Stop the setting; the robot counts as not biased."""
        if self.running.pop(robot, None) is not None:
            self._record.biasing[robot] = self._record.biased[robot] = False

    def step(self) -> None:
        """Called with each good sample."""
        if self.running:
            for robot in list(self.running):
                self._advance(robot, self.running[robot])

    def _advance(self, robot: int, job: EncoderSetting) -> None:
        axes = self._robots.slices[robot]
        if job.goal is None:
            job.sums += self._samples.pot_error[axes]
            job.taken += 1
            if job.taken >= job.wanted:
                mean = job.sums / job.taken + self._samples.position[axes]
                job.goal = np.where(job.which, mean, self._robots.position_offset[axes])
                self._set(robot, job)
            return
        self._encoders_set(robot, job.written)
        job.settle -= 1
        if job.settle > 0:
            return
        error = np.abs(self._samples.position[axes] - job.goal)[job.written]
        if np.all(error <= self._near[axes][job.written]):
            self._finish(robot, job)
        elif job.attempts < ATTEMPTS:
            self._set(robot, job)
        else:
            self._fail(robot, job)

    def _set(self, robot: int, job: EncoderSetting) -> None:
        """Write the preloads; a lost datagram is found by the check that follows."""
        job.attempts, job.settle = job.attempts + 1, SETTLE_SAMPLES
        self._record.encoder_set[self._robots.slices[robot]][job.written] = False  # until they show it
        assert job.goal is not None
        try:
            self.preload(robot, job.goal, job.written)
        except (ValueError, PortError) as error:
            self._reports.status(f"bias: {error}", self._robots.names[robot])
            if isinstance(error, ValueError):
                self._fail(robot, job)

    def preload(self, robot: int, position: Floats, which: Flags) -> None:
        """Make these encoders read `position`; ValueError if impossible, then nothing is written."""
        axes, robots = self._robots.slices[robot], self._robots
        bits = conversion.preload_bits(position[which], robots.position_scale[axes][which],
                                       robots.position_offset[axes][which])
        places = np.arange(axes.start, axes.stop)[which]
        for axis, value in zip(places.tolist(), bits.tolist(), strict=True):
            self._port.write_quadlet(*robots.preload_register(axis), value)
        self._samples.encoders_were_set()

    def forget(self, lost: Flags) -> None:
        """These encoders (axes,) are no longer set: their boards had no power."""
        for robot, axes in enumerate(self._robots.slices):
            if lost[axes].any():
                self._record.biased[robot] = False
                self._record.encoder_set[axes][lost[axes]] = False

    def zero(self, robot: int) -> None:
        """The encoders are meaningless (overflow, an Si arm without preload): set to mid-range, not biased."""
        self.stop(robot)
        self._record.biased[robot] = False
        axes = self._robots.slices[robot]
        self._record.encoder_set[axes] = False
        try:
            self.preload(robot, self._robots.position_offset[axes], self._robots.has_encoder[axes])
        except (ValueError, PortError) as error:
            self._reports.status(f"encoders could not be set to mid-range: {error}", self._robots.names[robot])

    def _finish(self, robot: int, job: EncoderSetting) -> None:
        self.running.pop(robot, None)
        record = self._record
        record.encoder_set[self._robots.slices[robot]][job.which] = True
        record.biasing[robot] = False
        record.bias_generation[robot] = next_generation(int(record.bias_generation[robot]))
        if job.wanted or self._preset(robot):
            record.biased[robot] = True
        self._reports.status(job.text, self._robots.names[robot])

    def _fail(self, robot: int, job: EncoderSetting) -> None:
        self.stop(robot)
        axes = self._robots.slices[robot]
        assert job.goal is not None
        error = np.where(job.written, np.abs(self._samples.position[axes] - job.goal), 0.0)
        axis = int(np.argmax(np.where(np.isfinite(error), error, np.inf)))
        self._reports.trip(codes.BIAS_FAILED, robot, axis, float(self._samples.position[axes][axis]),
                           float(job.goal[axis]))
