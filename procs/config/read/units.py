"""Warnings for positions that are likely in another unit than that of the files: degrees for rad, mm for m."""

from __future__ import annotations

import math
from typing import Final

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.read.problem import KeyPath

REVOLUTE: Final = "REVOLUTE"
PRISMATIC: Final = "PRISMATIC"
FRAME: Final = "FRAME"
_DOUBTS: Final = {REVOLUTE: (4.0 * math.pi, "rad", "degrees"), PRISMATIC: (2.0, "m", "mm"), FRAME: (10.0, "m", "mm")}
"""By joint type, and for frames, which may be across a room: a larger number is in doubt; the unit of files, and that
in which it may be instead."""


def check_unit(opened: Opened[object], key: KeyPath, value: float, joint_type: str) -> None:
    """Warn if a position of a joint of this type, or a part of it, is so large that its unit is in doubt."""
    doubt = _DOUBTS.get(joint_type.upper())
    if doubt is not None and abs(value) > doubt[0]:
        largest, unit, other = doubt
        opened.warning(key, f"{value:g} {unit}: is this in {other}?", f"{unit}, usually within ±{largest:.4g}")


def check_range(opened: Opened[object], key: KeyPath, lower: float, upper: float, joint_type: str) -> None:
    """Warn if a limit's unit is in doubt, or limits other than 0 allow no motion; `key` is that of the upper limit."""
    check_unit(opened, key, max(lower, upper, key=abs), joint_type)
    if lower == upper != 0.0:
        opened.warning(key, f"the joint has no range: both limits are {upper:g}", "lower limit below upper")


def check_tolerance(opened: Opened[object], key: KeyPath, value: float, joint_type: str, way: float) -> None:
    """Warn if a tolerance never trips: larger than the range `way` of its joint (0: unknown), or in another unit."""
    if 0.0 < way < value:
        opened.warning(key, f"never exceeded: the joint moves {way:.4g} in all", f"below {way:.4g}")
    else:
        check_unit(opened, key, value, joint_type)
