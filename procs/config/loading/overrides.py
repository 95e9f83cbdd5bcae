"""Other notations for the `trocar:` section: `--set key=value` on the command line, and lists of processes."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.read.jsontext import TextError
from trocar.procs.config.read.problem import FileProblem, KeyPath, value_text
from trocar.procs.config.read.source import SourceFile
from trocar.procs.config.read.yamltext import parse_yaml

SECTION = "trocar"
PROCESSES: KeyPath = (SECTION, "processes")


def apply_overrides(source: SourceFile, sets: Sequence[str]) -> tuple[SourceFile, list[FileProblem]]:
    """`source` with all `--set` options in its `trocar` section; keys may have a leading `trocar.`."""
    problems: list[FileProblem] = []
    pairs: list[tuple[str, str]] = []
    for item in sets:
        name, equals, text = item.partition("=")
        if equals:
            pairs.append((name, text))
        else:
            problems.append(_problem("", item, "no equals sign", "key=value"))
    section = source.data.get(SECTION)
    data = {**source.data, SECTION: _copy(section) if isinstance(section, dict) else {}}
    keys: list[KeyPath] = []
    for name, text in pairs:
        parts = tuple(part for part in name.strip().removeprefix(f"{SECTION}.").split("."))
        if not all(parts):
            problems.append(_problem(name, text, "not a key", "names joined by dots, for example io.period_s"))
            continue
        try:
            value = parse_yaml(text).data
        except TextError as bad:
            problems.append(_problem(name, text, f"not a value: {bad.what}", "a YAML scalar"))
            continue
        if _write(data, (SECTION, *parts), value):
            keys.append((SECTION, *parts))
        else:
            problems.append(_problem(name, text, "an outer key already has a plain value"))
    if not pairs:
        return source, problems
    return SourceFile(source.path, data, source.lines, frozenset(keys)), problems


def _problem(name: str, value: str, text: str, allowed: str = "") -> FileProblem:
    return FileProblem("--set", 0, name, value_text(value), text, allowed)


def _copy(value: object) -> object:
    return {key: _copy(item) for key, item in value.items()} if isinstance(value, dict) else value


def _write(data: dict[str, object], key: tuple[str, ...], value: object) -> bool:
    here = data
    for part in key[:-1]:
        inner = here.setdefault(part, {})
        if not isinstance(inner, dict):
            return False
        here = inner
    here[key[-1]] = value
    return True


def with_named_processes(system: Opened[None]) -> SourceFile:
    """Convert a list of processes with names into the equivalent object with these names as keys."""
    source = system.source
    rows = source.at(PROCESSES)
    section = source.at((SECTION,))
    if not isinstance(rows, list) or not isinstance(section, dict):
        return source
    named: dict[str, object] = {}
    names: dict[int, str] = {}
    for index, row in enumerate(rows):
        name = row.get("name") if isinstance(row, dict) else None
        if not isinstance(row, dict) or not isinstance(name, str):
            system.error((*PROCESSES, index), "a row without a name", "rows with name, module and so on")
        elif name in named:
            system.error((*PROCESSES, index, "name"), "this name occurs twice", "a unique name")
        else:
            named[name], names[index] = {key: value for key, value in row.items() if key != "name"}, name
    data = {**source.data, SECTION: {**section, "processes": named}}
    depth = len(PROCESSES)
    lines: dict[KeyPath, int] = {}
    for key, line in source.lines.items():
        row = key[depth] if key[:depth] == PROCESSES and len(key) > depth else None
        lines[(*PROCESSES, names[row], *key[depth + 1 :]) if isinstance(row, int) and row in names else key] = line
    return SourceFile(source.path, data, lines, source.overrides)
