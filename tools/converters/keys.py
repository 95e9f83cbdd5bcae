"""Reading a JSON object key by key, so that all unread ones are reported at the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import TypeVar

from pydantic import BaseModel

from trocar.procs.config.read.problem import KeyPath, key_text, value_text
from trocar.procs.config.read.shapes import fields_of, unwrapped
from trocar.tools.converters.names import file_today
from trocar.tools.converters.report import NOT_READ, ConversionReport, Reference

Value = TypeVar("Value")



def _folded(name: object) -> str:
    return str(name).replace("-", "_")

class Keys:
    """One object, its place in the file and the keys read so far. Mistakes go to the report."""

    def __init__(self, data: object, lines: Mapping[KeyPath, int], report: ConversionReport, key: KeyPath = ()) -> None:
        """`data` at `key` of a decoded file whose keys are on `lines`; anything except an object is an error."""
        self.place = key
        self.report = report
        self._lines = lines
        self._read: list[Keys] = []
        if not isinstance(data, dict):
            report.error(self.line(), key_text(key), value_text(data), "wrong type", "an object")
            self.report = ConversionReport(report.file)  # missing keys in it need no report
            data = {}
        # null, [] and {} count as absent
        self._left = {name: value for name, value in data.items() if value not in (None, [], {})}
        self._spelling: dict[str, str] = {_folded(name): name for name in self._left}

    def line(self, *names: str | int) -> int:
        """The line of a key, or of the nearest one around it."""
        key = self._full(names)
        return next((self._lines[key[:cut]] for cut in range(len(key), -1, -1) if key[:cut] in self._lines), 0)

    def key(self, *names: str | int) -> str:
        """A key path as people write it."""
        return key_text(self._full(names))

    def _full(self, names: tuple[str | int, ...]) -> KeyPath:
        return (*self.place, *(self._spelled(name) if isinstance(name, str) else name for name in names))

    def _spelled(self, name: str) -> str:
        """A key as this file spells it: partly updated files have `_` in some for `-`."""
        return name if name in self._left else self._spelling.get(_folded(name), name)

    def has(self, name: str) -> bool:
        """Whether the key is there and not read yet."""
        return self._spelled(name) in self._left

    def peek(self, name: str) -> object:
        """A value as in the file, not marked as read; None if it is missing."""
        return self._left.get(self._spelled(name))

    def take(self, name: str) -> object:
        """A value as in the file; None if it is missing."""
        return self._left.pop(self._spelled(name), None)

    def keep(self, model: type[BaseModel]) -> dict[str, object]:
        """Keys of today's `model` that are not read yet, as they are: parts of a file that are new already."""
        return {name: self._left.pop(name) for name in fields_of(model) if name in self._left}

    def read(self, model: type[BaseModel], skip: Collection[str] = (), **old: str) -> dict[str, object]:
        """All values of today's `model` that are there and not read yet, under today's names or those of `old`."""
        row: dict[str, object] = {}
        for name, field in fields_of(model).items():
            key = name if self.has(name) else old.get(name, "")
            if name not in skip and self.has(key):
                row[name] = _READ.get(unwrapped(field.annotation)[0], Keys.text)(self, key)
        return row

    def text(self, *names: str) -> str:
        """The first existing one of `names`, a text; "" if there is none."""
        return self._typed(names, str, "a text") or ""

    def file(self, name: str) -> str:
        """The present name of a file; "" if there is no such key."""
        old = self.text(name)
        return self.followed(name, old) if old else ""

    def followed(self, name: str, old: str) -> str:
        """Present name of a file named at `name`: its name in this run, else that of the stock file."""
        made = self.report.follow(old)
        new = made or file_today(old)
        self.refer(name, old, new, bool(made))
        if new != old:
            why = "converted with it" if made else "convert the file, too, unless it is a stock one"
            self.converted(name, old, new, why)
        return new

    def refer(self, name: str, old: str, new: str, converted_with_it: bool = False) -> None:
        """Note which file is read in the place of an old one."""
        self.report.references.append(Reference(self.line(name), self.key(name), old, new, converted_with_it))

    def flag(self, name: str) -> bool | None:
        """True or false, also as 1 or 0; None if there is no such key."""
        if self.peek(name) in (0, 1):
            return bool(self.take(name))
        return self._typed((name,), bool, "true or false")

    def number(self, name: str) -> float | None:
        """A number; None if there is no such key."""
        found = self._typed((name,), (int, float), "a number")
        return float(found) if found is not None else None

    def inside(self, name: str) -> Keys | None:
        """The object at `name`; None if there is none."""
        if not self.has(name):
            return None
        self._read.append(Keys(self.take(name), self._lines, self.report, self._full((name,))))
        return self._read[-1]

    def items(self, name: str) -> list[Keys]:
        """The objects of the list at `name`."""
        found = self.take(name) or []
        if not isinstance(found, list):
            self.report.error(self.line(name), self.key(name), value_text(found), "wrong type", "a list of objects")
            return []
        rows = [Keys(item, self._lines, self.report, self._full((name, number))) for number, item in enumerate(found)]
        self._read += rows
        return rows

    def converted(self, name: str, old: str, new: str, reason: str = "") -> None:
        """Report that the value of `name` is written differently."""
        self.report.converted(self.line(name), self.key(name), old, new, reason)

    def defaulted(self, name: str, new: str, reason: str) -> None:
        """Report that `name` was missing."""
        self.report.defaulted(self.line(name), self.key(name), new, reason)

    def drop(self, name: str, reason: str) -> None:
        """A known key that is no longer needed."""
        if self.has(name):
            self.report.dropped(self.line(name), self.key(name), value_text(self.take(name)), reason)

    def lose(self, name: str, reason: str) -> None:
        """Report a key that today's format cannot express."""
        if self.has(name):
            self.report.lost(self.line(name), self.key(name), value_text(self.take(name)), reason)

    def finish(self) -> None:
        """Report unread keys, here and in all objects read from it."""
        for name, value in self._left.items():
            self.report.dropped(self.line(name), self.key(name), value_text(value), NOT_READ)
        for part in self._read:
            part.finish()

    def _typed(self, names: tuple[str, ...], kind: type[Value] | tuple[type[Value], ...], allowed: str) -> Value | None:
        name = next((name for name in names if self.has(name)), None)
        if name is None:
            return None
        value = self.take(name)
        is_flag = isinstance(value, bool)
        if isinstance(value, kind) and (not is_flag or kind is bool) and value not in (math.inf, -math.inf):
            return value
        self.report.error(self.line(name), self.key(name), value_text(value), "wrong type", allowed)
        return None


_READ: dict[object, Callable[[Keys, str], object]] = {bool: Keys.flag, float: Keys.number}
