"""A configuration file, JSON or YAML, as plain values with the line of every key."""

from __future__ import annotations

import codecs
import functools
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from trocar.procs.config.read.jsontext import Parsed, TextError, parse_json
from trocar.procs.config.read.problem import WARNING, FileProblem, KeyPath, key_text, value_text
from trocar.procs.config.read.yamltext import parse_yaml
from trocar.procs.machine.paths import dangling

_YAML = (".yaml", ".yml")
_LARGEST = 4_000_000  # bytes; the largest known file, a potentiometer table, has 0.5 MB
_KEPT = 50_000  # characters; larger texts are not kept in memory
_OTHER = {stat.S_IFIFO: "a named pipe", stat.S_IFDIR: "a folder", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device",
          stat.S_IFBLK: "a device"}
_MISSING = object()
REHEARSED: Final = "_rehearsed"
"""Key of files that a rehearsal of commissioning has written; the dVRK ignores it."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceFile:
    """One file. `overrides`: key paths whose values are from the command line (--set).

    `data` is never changed: files of the same text share it.
    """

    path: Path
    data: dict[str, object]
    lines: Mapping[KeyPath, int]
    overrides: frozenset[KeyPath] = frozenset()

    def at(self, key: KeyPath) -> object:
        """The value at `key`; None when there is none."""
        found = self._find(key)
        return None if found is _MISSING else found

    def has(self, key: KeyPath) -> bool:
        """Whether `key` is written in the file."""
        return self._find(key) is not _MISSING

    def renamed(self, names: Mapping[str, str]) -> SourceFile:
        """The file with top-level keys renamed, except where the new name exists as well."""
        here = {old: new for old, new in names.items() if old in self.data and new not in self.data}
        if not here:
            return self
        data = {here.get(key, key): value for key, value in self.data.items()}
        lines = {(here.get(str(key[0]), key[0]), *key[1:]) if key else key: line for key, line in self.lines.items()}
        return SourceFile(self.path, data, lines, self.overrides)

    def without(self, name: str) -> SourceFile:
        """The file without a top-level key."""
        data = {key: value for key, value in self.data.items() if key != name}
        return SourceFile(self.path, data, self.lines, self.overrides)

    def problem(self, key: KeyPath, text: str, *, allowed: str = "", severity: str = "error") -> FileProblem:
        """A finding at `key`, with the nearest known line."""
        found = self._find(key)
        value = "" if found is _MISSING or not key else value_text(found)
        file, line = self._place(key)
        return FileProblem(file, line, key_text(key), value, text, allowed, severity)

    def _place(self, key: KeyPath) -> tuple[str, int]:
        if key not in self.lines and any(given[: len(key)] == key for given in self.overrides):
            return "--set", 0
        for cut in range(len(key), -1, -1):
            if key[:cut] in self.overrides:
                return "--set", 0
            if key[:cut] in self.lines:
                return str(self.path), self.lines[key[:cut]]
        return str(self.path), 0

    def _find(self, key: KeyPath) -> object:
        here: object = self.data
        for part in key:
            in_list = isinstance(here, list) and isinstance(part, int) and 0 <= part < len(here)
            if not in_list and not (isinstance(here, dict) and part in here):
                return _MISSING
            here = here[part]  # type: ignore[index]  # a list or a dict, as just asked
        return here


def read_bytes(path: Path) -> tuple[bytes, FileProblem | None]:
    """The content of a configuration file, or the problem: it cannot be read, or is too large.

    Its type is checked first, because to open a named pipe blocks, and to open a device may have side effects.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            text = f"not a regular file but {_OTHER.get(stat.S_IFMT(status.st_mode), 'something else')}"
            return b"", FileProblem(str(path), 0, "", "", text, "a file")
        if status.st_size > _LARGEST:
            text = f"too large: {status.st_size} bytes"
            return b"", FileProblem(str(path), 0, "", "", text, f"at most {_LARGEST}")
        return path.read_bytes(), None
    except OSError as bad:
        why = dangling(path) if isinstance(bad, FileNotFoundError) and path.is_symlink() else bad.strerror or str(bad)
        return b"", FileProblem(str(path), 0, "", "", f"cannot be read: {why}")


def read_source(path: Path) -> tuple[SourceFile | None, list[FileProblem]]:
    """Read a JSON or YAML file (by its suffix); None, with the reason, when it cannot be read."""
    name = str(path)
    data, problem = read_bytes(path)
    if problem is not None:
        return None, [problem]
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as bad:
        is_utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        why = "this is UTF-16" if is_utf_16 else f"{bad.reason} at byte {bad.start}"
        return None, [FileProblem(name, 0, "", "", f"not UTF-8 text: {why}")]
    if not text.strip():
        return None, [FileProblem(name, 0, "", "", "the file is empty")]
    if text.lstrip().startswith("<"):
        allowed = f"JSON or YAML; trocar convert {path} makes one of it"
        return None, [FileProblem(name, 1, "", "", "this is XML, as before dVRK 2.4, which is not read", allowed)]
    is_yaml = path.suffix.lower() in _YAML
    try:
        parsed = (_again if len(text) <= _KEPT else _parse)(text, is_yaml)
    except TextError as bad:
        what = f"broken {'YAML' if is_yaml else 'JSON'}, column {bad.column}: {bad.what}"
        return None, [FileProblem(name, bad.line, "", "", what)]
    return _as_source(path, parsed)


def _parse(text: str, is_yaml: bool) -> Parsed:
    return parse_yaml(text) if is_yaml else parse_json(text)


_again = functools.lru_cache(maxsize=256)(_parse)  # a program may load a system, or several, repeatedly


def _as_source(path: Path, parsed: Parsed) -> tuple[SourceFile | None, list[FileProblem]]:
    if not isinstance(parsed.data, dict):
        found = value_text(parsed.data)
        return None, [FileProblem(str(path), 1, "", found, "the document must be an object",
                                  'an object: {"key": value}')]
    source = SourceFile(path, parsed.data, parsed.lines)
    problems = [
        FileProblem(str(path), line, key_text(key), "", "key occurs twice: the last one counts", severity=WARNING)
        for key, line in parsed.repeated
    ]
    return source, problems
