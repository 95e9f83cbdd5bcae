"""Gravity-compensation files of masters (`gc-MTM*.json`, version "2.0"): parameters measured on that very arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from procs.lib.config.context import Context
from procs.lib.config.validate import Rows, Section
from procs.lib.master_gravity import MasterGravityParameters


class ControllerKeys(Section):
    """What holds the arm; the limits and start of the measurement are not needed for it."""

    gc_dynamic_params_pos: Rows[float]
    gc_dynamic_params_neg: Rows[float]
    safe_lower_torque_limit: Rows[float]
    safe_upper_torque_limit: Rows[float]
    db_vel_vec: Rows[float]
    sat_vec_vec: Rows[float]
    fric_comp_ratio_vec: Rows[float]
    GC_init_pos: Any = None
    joint_position_upper_limit: Any = None
    joint_position_lower_limit: Any = None


class GravityFile(Section):
    """The controller's part, and how it was measured."""

    version: Literal["2.0"]
    GC_controller: ControllerKeys
    ARM_NAME: str = ""
    SN: str = ""
    date_time: str = ""
    lse: Any = None
    GC_Test: Any = None


def load_master_gravity(context: Context, path: Path) -> MasterGravityParameters | None:
    """The parameters of one master; None with errors."""
    opened = context.open(GravityFile, path)
    if opened is None:
        return None
    keys = opened.content.GC_controller
    try:
        return MasterGravityParameters(
            positive=keys.gc_dynamic_params_pos, negative=keys.gc_dynamic_params_neg,
            lower=keys.safe_lower_torque_limit, upper=keys.safe_upper_torque_limit,
            dead_band=keys.db_vel_vec, saturation=keys.sat_vec_vec, friction=keys.fric_comp_ratio_vec)
    except ValueError as error:
        context.error(opened.source, ("GC_controller",), str(error), "what the measurement wrote")
        return None
