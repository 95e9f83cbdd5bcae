"""XML as old dVRK files use it: elements and attributes with their lines, and nothing else.

DTDs and entities are refused: a configuration does not need them, and a few lines of them expand to gigabytes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

_LARGEST = 5_000_000  # bytes; the largest known file has 30 kB
_DEEPEST = 32


class XmlError(Exception):
    """A text that is not XML of this kind, with the line (from 1) of the error."""

    def __init__(self, line: int, what: str) -> None:
        super().__init__(f"line {line}: {what}")
        self.line = line
        self.what = what


@dataclass(slots=True)
class XmlNode:
    """One element."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[XmlNode] = field(default_factory=list)


def parse_xml(data: bytes) -> XmlNode:
    """The root element, without the text between elements; XmlError gives the position of invalid or refused XML."""
    if len(data) > _LARGEST:
        raise XmlError(1, f"too large: {len(data)} bytes, at most {_LARGEST}")
    parser = expat.ParserCreate()
    top = XmlNode("", {}, 0)
    stack = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > _DEEPEST:
            raise XmlError(parser.CurrentLineNumber, f"elements are nested deeper than {_DEEPEST}")
        node = XmlNode(tag, attributes, parser.CurrentLineNumber)
        stack[-1].children.append(node)
        stack.append(node)

    def end(_: str) -> None:
        stack.pop()

    def refuse(*_: object) -> None:
        raise XmlError(parser.CurrentLineNumber, "a DTD (<!DOCTYPE …>) is not accepted")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as bad:
        raise XmlError(bad.lineno, f"broken XML: {expat.ErrorString(bad.code)}, column {bad.offset + 1}") from None
    except (LookupError, ValueError) as bad:  # an unknown encoding
        raise XmlError(1, f"broken XML: {bad}") from None
    return top.children[0]
