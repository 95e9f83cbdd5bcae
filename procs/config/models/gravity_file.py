"""Gravity-compensation files of masters (`gc-MTM*.json`, version "2.0"): parameters measured on the individual arm."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, Final, Literal

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document.arms import GRAVITY_PARAMETERS, MASTER_JOINTS, MasterGravityParameters


class GravityControllerKeys(Section):
    """Parameters for gravity compensation; the limits and start of the measurement are not used."""

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
    """The whole file: parameters of the controller, and data of the measurement."""

    version: Literal["2.0"]
    GC_controller: GravityControllerKeys
    ARM_NAME: str = ""
    SN: str = ""
    date_time: str = ""
    lse: Any = None
    GC_Test: Any = None


FIELDS: Final = {
    "gc_dynamic_params_pos": "positive",
    "gc_dynamic_params_neg": "negative",
    "safe_lower_torque_limit": "lower",
    "safe_upper_torque_limit": "upper",
    "db_vel_vec": "dead_band",
    "sat_vec_vec": "saturation",
    "fric_comp_ratio_vec": "friction",
}
"""Fields of the document by key."""
LENGTHS: Final = {key: GRAVITY_PARAMETERS if key.startswith("gc_") else MASTER_JOINTS for key in FIELDS}


def load_master_gravity(context: Context, path: Path, arms: Collection[str] = (), serial: str = "") -> \
        MasterGravityParameters | None:
    """The parameters of one master; None with errors. A warning if not measured on that of these names, this serial."""
    opened = context.open(GravityFile, path)
    if opened is None or not _check(opened):
        return None
    measured, keys = opened.content, opened.content.GC_controller
    if serial and measured.SN and serial != measured.SN:
        opened.warning(("SN",), "measured on another arm", serial)
    elif arms and measured.ARM_NAME and measured.ARM_NAME not in arms and not (serial and measured.SN):
        opened.warning(("ARM_NAME",), "measured on another arm", " or ".join(arms))
    return MasterGravityParameters(**{field: getattr(keys, key) for key, field in FIELDS.items()})


def _check(opened: Opened[GravityFile]) -> bool:
    """Check lengths of lists, and the order of limits and velocities; reports the first wrong joint of each."""
    keys = opened.content.GC_controller
    wrong = [key for key, count in LENGTHS.items() if len(getattr(keys, key)) != count]
    for key in wrong:
        opened.error(("GC_controller", key), f"{len(getattr(keys, key))} numbers", f"{LENGTHS[key]} numbers")
    if wrong:
        return False
    limits = list(zip(keys.safe_lower_torque_limit, keys.safe_upper_torque_limit, strict=True))
    bands = list(zip(keys.db_vel_vec, keys.sat_vec_vec, strict=True))
    crossed = next((joint for joint, (low, high) in enumerate(limits) if low > high), None)
    if crossed is not None:
        where = ("GC_controller", "safe_lower_torque_limit", crossed)
        opened.error(where, "is above the upper limit", f"at most {limits[crossed][1]}")
    empty = next((joint for joint, (low, high) in enumerate(bands) if not 0.0 <= low < high), None)
    if empty is not None:
        opened.error(("GC_controller", "db_vel_vec", empty), "is no dead band", f"from 0 to below {bands[empty][1]}")
    return crossed is None and empty is None
