"""The joint controller: one PID law over n actuators at once, in place.

Per actuator with measured p, v and setpoint sp, fv:

    e = sp − p, shortened by the dead-band (soft up to the outer one); inside it e = 0 and there is no damping
    ve = fv − v, fv the low-passed velocity feed, 0 unless setpoints carry velocity and it is used
    I = clamp(I · forget + e, ± i_limit)                      per cycle, no time step
    D = observed disturbance: t = u_before + m·g·v, S += (t − S)·g·dt, D = S − m·g·v
    u = D + Kp·e + Kd·ve + Ki·I, clamped to ± pid_max_output when that is ≥ 0 (0, the default of files: no effort)
    f = u + offset + feed-forward + contribution, clamped to the effort limits

The contribution is what in-cycle tasks add. In effort mode f = requested effort + feed-forward + contribution. A
disabled actuator has f = 0 (or the effort of a test that drives it directly) and its setpoint follows p, so that
enabling starts without a step. Enabling clears integral, observer and velocity filter. A value that is not finite
counts as a tracking error, and an effort that is not finite is replaced by 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.gains import GAINS
from trocar.procs.document.system import PidAxis
from trocar.procs.io.record import Flags, Floats

SWITCHES: Final = ("has_dead_band", "is_soft", "filters", "integrates", "observes", "limits_output", "has_offset",
                   "any_off", "any_effort", "has_contribution")
"""Names of the elements of `Pid.switches`: parts of the law that are in use."""


class Pid:
    """State and gains of n actuators. Inputs and results are arrays (n,) that are allocated once.

    A caller writes `setpoint_position`, `setpoint_velocity`, `requested_effort` and `feed_forward`, sets modes through
    the methods, calls `compare` and `control` once a cycle, and reads `effort`, `position_error` and `disturbance`.
    """

    def __init__(
        self, axes: Sequence[PidAxis | None], effort_limit: Floats, dt_s: float, *,
        arrays: tuple[Floats, Floats, Floats, Floats, Floats, Flags] | None = None,
    ) -> None:
        """`axes` in actuator order, None without a controller (never enabled); `effort_limit` (n,) symmetric.

        `arrays` places setpoint position, velocity, effort, position error, observed disturbance and effort mode in the
        caller's memory (a ring's record). `dt_s` is the integration period of the observer.
        """
        n = len(axes)
        self.gains = [a or PidAxis("", "UNDEFINED", 0.0, 0.0, 0.0) for a in axes]
        self._dt_s = dt_s
        self.controlled: Flags = np.array([a is not None for a in axes], dtype=bool)
        memory = arrays or (np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, dtype=bool))
        self.setpoint_position: Floats = memory[0]
        self.setpoint_velocity: Floats = memory[1]
        self.effort: Floats = memory[2]
        self.position_error: Floats = memory[3]
        self.disturbance: Floats = memory[4]
        self.effort_mode: Flags = memory[5]
        self.requested_effort, self.feed_forward = np.zeros(n), np.zeros(n)
        self.contribution = np.zeros(n)  # from in-cycle tasks, if there are any
        self.effort_when_off = np.zeros(n)  # of tests of single axes
        self.enabled: Flags = np.zeros(n, dtype=bool)
        self.integral = np.zeros(n)
        limited = effort_limit > 0.0
        self.effort_limit = np.where(limited, effort_limit, np.inf)
        self._minus_effort = -self.effort_limit
        self.observer_input, self.observer_state = np.zeros(n), np.zeros(n)
        self.has_velocity, self._checked = np.zeros(n), np.zeros(n, dtype=bool)
        self.filtered = np.zeros(n)
        self.allowed = np.full(n, np.inf)
        self.excess, self.within = np.zeros(n), np.ones(n, dtype=bool)
        """Tracking error after the dead-band, and whether it is within `allowed`."""
        self.off = np.ones(n, dtype=bool)
        self.switches: NDArray[np.int64] = np.zeros(len(SWITCHES), dtype=np.int64)
        self.p_gain, self.d_gain, self.i_gain, self.i_limit, self.i_forget_rate = (np.zeros(n) for _ in range(5))
        self.p_deadband, self.p_deadband_outer, self.offset, self.tolerance = (np.zeros(n) for _ in range(4))
        self.v_low_pass_cutoff, self.pid_max_output, self.use_disturbance_observer = (np.zeros(n) for _ in range(3))
        self.nominal_mass, self.disturbance_cutoff = np.zeros(n), np.zeros(n)
        self.per_width, self.share_old, self.output_limit = (np.zeros(n) for _ in range(3))
        self.momentum, self.rate = np.zeros(n), np.zeros(n)
        self._minus_output = np.zeros(n)
        self._a, self._b, self._x, self._f = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        self._inside = np.zeros(n, dtype=bool)
        self.finite = np.ones(n, dtype=bool)
        """Whether the law gave a number; else the effort is 0."""
        self._zero, self._one = np.zeros(n), np.ones(n)
        self._three, self._minus_two = np.full(n, 3.0), np.full(n, -2.0)
        self._any_off, self._any_effort, self._has_contribution = True, False, False
        self._adopt()

    def _adopt(self) -> None:
        """Copy the values of `gains` into the arrays of the same names, and derive the others, in place."""
        for gain in GAINS:
            getattr(self, gain.field)[...] = [float(getattr(row, gain.field)) for row in self.gains]
        self._has_offset = bool(np.any(self.offset != 0.0))
        outer = np.maximum(self.p_deadband_outer, self.p_deadband)
        width = outer - self.p_deadband
        self._dead = bool(np.any(outer > 0.0))
        self._soft = bool(np.any(width > 0.0))
        self.per_width[...] = np.inf
        np.divide(1.0, width, out=self.per_width, where=width > 0.0)
        self._integrates = bool(np.any(self.i_gain != 0.0))
        np.subtract(1.0, self.v_low_pass_cutoff, out=self.share_old)
        self._filters = bool(np.any(self.share_old != 0.0))
        limited = self.pid_max_output >= 0.0
        self.output_limit[...] = np.where(limited, self.pid_max_output, np.inf)
        np.negative(self.output_limit, out=self._minus_output)
        self._limits_output = bool(np.any(limited))
        observed = self.use_disturbance_observer
        self._observes = bool(np.any(observed))
        self.momentum[...] = self.nominal_mass * self.disturbance_cutoff * observed
        self.rate[...] = self.disturbance_cutoff * self._dt_s * observed
        self._set_switches()

    def _set_switches(self) -> None:
        self.switches[...] = (self._dead, self._soft, self._filters, self._integrates, self._observes,
                              self._limits_output, self._has_offset, self._any_off, self._any_effort,
                              self._has_contribution)

    def configure(self, changes: Mapping[int, PidAxis], velocity: Floats) -> None:
        """Set new gains for some actuators from the next `control` on; `velocity` (n,) is the measured one.

        The controller's memory continues from its present effort: the integral is rescaled, the observed disturbance
        stays. Parameters that act on the present error (gains, dead-bands, offset, limits) take effect at once, and an
        integral or observer that is switched off drops its effort.
        """
        momentum = self.momentum.copy()
        for axis, row in changes.items():
            before, self.gains[axis] = self.gains[axis], row
            self.integral[axis] *= before.i_gain / row.i_gain if row.i_gain else 0.0
        self._adopt()
        self._inside[...] = False  # not filled after the last dead-band is removed
        for axis, row in changes.items():
            if row.use_disturbance_observer:
                self.observer_state[axis] += (self.momentum[axis] - momentum[axis]) * velocity[axis]
            else:
                self.observer_state[axis] = self.observer_input[axis] = self.disturbance[axis] = 0.0
        self._modes_changed()

    def enable(self, axes: slice | Flags, on: bool, position: Floats) -> None:
        """Switch the actuators `axes` on or off at measured `position` (n,); always starts from a clean state."""
        self.enabled[axes] = self.controlled[axes] & on
        for each in (self.integral, self.disturbance, self.observer_input, self.observer_state, self.filtered,
                     self.has_velocity, self.feed_forward, self.requested_effort, self.setpoint_velocity,
                     self.position_error, self.effort, self.effort_when_off):
            each[axes] = 0.0
        self.effort_mode[axes] = False
        self.setpoint_position[axes] = position[axes]
        self._modes_changed()

    def use_effort(self, axes: slice | Flags, on: bool | Flags) -> None:
        """Pass efforts through (True) or follow positions."""
        self.effort_mode[axes] = on
        self._modes_changed()

    def carry_velocity(self, axes: slice | Flags, on: bool) -> None:
        """Use the setpoint velocities or not; restarts the filter when they are not used."""
        self.has_velocity[axes] = float(on)
        if not on:
            self.filtered[axes] = 0.0
            self.setpoint_velocity[axes] = 0.0

    def check_tracking(self, axes: slice | Flags, on: bool) -> None:
        """Trip on a tracking error above the tolerance."""
        self._checked[axes] = on
        self._modes_changed()

    def contribute(self) -> Floats:
        """An array (n,) for in-cycle tasks, which is added to the efforts from now on."""
        self._has_contribution = True
        self._set_switches()
        return self.contribution

    def _modes_changed(self) -> None:
        np.logical_not(self.enabled, out=self.off)
        self._any_off = bool(np.any(self.off))
        self._any_effort = bool(np.any(self.effort_mode))
        watched = self._checked & self.enabled & ~self.effort_mode
        self.allowed[...] = np.where(watched, self.tolerance, np.inf)
        self._set_switches()

    def compare(self, position: Floats) -> bool:
        """Compare the tracking errors at the measured positions (n,) with their tolerances; True: call `beyond`."""
        e = self._b
        np.subtract(self.setpoint_position, position, e)
        np.less_equal(self._dead_band(e, self.excess), self.allowed, self.within)
        return b"\0" in self.within.tobytes()

    def control(self, position: Floats, velocity: Floats) -> bool:
        """One cycle on the measured values (n,): fills `effort` and `position_error`; returns whether all are `finite`.
        """
        e, u = self.position_error, self._f
        np.subtract(self.setpoint_position, position, e)
        self._dead_band(e, self._b)
        if self._any_effort:
            np.copyto(e, self._zero, where=self.effort_mode)
        ve = self._velocity_error(velocity)
        np.multiply(self.p_gain, e, u)
        np.multiply(self.d_gain, ve, ve)
        np.add(u, ve, u)
        self._integral_and_observer(e, velocity, u)
        if self._limits_output:
            np.minimum(u, self.output_limit, out=u)
            np.maximum(u, self._minus_output, out=u)
        f = self.effort
        if self._has_offset or self._any_effort:
            np.add(u, self.offset, f)
            if self._any_effort:
                np.copyto(f, self.requested_effort, where=self.effort_mode)
            np.add(f, self.feed_forward, f)
        else:
            np.add(u, self.feed_forward, f)
        if self._has_contribution:
            np.add(f, self.contribution, f)
        np.minimum(f, self.effort_limit, out=f)
        np.maximum(f, self._minus_effort, out=f)
        return self._finish(position, u)

    def beyond(self, exempt: Flags) -> Flags | None:
        """None, or flags (n,) of actuators whose compared tracking error (after the dead-band) is above its tolerance.

        Actuators may be `exempt`, except from an error that is not a number. The caller switches off.
        """
        beyond: Flags = ~self.within & self.enabled & ~self.effort_mode
        beyond &= ~(exempt & np.isfinite(self.excess))
        return beyond if bool(np.any(beyond)) else None

    def _dead_band(self, e: Floats, excess: Floats) -> Floats:
        """Shorten the errors `e` in place; returns their magnitude, in `excess`. Fills `_inside`, where there is any
        dead-band.
        """
        a = self._a
        if not self._dead:
            return np.absolute(e, excess)
        np.absolute(e, a)
        np.less(a, self.p_deadband, self._inside)
        np.subtract(a, self.p_deadband, excess)
        np.maximum(excess, self._zero, out=excess)
        if self._soft:
            # x²(3 − 2x) rises from 0 to 1 between the dead-bands; without an outer one x is 1 at once
            x = self._x
            with np.errstate(invalid="ignore"):  # 0 · inf exactly on a hard edge: fmin turns the NaN into 1
                np.multiply(excess, self.per_width, x)
            np.fmin(x, self._one, out=x)
            np.multiply(excess, x, excess)
            np.multiply(excess, x, excess)
            np.multiply(x, self._minus_two, x)
            np.add(x, self._three, x)
            np.multiply(excess, x, excess)
        np.copysign(excess, e, e)
        return excess

    def _velocity_error(self, velocity: Floats) -> Floats:
        """Velocity feed minus measured velocity, 0 inside the dead-band, where the filter does not advance."""
        ve, fed, x = self._a, self.filtered, self._x
        if not (self._filters or self._dead):
            np.multiply(self.setpoint_velocity, self.has_velocity, fed)
            return np.subtract(fed, velocity, ve)
        if self._filters:
            np.multiply(self.share_old, fed, ve)
            np.multiply(self.v_low_pass_cutoff, self.setpoint_velocity, x)
            np.add(ve, x, x)
        else:
            np.copyto(x, self.setpoint_velocity)
        np.multiply(x, self.has_velocity, x)
        if b"\1" in self._inside.tobytes():
            np.copyto(x, fed, where=self._inside)
            np.copyto(fed, x)
            np.subtract(fed, velocity, ve)
            np.copyto(ve, self._zero, where=self._inside)
            return ve
        np.copyto(fed, x)
        return np.subtract(fed, velocity, ve)

    def _integral_and_observer(self, e: Floats, velocity: Floats, u: Floats) -> None:
        """Add the integral and the observed disturbance to `u`."""
        x = self._x
        if self._integrates:
            i = self.integral
            np.multiply(i, self.i_forget_rate, i)
            np.add(i, e, i)
            np.minimum(i, self.i_limit, out=i)
            np.maximum(i, -self.i_limit, out=i)
            np.multiply(i, self.i_gain, x)
            np.add(u, x, u)
        if self._observes:
            state, step = self.observer_state, self._b
            np.multiply(self.momentum, velocity, x)
            np.add(self.observer_input, x, step)
            np.subtract(step, state, step)
            np.multiply(step, self.rate, step)
            np.add(state, step, state)
            np.subtract(state, x, self.disturbance)
            np.add(u, self.disturbance, u)

    def _finish(self, position: Floats, u: Floats) -> bool:
        """Set the efforts of actuators that are disabled or not finite; store the values for the observer.

        False: some were not finite.
        """
        f = self.effort
        if self._observes:
            np.minimum(u, self.effort_limit, out=u)
            np.maximum(u, self._minus_effort, out=u)
            np.copyto(self.observer_input, u)
        if self._any_off:
            np.copyto(f, self.effort_when_off, where=self.off)
            np.copyto(self.position_error, self._zero, where=self.off)
            np.copyto(self.setpoint_position, position, where=self.off)
            self._rest(self.off)
        if self._any_effort:
            np.copyto(self.setpoint_position, position, where=self.effort_mode)
            self._rest(self.effort_mode)
        np.isfinite(f, self.finite)
        if b"\0" not in self.finite.tobytes():
            return True
        bad = ~self.finite
        f[bad] = 0.0
        for each in (self.integral, self.disturbance, self.observer_input, self.observer_state, self.filtered):
            each[bad] = 0.0
        return False

    def _rest(self, where: Flags) -> None:
        """Keep integral and observer from winding up while an actuator is off or in effort mode."""
        if self._integrates or self._observes:
            for each in (self.integral, self.disturbance, self.observer_input, self.observer_state):
                np.copyto(each, self._zero, where=where)
