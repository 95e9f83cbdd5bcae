"""THE TABLE of gains, which can be changed while the robot runs: key in PID files, place in `PidAxis`, what may be."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

LARGEST_STEP: Final = 10.0  # of what may grow while the joint controller is on: more is a slip of the decimal point


@dataclass(frozen=True, slots=True)
class PidAxis:
    """Gains of one actuator; meaning and traps: docs of `procs/io/pid.py`."""

    name: str
    joint_type: str
    p_gain: float
    d_gain: float
    i_gain: float
    p_deadband: float = 0.0
    p_deadband_outer: float = 0.0
    i_forget_rate: float = 1.0
    i_limit: float = 0.0
    offset: float = 0.0
    pid_max_output: float = 0.0
    tolerance: float = 0.0
    v_low_pass_cutoff: float = 1.0
    use_disturbance_observer: bool = False
    nominal_mass: float = 0.0
    disturbance_cutoff: float = 0.0


@dataclass(frozen=True, slots=True)
class Gain:
    """One gain: `key` is its name in PID files, topics and commands, `field` its name in `PidAxis`."""

    key: str
    field: str
    low: float = 0.0
    high: float = 1e6  # far above what any arm has, far below what overflows in a computation
    above: bool = False  # `low` itself is not allowed
    switch: bool = False  # 1 or 0
    stiff: bool = False  # too much of it shakes or throws the arm

    def wrong(self, value: float) -> str:
        """What is allowed, when `value` is not; empty when it is."""
        if self.switch:
            return "" if value in (0.0, 1.0) else "1 (on) or 0 (off)"
        low, high, inside = self.low, self.high, math.isfinite(value) and self.low <= value <= self.high
        if inside and not (self.above and value == low):
            return ""
        return f"{'above' if self.above else 'from'} {low:g} up to {high:g}"


GAINS: Final = (
    Gain("p_gain", "p_gain", stiff=True),
    Gain("d_gain", "d_gain", stiff=True),
    Gain("i_gain", "i_gain", stiff=True),
    Gain("p_deadband", "p_deadband"),
    Gain("p_deadband_outer", "p_deadband_outer"),
    Gain("i_forget_rate", "i_forget_rate", high=1.0),
    Gain("i_limit", "i_limit"),
    Gain("offset", "offset", low=-1e6),
    Gain("pid_max_output", "pid_max_output", low=-1e6),
    Gain("p_measured_setpoint_tolerance", "tolerance"),
    Gain("v_low_pass_cutoff", "v_low_pass_cutoff", high=1.0, above=True),
    Gain("use_disturbance_observer", "use_disturbance_observer", switch=True),
    Gain("nominal_mass", "nominal_mass", stiff=True),
    Gain("disturbance_cutoff", "disturbance_cutoff", stiff=True),
)
BY_KEY: Final = {gain.key: gain for gain in GAINS}


def value_of(row: PidAxis, key: str) -> float:
    """A gain of an actuator by its key; switches as 1 and 0."""
    return float(getattr(row, BY_KEY[key].field))


def leap(before: PidAxis, after: PidAxis) -> str:
    """A gain that stiffens the joint controller and grows more than `LARGEST_STEP` times at once; "": none does.

    Of a gain that was 0 nothing can be said.
    """
    for gain in GAINS:
        old, new = float(getattr(before, gain.field)), float(getattr(after, gain.field))
        if gain.stiff and old > 0.0 and new > LARGEST_STEP * old:
            return f"{gain.key} {new:g} is more than {LARGEST_STEP:g} times {old:g}"
    return ""


def changed(row: PidAxis, keys: Sequence[str], values: Sequence[float], *, running: bool) -> PidAxis:
    """`row` with other values for `keys`; ValueError says what is wrong with them and what is allowed.

    While the joint controller is `running` there is no `leap`.
    """
    new: dict[str, float | bool] = {}
    for key, value in zip(keys, values, strict=True):
        gain = BY_KEY.get(key)
        if gain is None:
            raise ValueError(f"no gain {key!r}; there are: {', '.join(BY_KEY)}")
        if gain.field in new:
            raise ValueError(f"{key} is given twice")
        allowed = gain.wrong(value)
        if allowed:
            raise ValueError(f"{key} {value:g}; allowed: {allowed}")
        new[gain.field] = bool(value) if gain.switch else float(value)
    after = dataclasses.replace(row, **new)  # type: ignore[arg-type]  # the table has only numbers and switches
    if running and (step := leap(row, after)):
        raise ValueError(f"{step}; go there in smaller steps")
    return after
