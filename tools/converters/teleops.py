"""Teleoperations of old console files: the same parameters, with other names."""

from __future__ import annotations

from collections.abc import Mapping

from trocar.procs.config.models.system_file import (
    GripperScalingKeys,
    TeleopEcmKeys,
    TeleopEcmParameters,
    TeleopPsmKeys,
    TeleopPsmParameters,
)
from trocar.tools.converters.keys import Keys
from trocar.tools.converters.report import Json

_INSIDE = ("configure_parameter", "PSM_base_frame")
_ALIGN = "arms are aligned by their base_frame today"


def psm_teleop(keys: Keys) -> Json:
    """One of `psm-teleops`."""
    row = _arms(keys, {"MTM": ("mtm", "master"), "PSM": ("psm", "slave")}) | keys.read(TeleopPsmKeys, skip=_INSIDE)
    frame = keys.inside("psm-base-frame")
    if frame is not None:
        row["PSM_base_frame"] = {"component": frame.text("component"), "interface": interface(frame)}
    parameters = keys.inside("configure-parameter")
    _rotation(keys)
    if parameters is not None:
        given = _parameters(parameters)
        row |= {"configure_parameter": given} if given else {}
    return row


def ecm_teleop(keys: Keys) -> Json:
    """`ecm-teleop`."""
    roles = {"MTML": ("mtm-left", "master-left"), "MTMR": ("mtm-right", "master-right"), "ECM": ("ecm", "slave")}
    row = _arms(keys, roles) | keys.read(TeleopEcmKeys, skip=_INSIDE)
    _rotation(keys)
    parameters = keys.inside("configure-parameter")
    if parameters is not None:
        given = parameters.read(TeleopEcmParameters)
        row |= {"configure_parameter": given} if given else {}
        parameters.drop("ignore-jaw", "an endoscope has no jaw")
        _rotation(parameters)
    return row


def interface(keys: Keys) -> str:
    """The interface of a component; arms called theirs `Robot` once."""
    old = keys.text("interface")
    if old != "Robot":
        return old
    keys.converted("interface", old, "Arm", "today's name")
    return "Arm"


def _arms(keys: Keys, roles: Mapping[str, tuple[str, ...]]) -> Json:
    row: Json = {}
    for role, names in roles.items():
        row[role] = keys.text(*names, role)
        if not row[role]:
            keys.report.error(keys.line(), keys.key(names[0]), "", "this key is required", "the name of an arm")
    return row


def _parameters(keys: Keys) -> Json:
    row = keys.read(TeleopPsmParameters, skip=("gripper_scaling",), jaw_rate_after_clutch="jaw-rate-back-from-clutch",
                    align_MTM="align-mtm", use_MTM_linear_velocity="use-mtm-velocity")
    scaling = keys.inside("gripper-scaling")
    if scaling is not None:
        row["gripper_scaling"] = scaling.read(GripperScalingKeys)
    _rotation(keys)
    return row


def _rotation(keys: Keys) -> None:
    """A rotation between master and slave: no longer part of this file."""
    rows = keys.take("rotation")
    if rows is None:
        return
    if rows == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]:
        keys.report.dropped(keys.line("rotation"), keys.key("rotation"), "identity", _ALIGN)
    else:
        keys.report.lost(keys.line("rotation"), keys.key("rotation"), "a matrix", f"{_ALIGN}: write theirs")
