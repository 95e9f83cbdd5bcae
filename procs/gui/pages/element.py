"""HTML elements: a tree that is built in `with` blocks, and its text."""

from __future__ import annotations

from collections.abc import Iterator
from contextvars import ContextVar, Token
from html import escape
from typing import Any, Final

VOID: Final = frozenset({"input", "link", "meta"})
"""Elements without content, and so without an end tag."""
_AROUND: Final[ContextVar[Part | None]] = ContextVar("around", default=None)
"""The element whose `with` block runs."""


class Part:
    """One HTML element with classes, text and attributes; a context manager for its content.

    An element that is made in the block of another one belongs to it.
    """

    def __init__(self, tag: str, classes: str = "", text: str = "", **attributes: Any) -> None:
        """`data_live="…"` is the attribute data-live, `for_` is for; True: an attribute without a value."""
        self.tag, self.text, self.parent = tag, text, _AROUND.get()
        self.parts: list[Part] = []
        self.props = {"class": classes} if classes else {}
        for name, value in attributes.items():
            self.props[name.rstrip("_").replace("_", "-")] = "" if value is True else str(value)
        self._before: Token[Part | None] | None = None
        if self.parent is not None:
            self.parent.parts.append(self)

    def __enter__(self) -> Part:
        self._before = _AROUND.set(self)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._before is not None:
            _AROUND.reset(self._before)

    def all(self) -> Iterator[Part]:
        """This element and all in it."""
        yield self
        for part in self.parts:
            yield from part.all()

    def html(self) -> str:
        """Its text, with all in it."""
        start = "".join(f' {name}="{escape(value)}"' for name, value in self.props.items())
        if self.tag in VOID:
            return f"<{self.tag}{start}>"
        return f"<{self.tag}{start}>{escape(self.text)}{''.join(part.html() for part in self.parts)}</{self.tag}>"
