"""Teleoperations of old console files: the same parameters, with other names."""

from __future__ import annotations

from collections.abc import Mapping

from tools.converters.keys import Keys

Json = dict[str, object]

_NUMBERS = {
    "scale": "scale",
    "start-orientation-tolerance": "start_orientation_tolerance",
    "start-gripper-threshold": "start_gripper_threshold",
    "start-roll-threshold": "start_roll_threshold",
    "jaw-rate": "jaw_rate",
    "jaw-rate-back-from-clutch": "jaw_rate_after_clutch",
}
_FLAGS = {
    "ignore-jaw": "ignore_jaw",
    "rotation-locked": "rotation_locked",
    "translation-locked": "translation_locked",
    "align-mtm": "align_MTM",
    "use-mtm-velocity": "use_MTM_linear_velocity",
}
_ALIGN = "arms are aligned by their base_frame today"


def psm_teleop(keys: Keys) -> Json:
    """One of `psm-teleops`."""
    row = _arms(keys, {"MTM": ("mtm", "master"), "PSM": ("psm", "slave")})
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
    row = _arms(keys, roles)
    _rotation(keys)
    parameters = keys.inside("configure-parameter")
    if parameters is not None:
        scale = parameters.number("scale")
        row |= {"configure_parameter": {"scale": scale}} if scale is not None else {}
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
        row[role] = keys.text(*names)
        if not row[role]:
            keys.report.error(keys.line(), keys.key(names[0]), "", "this key is required", "the name of an arm")
    kind = keys.text("type")
    row |= {"type": kind} if kind else {}
    period = keys.number("period")
    return row | ({"period": period} if period is not None else {})


def _parameters(keys: Keys) -> Json:
    row: Json = {}
    for old, new in _NUMBERS.items():
        number = keys.number(old)
        row |= {new: number} if number is not None else {}
    for old, new in _FLAGS.items():
        flag = keys.flag(old)
        row |= {new: flag} if flag is not None else {}
    scaling = keys.inside("gripper-scaling")
    if scaling is not None:
        given = {name: scaling.number(name) for name in ("zero", "max")}
        row["gripper_scaling"] = {name: number for name, number in given.items() if number is not None}
    _rotation(keys)
    return row


def _rotation(keys: Keys) -> None:
    """A rotation between master and slave: not said here any more."""
    rows = keys.take("rotation")
    if rows is None:
        return
    if rows == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]:
        keys.report.dropped(keys.line("rotation"), keys.key("rotation"), "identity", _ALIGN)
    else:
        keys.report.lost(keys.line("rotation"), keys.key("rotation"), "a matrix", f"{_ALIGN}: write theirs")
