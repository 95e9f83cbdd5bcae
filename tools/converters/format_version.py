"""Which of the old IO formats a file is in: by its version, and by its spelling where the two disagree."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.tools.converters.element import Element
from trocar.tools.converters.units import OLD, SI
from trocar.tools.converters.xmltext import XmlNode

_NEWEST = 5
_OLD_WORDS = {"BoardID", "AxisID", "BitID", "ActuatorID", "SN"}
_NEW_WORDS = {"BoardId", "AxisId", "BitId", "SerialNumber"}


@dataclass(frozen=True, slots=True)
class FormatVersion:
    """`old`: spelled BoardID, in degrees and mm where no Unit says otherwise."""

    version: int
    old: bool

    def unit(self, joint_type: str) -> str:
        """The unit of positions where there is no attribute `Unit`."""
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
