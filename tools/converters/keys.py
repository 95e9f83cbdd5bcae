"""Reading a JSON object key by key, so that whatever nobody asked for is reported at the end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

from procs.config.read.problem import Key, key_text, value_text
from tools.converters.names import file_today
from tools.converters.report import ConversionReport, Reference

Value = TypeVar("Value")

_NOBODY = "the original software did not read it"


class Keys:
    """One object, its place in the file and what has been read of it. Mistakes go to the report."""

    def __init__(self, data: object, lines: Mapping[Key, int], report: ConversionReport, key: Key = ()) -> None:
        """`data` at `key` of a decoded file whose keys stand on `lines`; something else than an object is an error."""
        self.place = key
        self.report = report
        self._lines = lines
        self._read: list[Keys] = []
        if not isinstance(data, dict):
            report.error(self.line(), key_text(key), value_text(data), "wrong type", "an object")
            self.report = ConversionReport(report.file)  # what would be missing in it needs no telling
            data = {}
        # null, [] and {} count as absent
        self._left = {name: value for name, value in data.items() if value not in (None, [], {})}

    def line(self, *names: str | int) -> int:
        """The line of a key, or of the nearest one around it."""
        key = (*self.place, *names)
        return next((self._lines[key[:cut]] for cut in range(len(key), -1, -1) if key[:cut] in self._lines), 0)

    def key(self, *names: str | int) -> str:
        """A key path as people write it."""
        return key_text((*self.place, *names))

    def has(self, name: str) -> bool:
        """Whether the key is there and not read yet."""
        return name in self._left

    def peek(self, name: str) -> object:
        """A value as it stands, left to be read; None when there is none."""
        return self._left.get(name)

    def take(self, name: str) -> object:
        """A value as it stands; None when there is none."""
        return self._left.pop(name, None)

    def text(self, *names: str) -> str:
        """The first of `names` that is there, a text; "" when none is."""
        return self._typed(names, str, "a text") or ""

    def file(self, name: str) -> str:
        """The name of a file, as it is called today; "" when there is no such key."""
        old = self.text(name)
        return self.followed(name, old) if old else ""

    def followed(self, name: str, old: str) -> str:
        """What a file, named at `name`, is called today: as this run calls it, else as stock files are."""
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
        """True or false, also as 1 or 0; None when there is no such key."""
        if self._left.get(name) in (0, 1):
            return bool(self.take(name))
        return self._typed((name,), bool, "true or false")

    def number(self, name: str) -> float | None:
        """A number; None when there is no such key."""
        found = self._typed((name,), (int, float), "a number")
        return float(found) if found is not None else None

    def inside(self, name: str) -> Keys | None:
        """The object at `name`; None when there is none."""
        if name not in self._left:
            return None
        self._read.append(Keys(self._left.pop(name), self._lines, self.report, (*self.place, name)))
        return self._read[-1]

    def items(self, name: str) -> list[Keys]:
        """The objects of the list at `name`."""
        found = self._left.pop(name, [])
        if not isinstance(found, list):
            self.report.error(self.line(name), self.key(name), value_text(found), "wrong type", "a list of objects")
            return []
        rows = [Keys(item, self._lines, self.report, (*self.place, name, number)) for number, item in enumerate(found)]
        self._read += rows
        return rows

    def converted(self, name: str, old: str, new: str, reason: str = "") -> None:
        """Tell that the value of `name` is written otherwise."""
        self.report.converted(self.line(name), self.key(name), old, new, reason)

    def defaulted(self, name: str, new: str, reason: str) -> None:
        """Tell that there was no `name`."""
        self.report.defaulted(self.line(name), self.key(name), new, reason)

    def drop(self, name: str, reason: str) -> None:
        """A key that is known and not needed any more."""
        if name in self._left:
            self.report.dropped(self.line(name), self.key(name), value_text(self._left.pop(name)), reason)

    def lose(self, name: str, reason: str) -> None:
        """A key that today's format cannot say."""
        if name in self._left:
            self.report.lost(self.line(name), self.key(name), value_text(self._left.pop(name)), reason)

    def finish(self) -> None:
        """Tell what nobody asked for, here and in all that was read of it."""
        for name in list(self._left):
            self.drop(name, _NOBODY)
        for part in self._read:
            part.finish()

    def _typed(self, names: tuple[str, ...], kind: type[Value] | tuple[type[Value], ...], allowed: str) -> Value | None:
        name = next((name for name in names if name in self._left), None)
        if name is None:
            return None
        value = self._left.pop(name)
        is_flag = isinstance(value, bool)
        if isinstance(value, kind) and (not is_flag or kind is bool) and value not in (math.inf, -math.inf):
            return value
        self.report.error(self.line(name), self.key(name), value_text(value), "wrong type", allowed)
        return None
