"""PID files (`saw-controllers-pid.schema.json`, version "1"): gains of every actuator of one robot."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from trocar.procs.config.read.validate import Rows, Section, VersionAsText
from trocar.procs.document.gains import BY_KEY


def _gain(key: str, default: Any = ..., description: str = "") -> Any:
    """A field with the limits that the table of gains has for this key: files and `pid set` allow the same."""
    row = BY_KEY[key]
    lower: dict[str, Any] = {"gt": row.low} if row.above else {"ge": row.low}
    return Field(default=default, le=row.high, description=description or None, **lower)


class PidKeys(Section):
    """One actuator; N·m/rad, N·m·s/rad or N/m, N·s/m."""

    index: int = Field(ge=0, le=15)
    name: str = Field(min_length=1)
    type: Literal["REVOLUTE", "PRISMATIC"]
    p_gain: float = _gain("p_gain")
    d_gain: float = _gain("d_gain")
    i_gain: float = _gain("i_gain")
    p_deadband: float = _gain("p_deadband", 0.0)
    p_deadband_outer: float = _gain("p_deadband_outer", 0.0)
    i_forget_rate: float = _gain("i_forget_rate", 1.0, "factor each cycle")
    i_limit: float = _gain("i_limit", 0.0)
    offset: float = _gain("offset", 0.0)
    pid_max_output: float = _gain("pid_max_output", 0.0, "negative: no limit")
    p_measured_setpoint_tolerance: float = _gain("p_measured_setpoint_tolerance", 0.0, "rad or m")
    v_low_pass_cutoff: float = _gain("v_low_pass_cutoff", 1.0, "weight of the newest sample")
    use_disturbance_observer: bool = False
    nominal_mass: float = _gain("nominal_mass", 0.0)
    disturbance_cutoff: float = _gain("disturbance_cutoff", 0.0)


class PidFile(Section):
    """The whole file."""

    id: Literal["saw-controllers-pid.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(alias="$version")
    pid: Rows[PidKeys] = Field(min_length=1)
