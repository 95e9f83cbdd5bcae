"""Allowed values in files for a field of the document, declared only at the field itself.

    setpoint_timeout_s: Annotated[float, Key(0.001, 1.0, "s of an old setpoint, then hold")] = 0.03

The sections of `trocar.procs.config.models` include such fields with `keys_of`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_type_hints


@dataclass(frozen=True, slots=True)
class Key:
    """Bounds of a number (or of each in a list), or `pattern` of a text, with a description.

    `name`: the key in files, if not the field's name. `is_optional`: if absent, it follows from other keys.
    """

    low: float | None = None
    high: float | None = None
    text: str = ""
    above: bool = False  # `low` itself is not allowed
    pattern: str = ""
    max_length: int | None = None
    name: str = ""
    is_optional: bool = False


def keys_in(kind: type) -> Iterator[tuple[dataclasses.Field[Any], Any, Key]]:
    """The fields of a dataclass that files may set, each with its annotation and its Key."""
    hints = get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        for key in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(key, Key):
                yield field, hints[field.name], key
