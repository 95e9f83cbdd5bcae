"""Users' code in the `trocar:` section: processes, arms of a `_DERIVED` type, tasks in io's cycle.

The code is searched and its declarations are checked here, but it is not run.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import math
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.loading.overrides import PROCESSES
from trocar.procs.config.models.system_file import RESERVED, ArmKeys
from trocar.procs.config.models.trocar_section import ProcessKeys, PropertyKeys
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.search import expanded
from trocar.procs.config.read.sections import is_name
from trocar.procs.document import system as document
from trocar.procs.document.process import ON_DEMAND
from trocar.procs.document.user_process import (
    PROPERTIES,
    ROS_PAYLOADS,
    SAVE_PROPERTIES,
    SET_PROPERTY,
    Property,
    RosPayload,
    RosTopic,
    UserCommand,
    UserProcess,
    UserTopic,
    shape_of,
    size_of,
)

DERIVED: Final = "_DERIVED"
PERIOD_S: Final = 0.01
_TASKS: KeyPath = ("trocar", "io", "tasks")
_TAKEN: Final = {"events", "audit", "control", "mailbox", "clock", "document", "faults", PROPERTIES}
_OF_A_PROCESS: Final = ("period_s", "cpu", "priority", "late_s", "hung_s", "start", "linger_s", "listen")
_MAX_RECORD, _MAX_NUMBERS, _MAX_TEXT = 1_000_000, 64, 64
_LARGEST_SHARE = 0.5  # of a period, for the tasks of one bus together

# -- modules ---------------------------------------------------------------------------------------------------------


def _module_of(system: Opened[object], key: KeyPath, name: str) -> str:
    """The absolute path of a file in the system file's folder or the working folder; else an installed module's name.
    """
    folder = system.source.path.resolve().parent
    file = expanded(name if name.endswith(".py") else f"{name.replace('.', '/')}.py")
    for path in (folder / file, Path.cwd() / file):
        if path.is_file():
            _check_syntax(system, key, path)
            return str(path)
    if name.endswith(".py"):
        system.error(key, "no such file", f"a file; relative paths start at {folder}")
    elif not all(part.isidentifier() for part in name.split(".")):
        system.error(key, "not the name of a module", "a path that ends in .py, or a name like my_lab.damping")
    elif importlib.util.find_spec(name.split(".")[0]) is None:  # only the first part: this imports nothing
        system.error(key, "no such module", f"a file in {folder}, or an installed module")
    return name


def _check_syntax(system: Opened[object], key: KeyPath, path: Path) -> None:
    """Check the syntax of a file without running it."""
    try:
        ast.parse(path.read_bytes(), str(path))
    except SyntaxError as wrong:
        system.error(key, f"{path} line {wrong.lineno}: {wrong.msg}", "Python code without syntax errors")
    except (OSError, ValueError) as wrong:
        system.error(key, f"{path}: {wrong}", "a file with Python that can be read")


# -- tasks in the cycle of io ----------------------------------------------------------------------------------------


def with_tasks(system: SystemFiles, ios: tuple[document.IoConfig, ...]) -> tuple[document.IoConfig, ...]:
    """The ios with the tasks of their robots."""
    rows = system.options.io.tasks
    controlled = [pid.robot for io in ios for pid in io.pids]
    modules = [_module_of(system, (*_TASKS, index, "module"), row.module) for index, row in enumerate(rows)]
    for index, row in enumerate(rows):
        for place, robot in enumerate(row.robots):
            if robot not in controlled:
                allowed = f"one of {', '.join(controlled)}" if controlled else "there is none"
                system.error((*_TASKS, index, "robots", place), "no joint controller of this name", allowed)
    whole = []
    for io in ios:
        tasks = []
        for row, module in zip(rows, modules, strict=True):
            robots = tuple(pid.robot for pid in io.pids if not row.robots or pid.robot in row.robots)
            if robots:
                budget_s = row.budget_us * 1e-6
                tasks.append(by_name(document.TaskRow, row, module=module, robots=robots, budget_s=budget_s))
        _check_budgets(system, io, tasks)
        whole.append(dataclasses.replace(io, tasks=tuple(tasks)))
    return tuple(whole)


def _check_budgets(system: SystemFiles, io: document.IoConfig, tasks: list[document.TaskRow]) -> None:
    """Check that the tasks of an io leave enough time for joint controllers, boards and the rest."""
    together_s = sum(task.budget_s * len(task.robots) for task in tasks)
    if together_s > _LARGEST_SHARE * io.period_s:
        text = f"the budgets of {io.name} add up to {together_s * 1e6:.0f} µs (each robot counts)"
        system.error(_TASKS, text, f"half its period, {_LARGEST_SHARE * io.period_s * 1e6:.0f} µs")


# -- arms ------------------------------------------------------------------------------------------------------------


def derived_class(system: SystemFiles, key: KeyPath, keys: ArmKeys) -> str:
    """The class of a derived arm, as module:Class; "" for the class of its type."""
    module, _, name = keys.component.name.rpartition(".")
    if not keys.type.endswith(DERIVED) or not module:
        return ""
    if not name.isidentifier():
        system.error(key, "not the name of a class", "module.Class; the module is a file beside this one")
    return f"{_module_of(system, key, module)}:{name}"


def derived_commands(system: SystemFiles, keys: ArmKeys) -> tuple[UserCommand, ...]:
    """The further commands of a derived arm, as declared in `trocar.processes`."""
    if not keys.type.endswith(DERIVED):
        return ()
    return _commands(system, (*PROCESSES, keys.name, "commands"), system.own(keys.name).commands)


# -- processes -------------------------------------------------------------------------------------------------------


def load_user_processes(system: SystemFiles, derived: Collection[str],
                        places: Collection[str]) -> tuple[UserProcess, ...]:
    """Processes with a module; `derived`: arms that may have further commands, `places`: third-party arms and pedals.
    """
    found = []
    for name, row in system.options.processes.items():
        key = (*PROCESSES, name)
        if row.module is not None:
            period_s = _check_host(system, key, row, row.host) if row.host else row.period_s or PERIOD_S
            if name in places:
                _check_place(system, key, row)
            found.append(_process(system, key, name, row, period_s))
        elif row.host or row.topics or row.properties or (row.commands and name not in derived):
            system.error(key, "it belongs to a process of Trocar, and is not declared here", "a module, if it is yours")
    return tuple(found)


def _check_place(system: SystemFiles, key: KeyPath, row: ProcessKeys) -> None:
    """Check a third-party arm or pedals: the topic `state` is taken, and it must not share a process."""
    _check_once(system, (*key, "topics"), [topic.name for topic in row.topics], {"state"})
    if row.host:
        system.error((*key, "host"), "it is an arm, or has pedals", "no host, which gives it a separate process")


def _check_host(system: SystemFiles, key: KeyPath, row: ProcessKeys, name: str) -> float:
    """Check the host of a filter; returns the period of that process, s."""
    host = system.own(name)
    if name in RESERVED or host.module is not None or host.host is not None:
        system.error((*key, "host"), "something else has this name",
                     "a unique name for the process of the rows with the same host")
    for given in (given for given in _OF_A_PROCESS if getattr(row, given)):
        system.error((*key, given), f"{name} calls its update", f"this key at {name}, or no host")
    if host.start == ON_DEMAND:
        system.error((*PROCESSES, name, "start"), "several filters share this process", "always")
    return host.period_s or PERIOD_S


def _process(system: SystemFiles, key: KeyPath, name: str, row: ProcessKeys, period_s: float) -> UserProcess:
    if name in RESERVED:
        system.error(key, "this name is taken by a process of Trocar", "a unique name")
    if not is_name(name):
        system.error(key, f"{name!r} is no name of a process", "letters, digits, _ and -, at most 40")
    if row.priority and not row.host:
        system.error((*key, "priority"), "it has normal scheduling, so that it never delays a robot", "0, or none")
    _check_once(system, (*key, "topics"), [topic.name for topic in row.topics], _TAKEN)
    _check_once(system, (*key, "properties"), [prop.name for prop in row.properties], set())
    module = _module_of(system, (*key, "module"), row.module or "")
    for topic in system.each((*key, "topics"), row.topics):
        _check_topic(system, topic)
    return UserProcess(
        name, module, period_s, row.topics, _commands(system, (*key, "commands"), row.commands),
        tuple(_property(system, (*key, "properties", i), prop) for i, prop in enumerate(row.properties)),
        row.host or "")


def _check_once(system: SystemFiles, key: KeyPath, names: Iterable[str], taken: set[str]) -> None:
    seen = set(taken)
    for index, name in enumerate(names):
        if name in seen:
            system.error((*key, index, "name"), "this name is taken", f"none of {', '.join(sorted(seen))}")
        seen.add(name)


def _check_topic(system: SystemFiles, part: Opened[UserTopic]) -> None:
    row = part.content
    _check_once(system, part.path("fields"), [field.name for field in row.fields], {"sequence", "stamp_ns"})
    size = sum(size_of(field.type) for field in row.fields)
    if size > _MAX_RECORD:
        part.error("", f"a record of {size} bytes", f"at most {_MAX_RECORD}")
    for field in part.each("fields", row.fields):
        bare, shape = shape_of(field.content.type)
        if bare == "text" and (len(shape) > 1 or (shape and shape[0] > 9999)):
            field.error("type", "too long a text", "text[1] to text[9999]")
    if row.ros is not None:
        _check_ros(part, row.ros)


def _check_ros(part: Opened[UserTopic], ros: RosTopic) -> None:
    """Check that the fields, joints and frame fit the message."""
    payload, counts = ROS_PAYLOADS[ros.message], {"joints": len(ros.joints)} if ros.joints else {}
    allowed = f"{'' if payload.is_whole else 'one or more of '}{_in_words(payload)}"
    sizes = dict(payload.fields)
    taken = [field for field in part.each("fields", part.content.fields) if field.content.name in sizes]
    for field in taken:
        name, (bare, shape) = field.content.name, shape_of(field.content.type)
        counts[name] = math.prod(shape) if bare != "text" else 1
        fits = bare in payload.types and sizes[name] in (0, counts[name])
        if not fits or (not payload.kind and shape and bare != "text"):
            field.error("type", f"{field.content.type} does not fit {ros.message}", allowed)
    numbers = ", ".join(f"{name} {count}" for name, count in counts.items())
    is_lacking = not taken or (payload.is_whole and len(taken) < len(sizes))
    for key, is_wrong, text, instead in (
        ("message", is_lacking, f"{ros.message} lacks its fields", allowed),
        ("", len(set(counts.values())) > 1, f"unequal numbers of elements: {numbers}", "equal numbers"),
        ("joints", ros.joints and payload.kind != "js", f"{ros.message} has no joints", "no joints"),
        ("frame", ros.frame and payload.kind in ("", "numbers"), f"{ros.message} has no frame", "no frame"),
    ):
        if is_wrong:
            part.error(f"ros.{key}", text, instead)


def _in_words(payload: RosPayload) -> str:
    """The fields of a message as they are declared."""
    return ", ".join(f"{name} ({payload.types[0]}{f'[{count}]' if count > 1 else '[…]' if not count else ''})"
                     for name, count in payload.fields)


def _commands(system: SystemFiles, key: KeyPath, rows: tuple[UserCommand, ...]) -> tuple[UserCommand, ...]:
    _check_once(system, key, [command.name for command in rows], {SET_PROPERTY, SAVE_PROPERTIES})
    for index, row in enumerate(rows):
        _check_once(system, (*key, index, "arguments"), [field.name for field in row.arguments], set())
        texts = [field for field in row.arguments if shape_of(field.type)[0] == "text"]
        numbers = sum(math.prod(shape_of(field.type)[1]) for field in row.arguments if field not in texts)
        if numbers > _MAX_NUMBERS or len(texts) > 1 or any(size_of(field.type) > _MAX_TEXT for field in texts):
            system.error((*key, index), f"{numbers} numbers and {len(texts)} texts",
                         f"{_MAX_NUMBERS} numbers and one text of {_MAX_TEXT} bytes at most")
    return rows


def _property(system: SystemFiles, key: KeyPath, row: PropertyKeys) -> Property:
    default = row.default
    number, words = (0.0, default) if isinstance(default, str) else (float(default or 0.0), "")
    made = by_name(Property, row, default=number, lower=row.min, upper=row.max, words=words)
    if made.is_text and len(row.name) + 1 + size_of(row.type) > _MAX_TEXT:
        system.error((*key, "type"), "too long a text",
                     f"text[{_MAX_TEXT - 1 - len(row.name)}]: {_MAX_TEXT} bytes with its name")
    if wrong := made.objection(made.first if default is None else default):
        system.error((*key, "default"), wrong, "a value of its type, within its bounds")
    return made
