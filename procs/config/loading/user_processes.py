"""`trocar.processes` with a `module`: processes of one's own. What they declare is checked, their code is not run."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from typing import Final

from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.modules import module_of
from trocar.procs.config.loading.overrides import SECTION
from trocar.procs.config.models.system_file import RESERVED
from trocar.procs.config.models.trocar_section import ProcessKeys, TrocarSection
from trocar.procs.config.models.user_section import CommandKeys, FieldKeys, PropertyKeys, TopicKeys
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.process import ON_DEMAND
from trocar.procs.document.user_process import (
    PROPERTIES,
    SAVE_PROPERTIES,
    SET_PROPERTY,
    Property,
    UserCommand,
    UserField,
    UserProcess,
    UserTopic,
    shape_of,
    size_of,
)

PERIOD_S: Final = 0.01
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")
_PROCESSES: Key = (SECTION, "processes")
_TAKEN: Final = {"events", "audit", "control", "mailbox", "clock", "document", "faults", PROPERTIES}
_OF_A_PROCESS: Final = ("period_s", "cpu", "priority", "late_s", "hung_s", "start", "linger_s", "listen")
_MAX_RECORD, _MAX_NUMBERS, _MAX_TEXT = 1_000_000, 64, 64


def by_name(context: Context, source: SourceFile) -> SourceFile:
    """A list of rows with names means the same as an object with these names as keys."""
    rows = source.at(_PROCESSES)
    section = source.at((SECTION,))
    if not isinstance(rows, list) or not isinstance(section, dict):
        return source
    named: dict[str, object] = {}
    names: dict[int, str] = {}
    for index, row in enumerate(rows):
        name = row.get("name") if isinstance(row, dict) else None
        if not isinstance(row, dict) or not isinstance(name, str):
            context.error(source, (*_PROCESSES, index), "a row without a name", "rows with name, module and so on")
        elif name in named:
            context.error(source, (*_PROCESSES, index, "name"), "this name occurs twice", "a name of its own")
        else:
            named[name], names[index] = {key: value for key, value in row.items() if key != "name"}, name
    data = {**source.data, SECTION: {**section, "processes": named}}
    depth = len(_PROCESSES)
    lines: dict[Key, int] = {}
    for key, line in source.lines.items():
        row = key[depth] if key[:depth] == _PROCESSES and len(key) > depth else None
        lines[(*_PROCESSES, names[row], *key[depth + 1 :]) if isinstance(row, int) and row in names else key] = line
    return SourceFile(source.path, data, lines, source.overrides)


def load_user_processes(context: Context, source: SourceFile, options: TrocarSection,
                        derived: Collection[str] = (), places: Collection[str] = ()) -> tuple[UserProcess, ...]:
    """Those with a module; `derived` arms have commands of their own, too, `places` are third-party arms and pedals."""
    found = []
    for name, row in options.processes.items():
        key = (*_PROCESSES, name)
        if row.module is not None:
            period_s = _check_host(context, source, key, row, options) if row.host else row.period_s or PERIOD_S
            if name in places:
                _check_place(context, source, key, row)
            found.append(_process(context, source, key, name, row, period_s))
        elif row.host or row.topics or row.properties or (row.commands and name not in derived):
            context.error(source, key, "what a process of ours has is not declared here", "a module, if it is yours")
    return tuple(found)


def _check_place(context: Context, source: SourceFile, key: Key, row: ProcessKeys) -> None:
    """It has a record of its own already, and is silent when another process is."""
    _check_once(context, source, (*key, "topics"), [topic.name for topic in row.topics], {"state"})
    if row.host:
        context.error(source, (*key, "host"), "it is an arm, or has pedals", "no host: a process of its own")


def _check_host(context: Context, source: SourceFile, key: Key, row: ProcessKeys, options: TrocarSection) -> float:
    """The period of the process that calls its update, s."""
    host = options.processes.get(row.host or "")
    if row.host in RESERVED or (host is not None and (host.module is not None or host.host is not None)):
        context.error(source, (*key, "host"), "something else has this name",
                      "a name of its own for the process of those that say the same host")
    for name in (name for name in _OF_A_PROCESS if getattr(row, name)):
        context.error(source, (*key, name), f"{row.host} calls its update", f"this key at {row.host}, or no host")
    if host is not None and host.start == ON_DEMAND:
        context.error(source, (*_PROCESSES, row.host or "", "start"), "several share it", "always")
    return (host.period_s if host is not None else None) or PERIOD_S


def _process(context: Context, source: SourceFile, key: Key, name: str, row: ProcessKeys,
             period_s: float) -> UserProcess:
    if name in RESERVED:
        context.error(source, key, "this name is taken by a process of Trocar", "a name of its own")
    if not _NAME.match(name):
        context.error(source, key, f"{name!r} is no name of a process", "letters, digits, _ and -, at most 40")
    if row.priority and not row.host:
        context.error(source, (*key, "priority"), "it runs as programs usually do, and holds no robot up", "0, or none")
    _check_once(context, source, (*key, "topics"), [topic.name for topic in row.topics], _TAKEN)
    _check_once(context, source, (*key, "properties"), [prop.name for prop in row.properties], set())
    return UserProcess(
        name, module_of(context, source, (*key, "module"), row.module or ""), period_s,
        tuple(_topic(context, source, (*key, "topics", i), topic) for i, topic in enumerate(row.topics)),
        commands_in(context, source, (*key, "commands"), row.commands),
        tuple(_property(context, source, (*key, "properties", i), prop) for i, prop in enumerate(row.properties)),
        row.host or "")


def _check_once(context: Context, source: SourceFile, key: Key, names: Iterable[str], taken: set[str]) -> None:
    seen = set(taken)
    for index, name in enumerate(names):
        if name in seen:
            context.error(source, (*key, index, "name"), "this name is taken", f"none of {', '.join(sorted(seen))}")
        seen.add(name)


def commands_in(context: Context, source: SourceFile, key: Key, rows: Sequence[CommandKeys]) -> tuple[UserCommand, ...]:
    """The commands that a row declares."""
    _check_once(context, source, key, [command.name for command in rows], {SET_PROPERTY, SAVE_PROPERTIES})
    return tuple(_command(context, source, (*key, i), command) for i, command in enumerate(rows))


def _topic(context: Context, source: SourceFile, key: Key, row: TopicKeys) -> UserTopic:
    _check_once(context, source, (*key, "fields"), [field.name for field in row.fields], {"sequence", "stamp_ns"})
    size = sum(size_of(field.type) for field in row.fields)
    if size > _MAX_RECORD:
        context.error(source, key, f"a record of {size} bytes", f"at most {_MAX_RECORD}")
    for index, field in enumerate(row.fields):
        bare, shape = shape_of(field.type)
        if bare == "text" and (len(shape) > 1 or (shape and shape[0] > 9999)):
            context.error(source, (*key, "fields", index, "type"), "too long a text", "text[1] to text[9999]")
    return UserTopic(row.name, row.rate_hz, row.depth, tuple(map(_field, row.fields)))


def _command(context: Context, source: SourceFile, key: Key, row: CommandKeys) -> UserCommand:
    _check_once(context, source, (*key, "arguments"), [field.name for field in row.arguments], set())
    texts = [field for field in row.arguments if shape_of(field.type)[0] == "text"]
    numbers = sum(_count(field.type) for field in row.arguments if field not in texts)
    if numbers > _MAX_NUMBERS or len(texts) > 1 or any(size_of(field.type) > _MAX_TEXT for field in texts):
        context.error(source, key, f"{numbers} numbers and {len(texts)} texts",
                      f"{_MAX_NUMBERS} numbers and one text of {_MAX_TEXT} bytes at most")
    return UserCommand(row.name, tuple(map(_field, row.arguments)), row.text, row.effect, row.stops, row.latest)


def _count(word: str) -> int:
    shape = shape_of(word)[1]
    return shape[0] * (shape[1] if len(shape) > 1 else 1) if shape else 1


def _property(context: Context, source: SourceFile, key: Key, row: PropertyKeys) -> Property:
    default = row.default
    number, words = (0.0, default) if isinstance(default, str) else (float(default or 0.0), "")
    made = Property(row.name, row.type, number, row.min, row.max, row.unit, row.text, words)
    if made.is_text and len(row.name) + 1 + size_of(row.type) > _MAX_TEXT:
        context.error(source, (*key, "type"), "too long a text",
                      f"text[{_MAX_TEXT - 1 - len(row.name)}]: {_MAX_TEXT} bytes with its name")
    if wrong := made.objection(made.first if default is None else default):
        context.error(source, (*key, "default"), wrong, "a value of its type, within its bounds")
    return made


def _field(row: FieldKeys) -> UserField:
    return UserField(**row.model_dump())
