"""Rows of topics and commands made of what the system file declares for a process of one's own."""

from __future__ import annotations

import math

from procs.document.user_process import (
    PROPERTIES,
    SAVE_PROPERTIES,
    SET_PROPERTY,
    UserField,
    UserProcess,
    shape_of,
)
from shm.commands import CommandRow
from shm.rows import Field, Topic
from shm.type_words import dtype_of

KIND = "user"
KEPT = 64
"""Records of the properties."""


def topics_of(process: UserProcess) -> tuple[Topic, ...]:
    """Its topics; with properties one more, that has their values."""
    found = [Topic(row.name, KIND, row.rate_hz, 0.0, tuple(_field(field) for field in row.fields), depth=row.depth)
             for row in process.topics]
    if process.properties:
        fields = tuple(Field(row.name, dtype_of(row.type, ()), row.unit, row.text) for row in process.properties)
        found.append(Topic(PROPERTIES, KIND, 0.0, 0.0, fields, depth=KEPT))
    return tuple(found)


def commands_of(process: UserProcess) -> tuple[CommandRow, ...]:
    """Its commands; with properties those that set and save them, too."""
    found = []
    for row in process.commands:
        numbers = ", ".join(_in_words(field) for field in row.arguments if shape_of(field.type)[0] != "text")
        text = next((field.name for field in row.arguments if shape_of(field.type)[0] == "text"), "")
        found.append(CommandRow(row.name, numbers, text, row.text, row.moves, ("*",) if row.stops else (),
                                latest=row.latest))
    if process.properties:
        found += [CommandRow(SET_PROPERTY, "value", "property", "set a property, within its bounds", moves=False),
                  CommandRow(SAVE_PROPERTIES, "", "", "keep the properties for the next start", moves=False)]
    return tuple(found)


def _field(field: UserField) -> Field:
    return Field(field.name, dtype_of(*shape_of(field.type)), field.unit, field.text)


def _in_words(field: UserField) -> str:
    count = math.prod(shape_of(field.type)[1])
    return f"{field.name}{f' ({count})' if count > 1 else ''}{f' {field.unit}' if field.unit else ''}"
