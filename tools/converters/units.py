"""Units of old IO files to SI: as stated by `Unit`, or else the units of the file's format.

The format is identified by its version, and by its spelling if the two disagree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from trocar.tools.converters.element import Element
from trocar.tools.converters.report import number_text
from trocar.tools.converters.xmltext import XmlNode

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
_NEWEST = 5
_OLD_WORDS = {"BoardID", "AxisID", "BitID", "ActuatorID", "SN"}
_NEW_WORDS = {"BoardId", "AxisId", "BitId", "SerialNumber"}


class Unit:
    """The unit of one element's numbers, for a joint that turns or slides."""

    def __init__(self, element: Element, joint_type: str, unsaid: str) -> None:
        """`unsaid` is the unit without an attribute `Unit`; an invalid unit is an error."""
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
        """The attribute in SI units, reported if that changes the number; `per` is its reference (a bit, a V)."""
        element = self._element
        given = element.has(attribute)
        value = element.number(attribute, default=default)
        converted = _TO_SI[self.name][0](value)
        if given and self.name != self.si:
            old, new = number_text(value, self.name + per), number_text(converted, self.si + per)
            element.report.converted(element.line, element.key(attribute), old, new, self._assumed)
        return converted


@dataclass(frozen=True, slots=True)
class FormatVersion:
    """`old`: spelled BoardID, in degrees and mm unless a Unit is given."""

    version: int
    old: bool

    def unit(self, joint_type: str) -> str:
        """The unit of positions without an attribute `Unit`."""
        return (OLD if self.old else SI)[joint_type]


def format_version_of(root: XmlNode, top: Element) -> FormatVersion:
    """The format of a file; an unknown version is an error."""
    report = top.report
    version = 1
    if top.has("Version"):
        version = top.integer("Version", least=1, most=_NEWEST)
    else:
        report.defaulted(root.line, "Config@Version", "1", "the first versions had no number")
    words = _words(root)
    if words & _OLD_WORDS and words & _NEW_WORDS:
        text = f"both spellings in one file: {', '.join(sorted(words & (_OLD_WORDS | _NEW_WORDS)))}"
        allowed = "BoardID, AxisID, BitID, SN or BoardId, AxisId, BitId, SerialNumber"
        report.error(root.line, "Config", "", text, allowed)
    old = bool(words & _OLD_WORDS) or (version < _NEWEST and not words & _NEW_WORDS)
    if old and version == _NEWEST:
        reason = "spelled as version 4: without Unit it is read in degrees and mm"
        report.converted(root.line, "Config@Version", "5", "version 4", reason)
    return FormatVersion(version, old)


def _words(node: XmlNode) -> set[str]:
    found = set(node.attributes)
    for child in node.children:
        found |= _words(child)
    return found
