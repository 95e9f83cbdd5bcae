"""THE TABLE of gains that can be changed while the robot runs: `PidAxis`, with a field and bounds for each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from trocar.procs.document.keys import Key, keys_in

LARGEST_STEP: Final = 10.0  # largest factor while the joint controller is on: more is likely a misplaced decimal point
LARGEST: Final = 1e6  # far above the gains of any arm, far below an overflow in computations
STIFF: Final = "too large a value makes the arm shake or jump"
HOLDS: Final = "too small a value lets the arm sink or swing"


@dataclass(frozen=True, slots=True)
class PidAxis:
    """Gains of one actuator, as in PID files; for their meaning and pitfalls see `procs/io/pid.py`."""

    name: Annotated[str, Key(min_length=1)]
    joint_type: Annotated[str, Key(name="type", choices=("REVOLUTE", "PRISMATIC"))]
    p_gain: Annotated[float, Key(0.0, LARGEST), STIFF, HOLDS]
    d_gain: Annotated[float, Key(0.0, LARGEST), STIFF, HOLDS]
    i_gain: Annotated[float, Key(0.0, LARGEST), STIFF]
    p_deadband: Annotated[float, Key(0.0, LARGEST)] = 0.0
    p_deadband_outer: Annotated[float, Key(0.0, LARGEST)] = 0.0
    i_forget_rate: Annotated[float, Key(0.0, 1.0, "factor each cycle")] = 1.0
    i_limit: Annotated[float, Key(0.0, LARGEST)] = 0.0
    offset: Annotated[float, Key(-LARGEST, LARGEST)] = 0.0
    pid_max_output: Annotated[float, Key(-LARGEST, LARGEST, "negative: no limit")] = 0.0
    tolerance: Annotated[float, Key(0.0, LARGEST, "rad or m", name="p_measured_setpoint_tolerance")] = 0.0
    v_low_pass_cutoff: Annotated[float, Key(0.0, 1.0, "weight of the newest sample", above=True)] = 1.0
    use_disturbance_observer: Annotated[bool, Key()] = False
    nominal_mass: Annotated[float, Key(0.0, LARGEST), STIFF] = 0.0
    disturbance_cutoff: Annotated[float, Key(0.0, LARGEST), STIFF] = 0.0


@dataclass(frozen=True, slots=True)
class Gain:
    """One gain: `key` is its name in PID files, topics and commands, `field` its name in `PidAxis`."""

    key: str
    field: str
    low: float
    high: float
    above: bool  # `low` itself is not allowed
    switch: bool  # 1 or 0
    stiff: bool  # too large a value makes the arm shake or jump
    holds: bool  # too small a value lets it sink or swing

    def wrong(self, value: float) -> str:
        """The allowed values if `value` is not allowed; otherwise empty."""
        if self.switch:
            return "" if value in (0.0, 1.0) else "1 (on) or 0 (off)"
        low, high, inside = self.low, self.high, math.isfinite(value) and self.low <= value <= self.high
        if inside and not (self.above and value == low):
            return ""
        return f"{'above' if self.above else 'from'} {low:g} up to {high:g}"


GAINS: Final = tuple(
    Gain(key.name or field.name, field.name, 0.0 if key.low is None else key.low,
         1.0 if key.high is None else key.high, key.above, hint.__origin__ is bool, STIFF in hint.__metadata__,
         HOLDS in hint.__metadata__)
    for field, hint, key in keys_in(PidAxis) if hint.__origin__ is not str)
BY_KEY: Final = {gain.key: gain for gain in GAINS}


def value_of(row: PidAxis, key: str) -> float:
    """A gain of an actuator by its key; switches as 1 and 0."""
    return float(getattr(row, BY_KEY[key].field))


def leap(before: PidAxis, after: PidAxis) -> str:
    """The first gain that stiffens the joint controller and grows by more than `LARGEST_STEP` at once; "" if none.

    Gains that were 0 are not checked.
    """
    for gain in GAINS:
        old, new = float(getattr(before, gain.field)), float(getattr(after, gain.field))
        if gain.stiff and old > 0.0 and new > LARGEST_STEP * old:
            return f"{gain.key} {new:g} is more than {LARGEST_STEP:g} times {old:g}"
    return ""


def drop(before: PidAxis, after: PidAxis) -> str:
    """The first gain that holds the arm and shrinks to less than 1/`LARGEST_STEP` at once; "" if none.

    A gain of 0 is not checked: it switches its term off, which is no misplaced decimal point.
    """
    for gain in GAINS:
        old, new = float(getattr(before, gain.field)), float(getattr(after, gain.field))
        if gain.holds and 0.0 < LARGEST_STEP * new < old:
            return f"{gain.key} {new:g} is less than 1/{LARGEST_STEP:g} of {old:g}"
    return ""


def changed(row: PidAxis, keys: Sequence[str], values: Sequence[float], *, running: bool) -> PidAxis:
    """`row` with new `values` for `keys`; ValueError gives the reason and the allowed values.

    While the joint controller is `running`, a `leap` or a `drop` is an error.
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
    if running and (step := leap(row, after) or drop(row, after)):
        raise ValueError(f"{step}; go there in smaller steps")
    return after
