"""PID files (`saw-controllers-pid.schema.json`, version "1"): gains of every actuator of one robot."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from procs.lib.config.validate import Rows, Section


class PidKeys(Section):
    """One actuator; N·m/rad, N·m·s/rad or N/m, N·s/m."""

    index: int = Field(ge=0, le=15)
    name: str = Field(min_length=1)
    type: Literal["REVOLUTE", "PRISMATIC"]
    p_gain: float = Field(ge=0.0)
    d_gain: float = Field(ge=0.0)
    i_gain: float = Field(ge=0.0)
    p_deadband: float = Field(default=0.0, ge=0.0)
    p_deadband_outer: float = Field(default=0.0, ge=0.0)
    i_forget_rate: float = Field(default=1.0, ge=0.0, le=1.0, description="factor each cycle")
    i_limit: float = Field(default=0.0, ge=0.0)
    offset: float = 0.0
    pid_max_output: float = Field(default=0.0, description="negative: no limit")
    p_measured_setpoint_tolerance: float = Field(default=0.0, ge=0.0, description="rad or m")
    v_low_pass_cutoff: float = Field(default=1.0, gt=0.0, le=1.0, description="weight of the newest sample")
    use_disturbance_observer: bool = False
    nominal_mass: float = Field(default=0.0, ge=0.0)
    disturbance_cutoff: float = Field(default=0.0, ge=0.0)


class PidFile(Section):
    """The whole file."""

    id: Literal["saw-controllers-pid.schema.json"] = Field(alias="$id")
    version: Literal["1"] = Field(alias="$version")
    pid: Rows[PidKeys] = Field(min_length=1)
