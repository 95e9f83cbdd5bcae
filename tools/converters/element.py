"""Reading an XML element attribute by attribute, so that all unread ones are reported at the end."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TypeVar

from trocar.tools.converters.report import NOT_READ, ConversionReport, finite
from trocar.tools.converters.xmltext import XmlNode

Value = TypeVar("Value")

_FIRST = "the original software read only the first"


class Element:
    """One element, its place in the file and the attributes read so far. Mistakes go to the report."""

    def __init__(self, node: XmlNode, path: str, report: ConversionReport) -> None:
        self.path = path
        self.line = node.line
        self.report = report
        self._attributes = dict(node.attributes)
        self._children = list(node.children)
        self._read: list[Element] = []

    def key(self, name: str) -> str:
        """An attribute's key: `Robot[1]/Actuator[3]/Drive/MaxCurrent@Value`, counting from 1 as XPath does."""
        return f"{self.path}@{name}"

    def has(self, *names: str) -> bool:
        """Whether one of these attributes is there."""
        return any(name in self._attributes for name in names)

    def is_word(self, name: str, word: str) -> bool:
        """Whether an attribute is `word`; it stays to be read."""
        return self._attributes.get(name, "").strip() == word

    def take(self, *names: str) -> tuple[str, str] | None:
        """The first existing one of `names`, with its text; None if there is none."""
        for name in names:
            if name in self._attributes:
                return name, self._attributes.pop(name).strip()
        return None

    def text(self, *names: str) -> str:
        """A required text; "" with an error if it is missing."""
        found = self.take(*names)
        if found is None or not found[1]:
            self.missing(names[0])
            return ""
        return found[1]

    def number(self, *names: str, default: float | None = None) -> float:
        """A finite number, required unless there is a `default`; 0 with an error for an invalid one."""
        found = self.take(*names)
        if found is None:
            if default is None:
                self.missing(names[0], "a number")
            return default or 0.0
        name, text = found
        value = finite(text)
        if value is None:
            self.report.error(self.line, self.key(name), text, "not a finite number", "a number")
        return value or 0.0

    def integer(self, *names: str, least: int = 0, most: int) -> int:
        """A required whole number from `least` to `most`."""
        found = self.take(*names)
        allowed = f"a whole number from {least} to {most}"
        if found is None:
            self.missing(names[0], allowed)
            return least
        name, text = found
        if not re.match(r"[-+]?\d{1,9}\Z", text) or not least <= int(text) <= most:
            self.report.error(self.line, self.key(name), text, "out of range", allowed)
            return least
        return int(text)

    def word(self, table: Mapping[str, Value], *names: str) -> Value | None:
        """Entry of `table` for the attribute's text; None without it, or (with an error) for an unknown word."""
        found = self.take(*names)
        if found is None:
            return None
        name, text = found
        if text not in table:
            self.report.error(self.line, self.key(name), text, "unknown word", ", ".join(table))
            return None
        return table[text]

    def missing(self, name: str, allowed: str = "") -> None:
        """A required attribute is not there."""
        self.report.error(self.line, self.key(name), "", "this attribute is required", allowed)

    def child(self, tag: str) -> Element | None:
        """The first child of this name; further ones are reported as dropped."""
        found = self.children(tag)
        for extra in found[1:]:
            extra.drop_all(_FIRST)
        return found[0] if found else None

    def need(self, tag: str) -> Element:
        """The first child of this name; an error and an empty replacement if there is none."""
        found = self.child(tag)
        if found is None:
            self.report.error(self.line, f"{self.path}/{tag}", "", "this element is required")
            return Element(XmlNode(tag, {}, self.line), f"{self.path}/{tag}", ConversionReport(self.report.file))
        return found

    def children(self, tag: str) -> list[Element]:
        """All children of this name."""
        nodes = [node for node in self._children if node.tag == tag]
        self._children = [node for node in self._children if node.tag != tag]
        inside = f"{self.path}/" if self.path else ""
        many = len(nodes) > 1
        found = [
            Element(node, f"{inside}{tag}[{number}]" if many else f"{inside}{tag}", self.report)
            for number, node in enumerate(nodes, 1)
        ]
        self._read += found
        return found

    def drop(self, name: str, reason: str) -> None:
        """A known attribute that is no longer needed."""
        found = self.take(name)
        if found is not None:
            self.report.dropped(self.line, self.key(name), found[1], reason)

    def drop_child(self, tag: str, reason: str) -> None:
        """A known child that is no longer needed, key by key."""
        for child in self.children(tag):
            child.drop_all(reason)

    def drop_all(self, reason: str) -> None:
        """Everything in here; a matrix is one key."""
        rows = [child for child in self._children if child.tag == "Row"]
        if rows:
            self.report.dropped(self.line, self.path, f"a matrix of {len(rows)} rows", reason)
            self._children = [child for child in self._children if child.tag != "Row"]
        elif not self._attributes and not self._children:
            self.report.dropped(self.line, self.path, "", reason)
        for name in list(self._attributes):
            self.drop(name, reason)
        for tag in dict.fromkeys(child.tag for child in self._children):
            self.drop_child(tag, reason)

    def finish(self) -> None:
        """Report unread attributes, here and in all elements read from it."""
        for name in list(self._attributes):
            self.drop(name, NOT_READ)
        for tag in dict.fromkeys(child.tag for child in self._children):
            for child in self.children(tag):
                child.drop_all(NOT_READ)
        for child in self._read:
            child.finish()
