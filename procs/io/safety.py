"""Checks of every good sample: motor current, board safety cut-off, temperature, potentiometers, encoder overflow.

Motor current is compared with its limits and, if configured, with the requested current. All checks are levels: one
comparison of five rows (six with the requests) over all axes shows that all is well, the rest runs only otherwise.
Every fault of a cycle is collected before anything is switched off. Comparisons are written so that NaN fails them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import conversion
from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import CHECKED, CURRENT, OVERFLOW, PERIOD, POT_ERROR, SAFETY, TEMPERATURE, IoData
from trocar.procs.tables import codes

CURRENT_ERROR: Final = CHECKED  # the row after those of the samples, if configured
CURRENT_CYCLES: Final = 100  # tolerated consecutive cycles above the limit
IDLE_CURRENT_A: Final = 0.1  # measured with the amplifier off
UNPOWERED_CURRENT_A: Final = 0.2  # without motor power the sensors drift more; uncalibrated ones at any time
HOT_C: Final = 65.0
WARM_C: Final = 60.0
WARM_REPEAT_NS: Final = 120_000_000_000


class Safety:
    """Limits as one (5 or 6, drives) array that matches the measured rows; amplifiers, power and switches change them.
    """

    def __init__(self, data: IoData) -> None:
        robots, samples = data.robots, data.samples
        self._robots, self._samples, self._record, self._reports = robots, samples, data.record, data.reports
        n, drives = robots.axes, robots.drives
        self._values = samples.values[:CHECKED]
        self._error_a, self._error_s = robots.io.current_error_a, robots.io.current_error_s
        self._compares = self._error_a > 0.0
        self.rows = rows = CHECKED + self._compares
        self.magnitude: Floats = np.zeros((rows, drives))
        self.limits: Floats = np.full((rows, drives), np.inf)
        self.within: NDArray[np.bool_] = np.ones((rows, drives), dtype=bool)
        self._sampled = self.magnitude[:CHECKED]
        self._current_apart: Floats = self.magnitude[CURRENT_ERROR] if self._compares else np.zeros(0)
        self._unlike_s = np.zeros(drives)
        self._enabled_limit = conversion.feedback_limit(robots.maximum_current)
        tolerances = [robot.tolerances[i] if i < len(robot.tolerances) else None
                      for robot in robots.io.robots for i in range(len(robot.actuators))]
        self._distance = np.array([t.distance if t and t.distance > 0.0 else np.inf for t in tolerances])
        self._latency = np.array([t.latency_s if t else np.inf for t in tolerances])
        self._distance[~(robots.has_pot & robots.has_encoder)] = np.inf
        self._apart_s = np.zeros(n)
        self._pot_reported: Flags = np.zeros(n, dtype=bool)
        self._cycles = [0] * len(robots.names)
        self._overflow_handled = [False] * len(robots.names)
        self._warm_ns = [-WARM_REPEAT_NS] * len(robots.names)
        self.counting = False
        counts = np.array([not r.only_io for r in robots.io.robots], dtype=bool)
        counted = counts[robots.robot_of_axis] if n else np.zeros(0, dtype=bool)
        self.limits[OVERFLOW, :n] = np.where(counted & robots.has_encoder, 0.5, np.inf)
        self.set_encoder_zero: list[int] = []  # robots whose encoders overflowed in this cycle
        self.refresh(np.zeros(len(robots.names), dtype=bool))

    def refresh(self, reached: Flags) -> None:
        """Update the limits after a change of amplifier enables, power or a switch.

        `reached` (robots,): all amplifiers have been on. From then on a board's cut-off counts, also when the amplifier
        it cut shows as off in the same sample; an earlier latch is cleared by the enable.
        """
        robots, record, n = self._robots, self._record, self._robots.axes
        wanted = record.power_requested[robots.robot_of_drive]
        powered = record.powered[robots.robot_of_drive]
        idle = np.where(powered & (not robots.io.calibration_mode), IDLE_CURRENT_A, UNPOWERED_CURRENT_A)
        limit = np.where(record.amp_enabled, self._enabled_limit, idle)
        limit[n:] = self._enabled_limit[n:]  # brakes: the same whether on or off
        self.limits[CURRENT] = np.nextafter(limit, 0.0)  # the limit itself is already too much
        self.limits[TEMPERATURE] = np.where(wanted, WARM_C, np.inf)
        self.limits[SAFETY] = np.where(reached[robots.robot_of_drive], 0.5, np.inf)
        self.limits[POT_ERROR, :n] = np.where(record.pot_check[robots.robot_of_axis], self._distance, np.inf)
        if self._compares:
            self.limits[CURRENT_ERROR] = np.where(self._samples.amp_on > 0.5, self._error_a, np.inf)

    def forget_pots(self, axes: slice) -> None:
        """The potentiometer check was switched: its durations restart."""
        self._apart_s[axes] = 0.0
        self._pot_reported[axes] = False

    def check(self) -> bool:
        """Compare the newest sample with the limits; True: a value is or was beyond its limit: call `examine`."""
        np.absolute(self._values, self._sampled)
        if self._compares:  # the request is still the one the boards had during the measurement
            np.subtract(self._samples.current, self._record.current_request, self._current_apart)
            np.absolute(self._current_apart, self._current_apart)
        np.less_equal(self.magnitude, self.limits, self.within)
        return b"\0" in self.within.tobytes()

    def examine(self, now_ns: int) -> None:
        """Examine all values that are or were beyond their limits."""
        fine = self.within
        self.counting = False
        for robot, places in enumerate(self._robots.of_robot):
            self._check_current(robot, fine[CURRENT, places], places)
            if not fine[SAFETY, places].all():
                self._reports.trip_axes(codes.SAFETY_AMP_DISABLE, robot, ~fine[SAFETY, places])
            if not fine[TEMPERATURE, places].all():
                self._check_temperature(robot, places, now_ns)
            self._check_overflow(robot, fine[OVERFLOW, places])
        if not self._robots.io.calibration_mode:
            self._check_pots(fine[POT_ERROR, : self._robots.axes])
        if self._compares:
            self._check_current_error(fine[CURRENT_ERROR])

    def _check_current(self, robot: int, fine: Flags, places: NDArray[np.intp]) -> None:
        if fine.all():
            self._cycles[robot] = 0
            return
        self.counting = True
        self._cycles[robot] += 1
        if self._cycles[robot] > CURRENT_CYCLES:
            self._cycles[robot] = 0
            self._reports.trip_axes(codes.CURRENT, robot, ~fine, self._values[CURRENT, places],
                                    self.limits[CURRENT, places])

    def _check_current_error(self, fine: Flags) -> None:
        self._unlike_s[fine] = 0.0
        unlike = ~fine
        if not unlike.any():
            return
        self.counting = True
        self._unlike_s[unlike] += self._samples.values[PERIOD, unlike]
        late = unlike & ~(self._unlike_s <= self._error_s)
        self._unlike_s[late] = 0.0
        for robot, places in enumerate(self._robots.of_robot):
            bad = late[places]
            if bad.any():
                self._reports.trip_axes(codes.CURRENT_ERROR, robot, bad, self._current_apart[places], self._error_a)

    def _check_temperature(self, robot: int, places: NDArray[np.intp], now_ns: int) -> None:
        celsius = self._values[TEMPERATURE, places]
        hot = ~(celsius <= HOT_C)
        if hot.any():
            self._reports.trip_axes(codes.TEMPERATURE, robot, hot, celsius, HOT_C)
        elif now_ns - self._warm_ns[robot] >= WARM_REPEAT_NS:
            axis = int(np.argmax(celsius))
            self._warm_ns[robot] = now_ns
            self._reports.trip(codes.TEMPERATURE_HIGH, robot, axis, float(celsius[axis]), WARM_C)

    def _check_overflow(self, robot: int, fine: Flags) -> None:
        if fine.all():
            self._overflow_handled[robot] = False
            return
        self.counting = True
        if not self._overflow_handled[robot]:
            self._overflow_handled[robot] = True
            self.set_encoder_zero.append(robot)
            self._reports.trip_axes(codes.ENCODER_OVERFLOW, robot, ~fine)

    def _check_pots(self, fine: Flags) -> None:
        apart = ~fine
        self._apart_s[fine] = 0.0
        self._pot_reported[fine] = False
        if not apart.any():
            return
        self.counting = True
        self._apart_s[apart] += self._samples.period_s[apart]
        late = apart & (~(self._apart_s <= self._latency) | ~np.isfinite(self._samples.pot_error))
        # a continuing error is reported again for a robot that was powered meanwhile
        again = (self._record.power_requested & (self._record.fault == 0))[self._robots.robot_of_axis]
        for axis in np.flatnonzero(late & (~self._pot_reported | again)).tolist():
            self._pot_reported[axis] = True
            robot, place = self._robots.place(axis)
            if self._robots.has_table[axis] and np.isnan(self._samples.pot_error[axis]):
                self._reports.trip(codes.POT_MISSING, robot, place)
                continue
            self._reports.trip(codes.POTENTIOMETER, robot, place, float(self._samples.pot_error[axis]),
                               float(self._distance[axis]))
