"""An old configuration file by its content: its kind, and the files of today that replace it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import PurePath

from trocar.procs.config import HEADS, kind_of
from trocar.procs.config.read.jsontext import Parsed, TextError, parse_json
from trocar.procs.config.read.problem import FileProblem
from trocar.tools.converters.armfile import convert_arm, looks_like_arm
from trocar.tools.converters.console import convert_console, looks_like_console
from trocar.tools.converters.io_xml import convert_io
from trocar.tools.converters.pid_xml import convert_pid
from trocar.tools.converters.report import CONVERTED, LOST, Change, ConversionReport, Json, Reference
from trocar.tools.converters.rob_text import convert_rob, looks_like_rob
from trocar.tools.converters.setup import convert_setup, looks_like_setup
from trocar.tools.converters.xmltext import XmlError, parse_xml

UNKNOWN = "unknown"  # broken, or of a kind of ours that cannot be read
OTHER = "other"  # not a configuration file; a run over a folder need not report it
TODAY = "today"  # today's format already
KINDS = "IO XML, PID XML, .rob, console*.json, arm and SUJ files from before 2.4"

_XML = re.compile(rb"\s*(?:\xef\xbb\xbf)?\s*<|\xff\xfe<|\xfe\xff\x00<")
_JSON = re.compile(r"\s*(?:\{|//|/\*)")


@dataclass(frozen=True, slots=True)
class Output:
    """A file in today's format: its name and content."""

    name: str
    data: Json


@dataclass(frozen=True, slots=True)
class Converted:
    """Conversion of an old file. With problems there are no outputs."""

    kind: str
    outputs: tuple[Output, ...]
    changes: tuple[Change, ...]
    problems: tuple[FileProblem, ...]
    references: tuple[Reference, ...] = ()

    @property
    def lost(self) -> tuple[Change, ...]:
        """Content that today's formats cannot express, or need and do not get."""
        return tuple(change for change in self.changes if change.outcome == LOST)

    @property
    def complete(self) -> bool:
        """Whether all meaningful content of the old file was converted."""
        return not self.problems and not self.lost


def convert_file(name: str, data: bytes, follow: Callable[[str], str] | None = None) -> Converted:
    """Convert the bytes of the file called `name`. Raises nothing: mistakes are the result's `problems`.

    `follow` returns the new name of a file converted in the same run, by its name in the old file, or "".
    """
    report = ConversionReport(name) if follow is None else ConversionReport(name, follow)
    if _XML.match(data):
        kind, outputs = _xml(PurePath(name), data, report)
    else:
        kind, outputs = _text(PurePath(name), data, report)
    changes = tuple(sorted(report.changes, key=lambda change: change.line))
    return Converted(kind, () if report.problems else tuple(outputs), changes, tuple(report.problems),
                     tuple(report.references))


def with_arm_file(converted: Converted, file: str, old: str, new: str) -> Converted:
    """The result for `file`, with another name for an arm file that it made; its system file is adapted."""
    system, *rest = converted.outputs
    rows = system.data.get("arms")
    arms = [{**row, "arm_file": new} if isinstance(row, dict) and row.get("arm_file") == old else row
            for row in (rows if isinstance(rows, list) else [])]
    change = Change(file, 0, CONVERTED, "arm_file", old, new, "another file of this run has that name")
    outputs = (Output(system.name, {**system.data, "arms": arms}),
               *(Output(new, output.data) if output.name == old else output for output in rest))
    return replace(converted, outputs=outputs, changes=(*converted.changes, change))


def _xml(path: PurePath, data: bytes, report: ConversionReport) -> tuple[str, list[Output]]:
    try:
        root = parse_xml(data)
    except XmlError as bad:
        report.error(bad.line, "", "", bad.what)
        return UNKNOWN, []
    if root.tag == "Config":
        files = convert_io(root, report)
        outputs = [Output(f"{path.stem}.json", files.main)]
        if files.grippers is not None:
            outputs.append(Output(f"{files.gripper_name}.json", files.grippers))
        return "io", outputs
    if root.tag == "controller" and root.attributes.get("type") == "PID":
        return "pid", [Output(f"{path.stem}.json", convert_pid(root, report))]
    report.error(root.line, root.tag, "", "no known kind of file", "Config (IO), controller with type PID")
    return UNKNOWN if root.tag == "controller" else OTHER, []


def _text(path: PurePath, data: bytes, report: ConversionReport) -> tuple[str, list[Output]]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as bad:
        report.error(0, "", "", f"not UTF-8 text: {bad.reason} at byte {bad.start}")
        return UNKNOWN, []
    if looks_like_rob(text):
        return "rob", [Output(f"{path.stem}.json", convert_rob(text, report))]
    if _JSON.match(text):
        return _json(path, text, report)
    report.error(1, "", "", "no known kind of file", KINDS)
    return OTHER, []


def _json(path: PurePath, text: str, report: ConversionReport) -> tuple[str, list[Output]]:
    try:
        parsed = parse_json(text)
    except TextError as bad:
        report.error(bad.line, "", "", f"broken JSON, column {bad.column}: {bad.what}")
        return UNKNOWN, []
    for kind, fits, convert in _READERS:
        if isinstance(parsed.data, dict) and fits(parsed.data):
            return kind, convert(path, parsed, report)
    if isinstance(parsed.data, dict) and kind_of(parsed.data) != UNKNOWN:
        return TODAY, []
    report.error(1, "", "", "no known kind of file", KINDS)
    return OTHER, []


def _from_console(path: PurePath, parsed: Parsed, report: ConversionReport) -> list[Output]:
    name = path.stem.removeprefix("console").removeprefix("system").lstrip("-_")
    stem = f"system-{name or 'console'}"
    files = convert_console(parsed, stem, report)
    return [Output(f"{stem}.json", files.system), *(Output(name, data) for name, data in files.arms.items())]


def _is_headless(data: Json) -> bool:
    rows = any(isinstance(value, list) and value and isinstance(value[0], dict) for value in data.values())
    return rows and not {"$id", "$version"} <= set(data) and kind_of(data) in HEADS


def _with_head(path: PurePath, parsed: Parsed, report: ConversionReport) -> list[Output]:
    """A file with today's keys that does not state its format."""
    assert isinstance(parsed.data, dict)
    head = HEADS[kind_of(parsed.data)]
    for key, value in head.items():
        if key not in parsed.data:
            report.defaulted(1, key, value, "by its keys")
    return [Output(path.name, {**head, **parsed.data})]


_Reader = tuple[str, Callable[[Json], bool], Callable[[PurePath, Parsed, ConversionReport], list[Output]]]
_READERS: tuple[_Reader, ...] = (
    ("setup joints", looks_like_setup,
     lambda path, parsed, report: [Output(path.name, convert_setup(parsed, report))]),
    ("console", looks_like_console, _from_console),
    ("arm", looks_like_arm,
     lambda path, parsed, report: [Output(path.name, convert_arm(parsed, path.name, report))]),
    ("without a head", _is_headless, _with_head),
)
