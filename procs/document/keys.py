"""Allowed values in files for a field of the document, declared only at the field itself.

    setpoint_timeout_s: Annotated[float, Key(0.001, 1.0, "s of an old setpoint, then hold")] = 0.03

The sections of `trocar.procs.config.models` include such fields with `keys_of`. A section with the same keys as a class
of the document is made from that class: `Keys[UserTopic]` (`trocar.procs.config.read.sections`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, get_type_hints


@dataclass(frozen=True, slots=True)
class Key:
    """Bounds of a number (or of each in a list), or `pattern` of a text, with a description.

    `name`: the key in files, if not the field's name; it is `inside` these objects of the section. `default`: in files,
    if the field has none. `of`: the section, if a class has keys of several. `is_optional`: if absent, it follows from
    other keys.
    `min_length`: of a list or text; the key is then required. `length`: of a list, exactly. `choices`: of a text whose
    field can also have others.
    """

    low: float | None = None
    high: float | None = None
    text: str = ""
    above: bool = False  # `low` itself is not allowed
    pattern: str = ""
    max_length: int | None = None
    name: str = ""
    is_optional: bool = False
    min_length: int | None = None
    length: int | None = None
    choices: tuple[str, ...] = ()
    inside: tuple[str, ...] = ()
    default: Any = ...
    of: str = ""


NAME: Final = Key(pattern=r"^[A-Za-z0-9_-]{1,40}$", text="letters, digits, _ and -, at most 40")
BOARD_ID: Final = Key(0, 15, "the controller's rotary switch")
BIT_ID: Final = Key(0, 31)
AXIS_ID: Final = Key(-1, 9, default=-1)
MADE: Final = Key(text="made when the file is loaded")
"""Of a field that is no key of the section."""


def keys_in(kind: type, *, whole: bool = False) -> Iterator[tuple[dataclasses.Field[Any], Any, Key]]:
    """The fields of a dataclass that files may set, each with its annotation and its Key.

    These are those with a Key; of a `whole` section all but those that are `MADE`.
    """
    hints = get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        declared = [item for item in getattr(hints[field.name], "__metadata__", ()) if isinstance(item, Key)]
        for key in declared or [Key()] * whole:
            if key is not MADE:
                yield field, hints[field.name], key
