"""Rows of topics and commands for the declarations of users' processes in the system file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import SystemConfig
from trocar.procs.document.user_process import (
    PROPERTIES,
    SAVE_PROPERTIES,
    SET_PROPERTY,
    UserCommand,
    UserField,
    UserProcess,
    shape_of,
)
from trocar.shm.mailbox.command_row import ANY, EVERYTHING, MOTION, RELAX, SETTING, Argument, CommandRow, effect_named
from trocar.shm.memory.rows import DTYPES, Field, Topic, dtype_of

KIND = "user"
VALUE = Argument("value, none of a text", low=-math.inf, high=math.inf, optional=True)
KEPT = 64
"""Depth of the ring of properties."""


def topics_of(process: UserProcess) -> tuple[Topic, ...]:
    """The topics of a user's process; with properties, also the topic of their values."""
    found = [Topic(row.name, KIND, tuple(_field(field) for field in row.fields), rate_hz=row.rate_hz, depth=row.depth)
             for row in process.topics]
    if process.properties:
        fields = tuple(Field(row.name, dtype_of(*shape_of(row.type)), row.unit, row.text) for row in process.properties)
        found.append(Topic(PROPERTIES, KIND, fields, depth=KEPT))
    return tuple(found)


def commands_of(process: UserProcess) -> tuple[CommandRow, ...]:
    """The commands of a user's process; with properties, also those that set and save them."""
    found = list(map(command_row, process.commands))
    if process.properties:
        found += [CommandRow(SET_PROPERTY, SETTING, "set a property, within its bounds", (VALUE,),
                             "property, of a text and its text"),
                  CommandRow(SAVE_PROPERTIES, SETTING, "keep the properties for the next start")]
    return tuple(found)


def own_commands(system: SystemConfig, name: str) -> tuple[CommandRow, ...]:
    """Further commands of an instance, besides those of its kind: of a user's process, or a derived arm."""
    user = system.user(name)
    if user is not None:
        return commands_of(user)
    return tuple(command_row(row) for arm in system.arms if arm.name == name for row in arm.commands)


def handler_of(made: object, name: str, command: UserCommand) -> Callable[..., Any]:
    """The method on_COMMAND of a process object for a command that process `name` declares; ValueError without it."""
    handler: Callable[..., Any] | None = getattr(made, f"on_{command.name}", None)
    if handler is None:
        raise ValueError(f"{type(made).__name__} has no on_{command.name}, which {name} declares")
    return handler


def command_row(row: UserCommand) -> CommandRow:
    """A declared command as a row of the table of commands; from "relax" on, it may cause any other command."""
    numbers = tuple(_argument(field) for field in row.arguments if shape_of(field.type)[0] != "text")
    text = next((field.name for field in row.arguments if shape_of(field.type)[0] == "text"), "")
    effect = effect_named(row.effect) or MOTION
    return CommandRow(row.name, effect, row.text, numbers, text, stops=(ANY,) if row.stops else (),
                      causes=(EVERYTHING,) if effect >= RELAX else (), latest=row.latest)


def _argument(field: UserField) -> Argument:
    """An argument with the bounds of its type: 0 and 1 for a bool, whole numbers for an int."""
    bare, shape = shape_of(field.type)
    kind = np.dtype(DTYPES[bare])
    low, high = -math.inf, math.inf
    if kind.kind == "b":
        low, high = 0.0, 1.0
    elif kind.kind != "f":
        low, high = float(np.iinfo(kind).min), float(np.iinfo(kind).max)
    return Argument(field.name, field.unit, math.prod(shape), low, high, whole=kind.kind != "f")


def arguments_of(command: UserCommand, values: NDArray[np.float64], text: str) -> list[Any]:
    """The arguments in their declared types: float, int, bool, text, or arrays; they must already be checked."""
    made: list[Any] = []
    at = 0
    for row in command.arguments:
        bare, shape = shape_of(row.type)
        if bare == "text":
            made.append(text)
            continue
        part = values[at : at + math.prod(shape)]
        at += len(part)
        if shape:
            made.append(part.reshape(shape))
        else:
            made.append(bool(part[0]) if bare == "bool" else float(part[0]) if "float" in bare else int(part[0]))
    return made


def _field(field: UserField) -> Field:
    return Field(field.name, dtype_of(*shape_of(field.type)), field.unit, field.text)
