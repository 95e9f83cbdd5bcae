"""Which values of two files of today's formats differ, as a person reads them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from trocar.procs.config.read.problem import value_text
from trocar.tools.converters.report import Json

_NONE = "nothing"
_HEAD = ("$id", "$version", "$schema")
_CLOSE = 1e-6  # relative: old files have six digits


def differences(old: Json, new: Json) -> list[str]:
    """`key old → new` of every value that is not the same; entries of lists are compared by their names, where they
    have any."""
    before, after = dict(_leaves(old, "")), dict(_leaves(new, ""))
    keys = dict.fromkeys((*before, *after))
    return [f"{key} {_text(before, key)} → {_text(after, key)}"
            for key in keys if key.lstrip(".") not in _HEAD and not _same(before.get(key), after.get(key))]


def _leaves(value: object, key: str) -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _leaves(item, f"{key}.{name}" if key else name)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            named = isinstance(item, dict) and isinstance(item.get("name"), str)
            yield from _leaves(item, f"{key}[{item['name'] if named else number}]")
    else:
        yield key, value


def _same(one: object, other: object) -> bool:
    numbers = isinstance(one, int | float) and isinstance(other, int | float)
    if numbers and not isinstance(one, bool) and not isinstance(other, bool):
        return math.isclose(one, other, rel_tol=_CLOSE, abs_tol=1e-12)  # type: ignore[arg-type]  # numbers, as just asked
    return one == other


def _text(leaves: dict[str, object], key: str) -> str:
    return value_text(leaves[key]) if key in leaves else _NONE
