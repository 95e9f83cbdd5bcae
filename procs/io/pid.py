"""The joint controller: one PID law over n actuators at once, in place.

Per actuator with measured p, v and setpoint sp, fv:

    e = sp − p, shortened by the dead-band (soft up to the outer one); inside it e = 0 and there is no damping
    ve = fv − v, fv the low-passed velocity feed, 0 unless setpoints carry velocity and it is used
    I = clamp(I · forget + e, ± i_limit)                      per cycle, no time step
    D = observed disturbance: t = u_before + m·g·v, S += (t − S)·g·dt, D = S − m·g·v
    u = D + Kp·e + Kd·ve + Ki·I, clamped to ± pid_max_output when that is ≥ 0 (0, the default of files: no effort)
    f = u + offset + feed-forward + contribution, clamped to the effort limits

The contribution is what in-cycle tasks add. In effort mode f = requested effort + feed-forward + contribution. A
disabled actuator has f = 0 and its setpoint follows p, so that enabling starts without a step. Enabling clears
integral, observer and velocity filter. What is not finite counts as too large a tracking error, and an effort that is
not finite leaves as 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from procs.document.system import PidAxis

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Pid:
    """State and gains of n actuators. Inputs and results are arrays (n,) that stay the same objects.

    A caller writes `setpoint_position`, `setpoint_velocity`, `requested_effort` and `feed_forward`, sets modes through
    the methods, calls `step` once a cycle, and reads `effort` and `position_error`.
    """

    def __init__(
        self, axes: Sequence[PidAxis | None], effort_limit: Floats, dt_s: float, *,
        arrays: tuple[Floats, Floats, Floats, Floats, Flags] | None = None,
    ) -> None:
        """`axes` in actuator order, None where there is no controller (never enabled); `effort_limit` (n,) symmetric.

        `arrays` lets setpoint position, velocity, effort, position error and effort mode live in somebody else's
        memory (a ring's record). `dt_s` is the period the observer integrates with.
        """
        n = len(axes)
        self.gains = [a or PidAxis("", "UNDEFINED", 0.0, 0.0, 0.0) for a in axes]
        self._dt_s = dt_s
        self.controlled: Flags = np.array([a is not None for a in axes], dtype=bool)
        memory = arrays or (np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, dtype=bool))
        self.setpoint_position: Floats = memory[0]
        self.setpoint_velocity: Floats = memory[1]
        self.effort: Floats = memory[2]
        self.position_error: Floats = memory[3]
        self.effort_mode: Flags = memory[4]
        self.requested_effort, self.feed_forward = np.zeros(n), np.zeros(n)
        self.contribution: Floats | None = None  # of in-cycle tasks; None: there are none
        self.enabled: Flags = np.zeros(n, dtype=bool)
        self.integral, self.disturbance = np.zeros(n), np.zeros(n)
        limited = effort_limit > 0.0
        self._effort_limit = np.where(limited, effort_limit, np.inf)
        self._minus_effort = -self._effort_limit
        self._observer_input, self._observer_state = np.zeros(n), np.zeros(n)
        self._has_velocity, self._checked = np.zeros(n), np.zeros(n, dtype=bool)
        self._filtered = np.zeros(n)
        self._allowed = np.full(n, np.inf)
        self._a, self._b, self._x, self._f = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        self._inside, self._ok = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._off = np.ones(n, dtype=bool)
        self._zero, self._one = np.zeros(n), np.ones(n)
        self._three, self._minus_two = np.full(n, 3.0), np.full(n, -2.0)
        self._any_off, self._any_effort = True, False
        self._adopt()

    def _adopt(self) -> None:
        """Arrays of what `gains` say."""
        rows, n = self.gains, len(self.gains)

        def column(name: str) -> Floats:
            return np.array([float(getattr(row, name)) for row in rows])

        self.tolerance = column("tolerance")
        self._kp, self._kd, self._ki, self._offset = (column(c) for c in ("p_gain", "d_gain", "i_gain", "offset"))
        self._has_offset = bool(np.any(self._offset != 0.0))
        self._inner = column("p_deadband")
        outer = np.maximum(column("p_deadband_outer"), self._inner)
        width = outer - self._inner
        self._dead = bool(np.any(outer > 0.0))
        self._soft = bool(np.any(width > 0.0))
        self._per_width = np.full(n, np.inf)
        np.divide(1.0, width, out=self._per_width, where=width > 0.0)
        self._keep = column("i_forget_rate")
        self._i_limit = column("i_limit")
        self._integrates = bool(np.any(self._ki != 0.0))
        self._new, self._old = column("v_low_pass_cutoff"), 1.0 - column("v_low_pass_cutoff")
        self._filters = bool(np.any(self._old != 0.0))
        output = column("pid_max_output")
        self._output_limit = np.where(output >= 0.0, output, np.inf)
        self._minus_output = -self._output_limit
        self._limits_output = bool(np.any(output >= 0.0))
        observed = column("use_disturbance_observer")
        self._observes = bool(np.any(observed))
        self._momentum = column("nominal_mass") * column("disturbance_cutoff") * observed
        self._rate = column("disturbance_cutoff") * self._dt_s * observed

    def configure(self, changes: Mapping[int, PidAxis], velocity: Floats) -> None:
        """Other gains for some actuators from the next `step` on; `velocity` (n,) is the measured one.

        What the controller remembers goes on from the effort it had: the integral is rescaled, the observed disturbance
        stays. What acts on the present error (gains, dead-bands, offset, limits) acts with its new value at once, and
        an integral or observer that is switched off lets go.
        """
        momentum = self._momentum
        for axis, row in changes.items():
            before, self.gains[axis] = self.gains[axis], row
            self.integral[axis] *= before.i_gain / row.i_gain if row.i_gain else 0.0
        self._adopt()
        self._inside[...] = False  # nobody fills it where the last dead-band has gone
        for axis, row in changes.items():
            if row.use_disturbance_observer:
                self._observer_state[axis] += (self._momentum[axis] - momentum[axis]) * velocity[axis]
            else:
                self._observer_state[axis] = self._observer_input[axis] = self.disturbance[axis] = 0.0
        self._modes_changed()

    def enable(self, axes: slice | Flags, on: bool, position: Floats) -> None:
        """Switch the actuators `axes` on or off at measured `position` (n,); always starts from a clean state."""
        self.enabled[axes] = self.controlled[axes] & on
        for each in (self.integral, self.disturbance, self._observer_input, self._observer_state, self._filtered,
                     self._has_velocity, self.feed_forward, self.requested_effort, self.setpoint_velocity,
                     self.position_error, self.effort):
            each[axes] = 0.0
        self.effort_mode[axes] = False
        self.setpoint_position[axes] = position[axes]
        self._modes_changed()

    def use_effort(self, axes: slice | Flags, on: bool | Flags) -> None:
        """Pass efforts through (True) or follow positions."""
        self.effort_mode[axes] = on
        self._modes_changed()

    def carry_velocity(self, axes: slice | Flags, on: bool) -> None:
        """Whether the setpoint velocities are to be used; starts the filter afresh when they are not."""
        self._has_velocity[axes] = float(on)
        if not on:
            self._filtered[axes] = 0.0
            self.setpoint_velocity[axes] = 0.0

    def check_tracking(self, axes: slice | Flags, on: bool) -> None:
        """Trip on too large a tracking error."""
        self._checked[axes] = on
        self._modes_changed()

    def _modes_changed(self) -> None:
        self._off = ~self.enabled
        self._any_off = bool(np.any(self._off))
        self._any_effort = bool(np.any(self.effort_mode))
        watched = self._checked & self.enabled & ~self.effort_mode
        self._allowed = np.where(watched, self.tolerance, np.inf)

    def step(self, position: Floats, velocity: Floats, at_limit: Flags) -> Flags | None:
        """One cycle on the measured values (n,): fills `effort` and `position_error`.

        Returns None, or flags (n,) of actuators whose tracking error (after the dead-band) is above its tolerance;
        those whose setpoint was clipped `at_limit` are exempt. The caller decides what to switch off.
        """
        e, u = self.position_error, self._f
        np.subtract(self.setpoint_position, position, e)
        excess = self._dead_band(e)
        np.less_equal(excess, self._allowed, self._ok)
        tripped = None if b"\0" not in self._ok.tobytes() else self._tripped(at_limit)
        if self._any_effort:
            np.copyto(e, self._zero, where=self.effort_mode)
        ve = self._velocity_error(velocity)
        np.multiply(self._kp, e, u)
        np.multiply(self._kd, ve, ve)
        np.add(u, ve, u)
        self._integral_and_observer(e, velocity, u)
        if self._limits_output:
            np.minimum(u, self._output_limit, out=u)
            np.maximum(u, self._minus_output, out=u)
        f = self.effort
        if self._has_offset or self._any_effort:
            np.add(u, self._offset, f)
            if self._any_effort:
                np.copyto(f, self.requested_effort, where=self.effort_mode)
            np.add(f, self.feed_forward, f)
        else:
            np.add(u, self.feed_forward, f)
        if self.contribution is not None:
            np.add(f, self.contribution, f)
        np.minimum(f, self._effort_limit, out=f)
        np.maximum(f, self._minus_effort, out=f)
        self._finish(position, u)
        return tripped

    def _dead_band(self, e: Floats) -> Floats:
        """Shorten the errors `e` in place; returns their magnitude. Fills `_inside`, where there is any dead-band."""
        a, excess = self._a, self._b
        if not self._dead:
            return np.absolute(e, excess)
        np.absolute(e, a)
        np.less(a, self._inner, self._inside)
        np.subtract(a, self._inner, excess)
        np.maximum(excess, self._zero, out=excess)
        if self._soft:
            # x²(3 − 2x) rises from 0 to 1 between the dead-bands; without an outer one x is 1 at once
            x = self._x
            with np.errstate(invalid="ignore"):  # 0 · inf exactly on a hard edge: fmin turns the NaN into 1
                np.multiply(excess, self._per_width, x)
            np.fmin(x, self._one, out=x)
            np.multiply(excess, x, excess)
            np.multiply(excess, x, excess)
            np.multiply(x, self._minus_two, x)
            np.add(x, self._three, x)
            np.multiply(excess, x, excess)
        np.copysign(excess, e, e)
        return excess

    def _velocity_error(self, velocity: Floats) -> Floats:
        """Velocity feed minus measured velocity, 0 inside the dead-band; the filter rests there."""
        ve, fed, x = self._a, self._filtered, self._x
        if not (self._filters or self._dead):
            np.multiply(self.setpoint_velocity, self._has_velocity, fed)
            return np.subtract(fed, velocity, ve)
        if self._filters:
            np.multiply(self._old, fed, ve)
            np.multiply(self._new, self.setpoint_velocity, x)
            np.add(ve, x, x)
        else:
            np.copyto(x, self.setpoint_velocity)
        np.multiply(x, self._has_velocity, x)
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
            np.multiply(i, self._keep, i)
            np.add(i, e, i)
            np.minimum(i, self._i_limit, out=i)
            np.maximum(i, -self._i_limit, out=i)
            np.multiply(i, self._ki, x)
            np.add(u, x, u)
        if self._observes:
            state, step = self._observer_state, self._b
            np.multiply(self._momentum, velocity, x)
            np.add(self._observer_input, x, step)
            np.subtract(step, state, step)
            np.multiply(step, self._rate, step)
            np.add(state, step, state)
            np.subtract(state, x, self.disturbance)
            np.add(u, self.disturbance, u)

    def _finish(self, position: Floats, u: Floats) -> None:
        """Switch off what is disabled or not finite; remember what the observer needs."""
        f = self.effort
        if self._observes:
            np.minimum(u, self._effort_limit, out=u)
            np.maximum(u, self._minus_effort, out=u)
            np.copyto(self._observer_input, u)
        if self._any_off:
            np.copyto(f, self._zero, where=self._off)
            np.copyto(self.position_error, self._zero, where=self._off)
            np.copyto(self.setpoint_position, position, where=self._off)
            self._rest(self._off)
        if self._any_effort:
            np.copyto(self.setpoint_position, position, where=self.effort_mode)
            self._rest(self.effort_mode)
        np.isfinite(f, self._ok)
        if b"\0" in self._ok.tobytes():
            bad = ~self._ok
            f[bad] = 0.0
            for each in (self.integral, self.disturbance, self._observer_input, self._observer_state, self._filtered):
                each[bad] = 0.0

    def _rest(self, where: Flags) -> None:
        """Nothing winds up while an actuator is off or in effort mode."""
        if self._integrates or self._observes:
            for each in (self.integral, self.disturbance, self._observer_input, self._observer_state):
                np.copyto(each, self._zero, where=where)

    def _tripped(self, at_limit: Flags) -> Flags | None:
        """Actuators beyond their tolerance; an error that is not a number is no excuse at a limit."""
        beyond: Flags = ~self._ok & self.enabled & ~self.effort_mode
        beyond &= ~(at_limit & np.isfinite(self._b))
        return beyond if bool(np.any(beyond)) else None
