"""Names that today's software uses, where old files had others."""

from __future__ import annotations

import re

_EXACT = {
    "clutch": "clutch",
    "coag": "coag",
    "bicoag": "bicoag",
    "camera": "camera",
    "cam-": "focus_minus",
    "cam+": "focus_plus",
    "head": "head",
    "headsensorturnoff": "head_sensor_turn_off",
    "endoscopefocusin": "endoscope_focus_in",
    "endoscopefocusout": "endoscope_focus_out",
    "motorup": "motor_up",
    "motordown": "motor_down",
    "nomuxreset": "no_mux_reset",
    "muxreset": "mux_reset",
    "muxincrement": "mux_increment",
    "controlpwm": "control_PWM",
    "disablepwm": "disable_PWM",
    "enablepwm": "enable_PWM",
}
_PATTERNS = (
    (re.compile(r"HeadSensor([1-4])\Z", re.IGNORECASE), r"dv_head_sensor_\1"),
    (re.compile(r"SUJ-Clutch-([1-4])\Z", re.IGNORECASE), r"SUJ_clutch_\1"),
    (re.compile(r"(\w+)-ManipClutch\Z", re.IGNORECASE), r"\1_arm_clutch"),
    (re.compile(r"(\w+)-SUJClutch\Z", re.IGNORECASE), r"\1_SUJ_clutch"),
    (re.compile(r"(\w+)-SUJClutch2\Z", re.IGNORECASE), r"\1_SUJ_clutch_2"),
    (re.compile(r"(\w+)-SUJBrake\Z", re.IGNORECASE), r"\1_SUJ_brake"),
    (re.compile(r"(\w+)-Tool\Z", re.IGNORECASE), r"\1_tool"),
    (re.compile(r"(\w+)-Adapter\Z", re.IGNORECASE), r"\1_adapter"),
    (re.compile(r"(\w+)-Dallas\Z", re.IGNORECASE), r"\1_dallas"),
    (re.compile(r"(\w+)-Gripper\Z", re.IGNORECASE), r"\1_gripper"),
)
_NOT_ALLOWED = re.compile(r"[^A-Za-z0-9_-]")


def today(name: str) -> str:
    """The name that today's software looks for; of an unknown name, the characters that are allowed."""
    known = _EXACT.get(name.lower())
    if known:
        return known
    for pattern, new in _PATTERNS:
        if pattern.match(name):
            return pattern.sub(new, name)
    return plain(name)


def plain(name: str) -> str:
    """The name with `_` for every character that is allowed neither in names nor, safely, in those of files."""
    return _NOT_ALLOWED.sub("_", name)


def file_today(name: str) -> str:
    """The name of a file that was XML and is JSON now, in the same folder; stock files under their present names."""
    stem = re.sub(r"\.xml\Z", "", name, flags=re.IGNORECASE)
    if stem == name:
        return name
    stem = re.sub(r"(-foot-pedals)\Z", r"\1-QLA1", stem)
    return f"{stem}.json"
