"""Gravity-compensation files of masters (`gc-MTM*.json`, version "2.0"): parameters measured on that very arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Literal

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document.gravity_parameters import JOINTS, PARAMETERS, MasterGravityParameters


class GravityControllerKeys(Section):
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
    GC_controller: GravityControllerKeys
    ARM_NAME: str = ""
    SN: str = ""
    date_time: str = ""
    lse: Any = None
    GC_Test: Any = None


LENGTHS: Final = {
    "gc_dynamic_params_pos": PARAMETERS,
    "gc_dynamic_params_neg": PARAMETERS,
    "safe_lower_torque_limit": JOINTS,
    "safe_upper_torque_limit": JOINTS,
    "db_vel_vec": JOINTS,
    "sat_vec_vec": JOINTS,
    "fric_comp_ratio_vec": JOINTS,
}


def load_master_gravity(context: Context, path: Path) -> MasterGravityParameters | None:
    """The parameters of one master; None with errors."""
    opened = context.open(GravityFile, path)
    if opened is None or not _check(opened):
        return None
    keys = opened.content.GC_controller
    return MasterGravityParameters(
        positive=keys.gc_dynamic_params_pos, negative=keys.gc_dynamic_params_neg,
        lower=keys.safe_lower_torque_limit, upper=keys.safe_upper_torque_limit,
        dead_band=keys.db_vel_vec, saturation=keys.sat_vec_vec, friction=keys.fric_comp_ratio_vec)


def _check(opened: Opened[GravityFile]) -> bool:
    """Whether every list has its length, and limits and velocities are in order; the first joint that is not."""
    keys = opened.content.GC_controller
    wrong = [name for name, count in LENGTHS.items() if len(getattr(keys, name)) != count]
    for name in wrong:
        text, allowed = f"{len(getattr(keys, name))} numbers", f"{LENGTHS[name]} numbers"
        opened.error(("GC_controller", name), text, allowed)
    if wrong:
        return False
    fine = True
    ordered = (("safe_lower_torque_limit", keys.safe_lower_torque_limit, keys.safe_upper_torque_limit, "at most"),
               ("db_vel_vec", keys.db_vel_vec, keys.sat_vec_vec, "from 0 to below"))
    for name, lows, highs, words in ordered:
        for joint, (low, high) in enumerate(zip(lows, highs, strict=True)):
            if low > high or (words != "at most" and not 0.0 <= low < high):
                above = "is above the upper limit" if words == "at most" else "is no dead band"
                opened.error(("GC_controller", name, joint), above, f"{words} {high}")
                fine = False
                break
    return fine
