"""The joint controller against its law written down for one actuator after the other, whatever it is told meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from random import Random

import numpy as np
import pytest

from tests.io.harness import pid_step
from trocar.procs.document.system import PidAxis
from trocar.procs.io.pid import Pid

DT_S = 1 / 1500
ALL = slice(None)


def axis(**changes: float | bool) -> PidAxis:
    values = {"name": "a", "joint_type": "REVOLUTE", "p_gain": 2.0, "d_gain": 0.3, "i_gain": 0.0,
              "pid_max_output": -1.0, "tolerance": 0.05} | changes
    return PidAxis(**values)  # type: ignore[arg-type]


PLAIN = axis()
DEAD = axis(p_deadband=0.02, d_gain=0.2)
SOFT = axis(p_deadband=0.02, p_deadband_outer=0.06, offset=0.05, tolerance=0.0)
FILTERED = axis(v_low_pass_cutoff=0.3, pid_max_output=0.15)
INTEGRAL = axis(i_gain=0.4, i_forget_rate=0.98, i_limit=0.2, pid_max_output=0.0)
OBSERVED = axis(use_disturbance_observer=True, nominal_mass=0.4, disturbance_cutoff=30.0)
ALL_OF_IT = axis(p_deadband=0.01, p_deadband_outer=0.03, v_low_pass_cutoff=0.5, i_gain=0.2, i_limit=0.5, offset=-0.02,
                 use_disturbance_observer=True, nominal_mass=0.1, disturbance_cutoff=60.0, pid_max_output=0.4)
GAINS = (PLAIN, DEAD, SOFT, FILTERED, INTEGRAL, OBSERVED, ALL_OF_IT)
GROUPS = {"plain": (PLAIN, None, PLAIN), "dead": (PLAIN, DEAD), "soft": (DEAD, SOFT, PLAIN),
          "filtered": (FILTERED, PLAIN), "integral": (INTEGRAL, PLAIN), "observed": (OBSERVED, PLAIN),
          "offset": (axis(offset=-0.02), PLAIN), "forgetful": (axis(i_gain=-0.1, i_limit=0.3, i_forget_rate=0.5),),
          "soft alone": (axis(p_deadband_outer=0.05),), "all": (None, *GAINS)}


@dataclass
class Actuator:
    """One actuator by the words of the module's docstring."""

    row: PidAxis
    limit: float
    controlled: bool
    enabled: bool = False
    checked: bool = False
    in_effort: bool = False
    has_velocity: bool = False
    setpoint: float = 0.0
    speed: float = 0.0
    asked: float = 0.0
    feed: float = 0.0
    integral: float = 0.0
    observer: float = 0.0
    before: float = 0.0
    filtered: float = 0.0
    effort: float = 0.0
    error: float = 0.0

    def forget(self) -> None:
        self.integral = self.observer = self.before = 0.0

    def enable(self, on: bool, position: float) -> None:
        self.enabled, self.setpoint = self.controlled and on, position
        self.in_effort = self.has_velocity = False
        self.speed = self.asked = self.feed = self.filtered = self.effort = self.error = 0.0
        self.forget()

    def configure(self, row: PidAxis, velocity: float) -> None:
        self.integral *= self.row.i_gain / row.i_gain if row.i_gain else 0.0
        self.observer += (momentum(row) - momentum(self.row)) * velocity
        if not row.use_disturbance_observer:
            self.observer = self.before = 0.0
        self.row = row

    def step(self, position: float, velocity: float, contribution: float, *, at_limit: bool, observed: bool) -> bool:
        """One cycle; whether the tracking error is beyond what is allowed. `observed`: disturbances are, of any."""
        row, error = self.row, self.setpoint - position
        excess, inside = self.shortened(abs(error))
        follows = self.enabled and not self.in_effort
        allowed = row.tolerance if self.checked else math.inf
        beyond = follows and not excess <= allowed and not (at_limit and math.isfinite(excess))
        error = 0.0 if self.in_effort else math.copysign(excess, error)
        if not inside:
            new = row.v_low_pass_cutoff
            self.filtered = ((1.0 - new) * self.filtered + new * self.speed) * self.has_velocity
        u = row.p_gain * error + (0.0 if inside else row.d_gain * (self.filtered - velocity))
        self.integral = clamped(self.integral * row.i_forget_rate + error, row.i_limit)
        u += row.i_gain * self.integral
        if row.use_disturbance_observer:
            mass = momentum(row) * velocity
            self.observer += (self.before + mass - self.observer) * row.disturbance_cutoff * DT_S
            u += self.observer - mass
        u = clamped(u, row.pid_max_output) if row.pid_max_output >= 0.0 else u
        effort = clamped((self.asked if self.in_effort else u + row.offset) + self.feed + contribution, self.limit)
        self.before, self.error = clamped(u, self.limit) if observed else self.before, error
        if not self.enabled:
            effort = self.error = 0.0
        if not self.enabled or self.in_effort:
            self.setpoint = position
            self.forget()
        if not math.isfinite(effort):
            effort = self.filtered = 0.0
            self.forget()
        self.effort = effort
        return beyond

    def shortened(self, size: float) -> tuple[float, bool]:
        """The size of an error after the dead-band, and whether it is in it."""
        inner, outer = self.row.p_deadband, max(self.row.p_deadband, self.row.p_deadband_outer)
        excess = size - inner if not size <= inner else 0.0
        if outer > inner:
            share = min(1.0, excess / (outer - inner)) if not math.isnan(excess) else excess
            excess *= share * share * (3.0 - 2.0 * share)
        return excess, size < inner


