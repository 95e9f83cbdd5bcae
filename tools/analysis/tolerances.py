"""Allowed differences: `--tolerance position=0.1deg`, `--tolerance PSM1/state.velocity=0.01`, `--tolerance 0.1mm`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final

from trocar.tools.output.errors import Misuse

SCALES: Final = {
    "rad": ("rad", 1.0), "mrad": ("rad", 1e-3), "deg": ("rad", math.pi / 180.0), "°": ("rad", math.pi / 180.0),
    "m": ("m", 1.0), "mm": ("m", 1e-3), "um": ("m", 1e-6), "µm": ("m", 1e-6),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180.0), "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3),
    "N": ("N", 1.0), "mN": ("N", 1e-3), "Nm": ("N·m", 1.0), "N·m": ("N·m", 1.0), "mNm": ("N·m", 1e-3),
    "A": ("A", 1.0), "mA": ("A", 1e-3), "V": ("V", 1.0), "mV": ("V", 1e-3), "s": ("s", 1.0),
    "ns": ("ns", 1.0), "us": ("ns", 1e3), "µs": ("ns", 1e3), "ms": ("ns", 1e6),
}
"""By name: the unit of the fields concerned, and the value of one in that unit."""
FORM: Final = re.compile(r"(?:(?P<field>[^=]+)=)?(?P<number>[0-9.+\-eE]+)\s*(?P<unit>\S*)")


@dataclass(frozen=True, slots=True)
class AllowedDifference:
    """One of them: its fields (TOPIC.FIELD or FIELD, empty: all), and its unit (empty: any)."""

    field: str
    unit: str
    value: float

    def concerns(self, topic: str, field: str, units: Sequence[str]) -> bool:
        """Whether it applies to this field. Without unit and name: to all but times and numbers of records."""
        if self.field:
            return any(fnmatchcase(name, self.field) for name in (field, f"{topic}.{field}"))
        if self.unit:
            return self.unit in units
        return field not in ("sequence", "stamp_ns") and "ns" not in units


def parsed(text: str) -> AllowedDifference:
    """One tolerance as typed; Misuse names the allowed forms."""
    found = FORM.fullmatch(text.strip())
    try:
        value = float(found["number"]) if found is not None else math.nan
    except ValueError:
        value = math.nan
    unit = found["unit"] if found is not None else ""
    if found is None or not math.isfinite(value) or value < 0.0 or (unit and unit not in SCALES):
        raise Misuse(f"--tolerance {text}: allowed are [FIELD=]NUMBER[UNIT], with NUMBER not negative and UNIT one of "
                     f"{', '.join(SCALES)}")
    name, scale = SCALES[unit] if unit else ("", 1.0)
    return AllowedDifference(found["field"] or "", name, value * scale)


def tolerance_of(tolerances: Sequence[AllowedDifference], topic: str, field: str, unit: str) -> float:
    """Tolerance of a field: named ones precede units, those precede general ones; of several the smallest.

    A field of `rad|m` has both: a tolerance given for only one of them applies to all of its elements.
    """
    units = [part.strip() for part in re.split(r"[|,]", unit)]
    concerned = [each for each in tolerances if each.concerns(topic, field, units)]
    for group in ([t for t in concerned if t.field], [t for t in concerned if t.unit], concerned):
        fitting = [t.value for t in group if not t.field or not t.unit or t.unit in units]
        if fitting:
            return min(fitting)
    return 0.0
