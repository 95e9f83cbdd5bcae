"""Units of old files to SI: what an attribute `Unit` says, or what was meant where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable

from trocar.tools.converters.element import Element
from trocar.tools.converters.report import number_text

REVOLUTE, PRISMATIC = "REVOLUTE", "PRISMATIC"
SI = {REVOLUTE: "rad", PRISMATIC: "m"}
OLD = {REVOLUTE: "deg", PRISMATIC: "mm"}

_TO_SI: dict[str, tuple[Callable[[float], float], str]] = {
    "deg": (math.radians, REVOLUTE),
    "rad": (float, REVOLUTE),
    "mm": (lambda value: value / 1000.0, PRISMATIC),
    "cm": (lambda value: value / 100.0, PRISMATIC),
    "m": (float, PRISMATIC),
}


class Unit:
    """The unit of one element's numbers, for a joint that turns or slides."""

    def __init__(self, element: Element, joint_type: str, unsaid: str) -> None:
        """`unsaid` is the unit where the element has no attribute `Unit`; a unit that is none is an error."""
        self.si = SI[joint_type]
        self._element = element
        found = element.take("Unit")
        name = found[1] if found else unsaid
        fitting = [unit for unit, (_, of) in _TO_SI.items() if of == joint_type]
        if name not in fitting:
            text = f"no unit for a joint that is {joint_type}"
            element.report.error(element.line, element.key("Unit"), name, text, ", ".join(fitting))
            name = self.si
        self.name = name
        self._assumed = f"no Unit: {name} was meant" if not found and name != self.si else ""

    def number(self, attribute: str, *, default: float | None = None, per: str = "") -> float:
        """The attribute in SI units, told when that changes the number; `per` is what it is counted by (a bit, a V)."""
        element = self._element
        given = element.has(attribute)
        value = element.number(attribute, default=default)
        converted = _TO_SI[self.name][0](value)
        if given and self.name != self.si:
            old, new = number_text(value, self.name + per), number_text(converted, self.si + per)
            element.report.converted(element.line, element.key(attribute), old, new, self._assumed)
        return converted