def momentum(row: PidAxis) -> float:
    return row.nominal_mass * row.disturbance_cutoff * row.use_disturbance_observer


def clamped(value: float, most: float) -> float:
    return value if math.isnan(value) else max(-most, min(most, value))


class Bench:
    """A controller and its model, told the same."""

    def __init__(self, rows: tuple[PidAxis | None, ...], chance: Random) -> None:
        limits = np.array([0.5 * (place % 3) for place in range(len(rows))])  # 0: none
        self.chance, self.n = chance, len(rows)
        self.pid = Pid(rows, limits, DT_S)
        self.model = [Actuator(row or PidAxis("", "UNDEFINED", 0.0, 0.0, 0.0), limit or math.inf, row is not None)
                      for row, limit in zip(rows, limits.tolist(), strict=True)]
        self.contribution = self.pid.contribute() if chance.random() < 0.5 else np.zeros(self.n)

    def tell(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Something else than setpoints."""
        chance, pid, model = self.chance, self.pid, self.model
        which, on = np.array([chance.random() < 0.5 for _ in model]), chance.random() < 0.6
        chosen = [(place, actuator) for place, actuator in enumerate(model) if which[place]]
        match chance.randrange(9):
            case 0:
                pid.enable(which, on, position)
                for place, actuator in chosen:
                    actuator.enable(on, float(position[place]))
            case 1 | 2:
                pid.use_effort(which, on)
                for _, actuator in chosen:
                    actuator.in_effort = on
            case 3 | 4:
                pid.carry_velocity(which, on)
                for _, actuator in chosen:
                    actuator.has_velocity = on
                    if not on:
                        actuator.speed = actuator.filtered = 0.0
            case 5 | 6:
                pid.check_tracking(which, on)
                for _, actuator in chosen:
                    actuator.checked = on
            case _:
                rows = {place: chance.choice((*GAINS, *(replace(actuator.row, i_gain=actuator.row.i_gain * 2),) * 5))
                        for place, actuator in chosen if actuator.controlled}
                pid.configure(rows, velocity)
                for place, row in rows.items():
                    model[place].configure(row, float(velocity[place]))

    def ask(self) -> None:
        """Other setpoints."""
        for place, actuator in enumerate(self.model):
            actuator.setpoint, actuator.speed, actuator.asked, actuator.feed = (
                self.chance.choice((0.0, 0.015, -0.04, 0.3)), self.chance.choice((0.0, 0.1, -0.3)),
                self.chance.choice((0.0, 0.2, -2.0)), self.chance.choice((0.0, 0.0, 0.1)))
            self.pid.setpoint_position[place], self.pid.setpoint_velocity[place] = actuator.setpoint, actuator.speed
            self.pid.requested_effort[place], self.pid.feed_forward[place] = actuator.asked, actuator.feed

    def step(self) -> None:
        chance = self.chance
        position = np.array([chance.choice((0.0, 0.01, 0.02, -0.05)) for _ in self.model])
        velocity = np.array([chance.choice((0.0, 0.1, -0.2)) for _ in self.model])
        if chance.random() < 0.03:
            position[chance.randrange(self.n)] = chance.choice((math.nan, math.inf))
        at_limit = np.array([chance.random() < 0.2 for _ in self.model])
        if chance.random() < 0.15:
            self.tell(np.nan_to_num(position, posinf=0.0), velocity)
        if chance.random() < 0.3:
            self.ask()
        self.contribution[...] = [chance.choice((0.0, 0.05)) for _ in self.model]
        added = self.contribution if self.contribution is self.pid.contribution else np.zeros(self.n)
        with np.errstate(invalid="ignore"):
            tripped = pid_step(self.pid, position, velocity, at_limit)
        observed = any(actuator.row.use_disturbance_observer for actuator in self.model)
        measured = zip(position.tolist(), velocity.tolist(), added.tolist(), at_limit.tolist(), strict=True)
        expected = [actuator.step(p, v, more, at_limit=limited, observed=observed)
                    for actuator, (p, v, more, limited) in zip(self.model, measured, strict=True)]
        assert (tripped.tolist() if tripped is not None else [False] * self.n) == expected
        for name, array in (("effort", self.pid.effort), ("setpoint", self.pid.setpoint_position),
                            ("error", self.pid.position_error), ("filtered", self.pid.filtered)):
            wanted = [getattr(actuator, name) for actuator in self.model]
            assert array == pytest.approx(np.array(wanted), abs=1e-12, nan_ok=True), name


@pytest.mark.parametrize("group", GROUPS)
def test_the_law_holds_for_each_actuator_whatever_the_others_do(group: str) -> None:
    bench = Bench(GROUPS[group], Random(group))
    bench.pid.enable(ALL, True, np.zeros(bench.n))
    for actuator in bench.model:
        actuator.enable(True, 0.0)
    for _ in range(300):
        bench.step()
