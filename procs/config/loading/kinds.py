"""Kinds of configuration files: their checks, with those of the files that they name, and their JSON Schemas."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePath
from typing import Any, Final

from pydantic import BaseModel
from pydantic.json_schema import JsonSchemaMode, models_json_schema

from trocar.procs.config.loading.arms import check_pid
from trocar.procs.config.loading.carts import check_cart
from trocar.procs.config.loading.chains import (
    arm_chain,
    check_chain,
    check_gravity,
    check_tool,
    load_tool,
    measured_weight,
    weighing_links,
)
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.instruments import check_index, file_of, psm_tool
from trocar.procs.config.loading.io_checks import check_bus, check_io_file
from trocar.procs.config.loading.load import load_system
from trocar.procs.config.loading.setup_pots import check_pots
from trocar.procs.config.models.arm_file import ArmFile, FixedSetupFile, PsmFile, SetupFile, SiSetupFile
from trocar.procs.config.models.io_file import HidFile, IoFile, PidFile
from trocar.procs.config.models.kinematic_file import GravityFile, KinematicFile, ToolFile, ToolIndexFile
from trocar.procs.config.models.lookup_file import check_table, load_tables
from trocar.procs.config.models.setup_pots import SiPotsFile
from trocar.procs.config.models.system_file import SystemFile
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.problem import WARNING, FileProblem
from trocar.procs.config.read.shapes import fields_of
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.document.cart import CLASSIC, FIXED, SI
from trocar.procs.machine.paths import PROJECT_CONFIGS, given_file, not_found
from trocar.procs.tables.arm_types import ARM_TYPES, class_of

SYSTEM = "system"
UNKNOWN = "unknown"
SETUP_POTS = "setup joints, Si arm"

HEADS = {
    SYSTEM: {"$id": "dvrk-system.schema.json", "$version": "1"},
    "io": {"$id": "saw-robot-io.schema.json", "$version": "6"},
    "pid": {"$id": "saw-controllers-pid.schema.json", "$version": "1"},
    **{name.lower(): {"$id": f"dvrk-{name.lower()}.schema.json", "$version": "1"} for name in ARM_TYPES},
}
"""First keys of these kinds of files; other kinds have none."""

_OF_ALL = fields_of(ArmFile)
OWN_KEYS = {name.lower(): tuple(key for key in fields_of(class_of(row.arm_file, ArmFile)) if key not in _OF_ALL)
            for name, row in ARM_TYPES.items()}
"""Keys that arm files of only this kind have."""

_IDS = {head["$id"]: kind for kind, head in HEADS.items()} | dict.fromkeys(
    ("saw-robot-io-suj-si.schema.json", "saw-robot-io-SUJ-Si.schema.json"), SETUP_POTS)


_MARKS = tuple((kind, frozenset(keys.split())) for kind, keys in (
    ("tool index", "instruments"), ("tool", "DH tooltip_offset"), ("tool", "DH jaw"), ("kinematic", "DH"),
    ("io", "robots"), ("io", "digital_inputs"), ("io", "digital_outputs"), ("potentiometer table", "serial lookup"),
    ("gravity", "GC_controller"), ("pid", "pid"), ("head sensor", "id_vendor"), ("head sensor", "id_product")))
"""Keys by which files without `$id` are recognized, in this order: all of a row."""
_ARM_MARKS = (("setup joints, fixed", frozenset({"measured_cp"})), *(
    (kind, own | {key}) for kind, own in (("setup joints, Classic", frozenset({"plug_number"})),
                                          ("setup joints, Si", frozenset()))
    for key in ("DH", "primary_offsets", "simulated_position")))
"""The same, of the first row of `arms`."""


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of file: its model (None: it has none), and the check of what the model cannot express."""

    model: type[BaseModel] | None
    check: Callable[[Opened[Any]], object]


@dataclass(frozen=True, slots=True)
class Checked:
    """The result of a check: kind of the file, problems and notes."""

    path: Path
    kind: str
    problems: tuple[FileProblem, ...]
    notes: tuple[str, ...] = ()


def check_file(
    path: Path, *, search: Sequence[Path] = (), boards: str | None = None, sets: Sequence[str] = (),
    configs: Path = PROJECT_CONFIGS,
) -> Checked:
    """Check one file of any kind; `search`, `boards` and `sets` are the options `--path`, `--boards`, `--set` of `up`.

    `path` itself is also searched there and in `configs`. A system with buses is also checked with emulated boards;
    problems that occur only then are warnings.
    """
    path = given_file(path, search, configs)
    if not path.exists():
        return Checked(path, UNKNOWN, (FileProblem(str(path), 0, "", "", not_found(path, search, configs), ""),))
    source, problems = read_source(path)
    if source is None:
        return Checked(path, UNKNOWN, tuple(problems))
    kind = kind_of(source.data, path.name)
    if kind == SYSTEM:
        return _check_system(path, search, boards, sets, configs)
    if kind == UNKNOWN:
        return Checked(path, kind, (*problems, _unknown(source)))
    context, row = Context.beside([path], search, configs), KINDS[kind]
    opened: Opened[Any] | None = context.read(path) if row.model is None else context.open(row.model, path)
    if opened is not None:
        row.check(opened)
    found = sorted(dict.fromkeys(context.problems), key=lambda problem: problem.severity == WARNING)
    return Checked(path, kind, tuple(found), tuple(dict.fromkeys(context.notes)))


def _check_system(
    path: Path, search: Sequence[Path], boards: str | None, sets: Sequence[str], configs: Path
) -> Checked:
    loaded = load_system(path, search=search, boards=boards, sets=sets, configs=configs, records=True)
    problems, system = [*loaded.errors, *loaded.warnings], loaded.system
    if boards is None and system is not None and system.ios and system.emulation is None:
        emulated = load_system(path, search=search, boards="emulated", sets=sets, configs=configs, records=True)
        problems += [dataclasses.replace(problem, severity=WARNING, text=f"with --boards emulated: {problem.text}")
                     for problem in (*emulated.errors, *emulated.warnings) if problem not in problems]
    return Checked(path, SYSTEM, tuple(problems), system.notes if system is not None else ())


def arm_kind(keys: Collection[str], kinematic: str, name: str = "") -> str:
    """The kind of an arm file without `$id`: by keys that only one kind has, its chain, or its name; "": unknown."""
    for kind, own in OWN_KEYS.items():
        if not set(own).isdisjoint(keys):
            return kind
    starts = (PurePath(text).stem[:3].lower() for text in (kinematic, name))
    return next((start for start in starts if start in OWN_KEYS), "")


def kind_of(data: Mapping[str, object], name: str = "") -> str:
    """The kind of a file by its content: its `$id` or else by the keys that only this kind has; `name`: the file's."""
    if "$id" in data:
        return _IDS.get(str(data["$id"]), UNKNOWN)
    if marked := _marked(_MARKS, data):
        return marked
    if "kinematic" in data:
        return arm_kind(data, str(data["kinematic"]), name) or "psm"
    arms = data.get("arms")
    first = next((arm for arm in arms if isinstance(arm, dict)), ()) if isinstance(arms, list) else ()
    return _marked(_ARM_MARKS, first) or (SYSTEM if {"arms", "IOs", "consoles"} & set(data) else UNKNOWN)


def _marked(marks: Iterable[tuple[str, frozenset[str]]], keys: Collection[str]) -> str:
    return next((kind for kind, needed in marks if needed <= set(keys)), "")


def _unknown(source: SourceFile) -> FileProblem:
    if "$id" in source.data:
        return source.problem(("$id",), "no known kind of file", allowed=", ".join(_IDS))
    return source.problem((), "this kind of file is not checked", severity=WARNING)


def _check_io(opened: Opened[IoFile]) -> None:
    check_io_file(opened)
    load_tables(opened)
    check_bus([opened])


def _check_arm(opened: Opened[ArmFile], arm_type: str) -> None:
    arm_chain(opened)
    weighing_links(opened, arm_type)
    if isinstance(opened.content, PsmFile):
        psm_tool(Opened(opened.context, opened.source, opened.content))
    measured_weight(opened)


def _check_index(opened: Opened[ToolIndexFile]) -> None:
    check_index(opened)
    for row in opened.each("instruments", opened.content.instruments):
        found = file_of(opened.context, opened.source.path, row.content.file)
        if found is None:
            row.warning("file", "no such file: it cannot be chosen", "a tool file")
        else:
            load_tool(opened.context, found, row.content.file)


KINDS: Final[Mapping[str, FileKind]] = {
    SYSTEM: FileKind(SystemFile, lambda opened: None),  # see `_check_system`
    "io": FileKind(IoFile, _check_io),
    "pid": FileKind(PidFile, partial(check_pid, robot=None)),
    **{name.lower(): FileKind(class_of(row.arm_file, ArmFile), partial(_check_arm, arm_type=name))
       for name, row in ARM_TYPES.items()},
    "kinematic": FileKind(KinematicFile, check_chain),
    "tool": FileKind(ToolFile, check_tool),
    "tool index": FileKind(ToolIndexFile, _check_index),
    "setup joints, Classic": FileKind(SetupFile, partial(check_cart, kind=CLASSIC)),
    "setup joints, Si": FileKind(SiSetupFile, partial(check_cart, kind=SI)),
    "setup joints, fixed": FileKind(FixedSetupFile, partial(check_cart, kind=FIXED)),
    SETUP_POTS: FileKind(SiPotsFile, check_pots),
    "potentiometer table": FileKind(None, check_table),
    "gravity": FileKind(GravityFile, check_gravity),
    "head sensor": FileKind(HidFile, lambda opened: None),
}
"""THE TABLE of kinds of files that `trocar check` knows."""
MODELS: Final = {name: kind.model for name, kind in KINDS.items() if kind.model is not None}

# -- JSON Schemas, for completion and checks in editors ----------------------------------------------------------------

_EMPTY: Final[dict[str, Any]] = {"enum": [None, [], {}]}
"""Values that count as absent, in files of the dVRK."""


def schema_of(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of file; KeyError if there is no such kind.

    It has keys, types and ranges. What several keys or files must agree on is checked by `check_file` only.
    """
    models: list[type[BaseModel]] = [MODELS[kind], *([TrocarSection] if kind == SYSTEM else [])]
    wanted: list[tuple[type[BaseModel], JsonSchemaMode]] = [(model, "validation") for model in models]
    refs, definitions = models_json_schema(wanted, by_alias=True)
    parts = [refs[row] for row in wanted]
    if kind == SYSTEM:
        section = definitions["$defs"][TrocarSection.__name__]["properties"]
        section["processes"] = {"anyOf": [section["processes"], {"type": "array"}]}  # the other form: users' processes
        definitions["$defs"][SystemFile.__name__]["properties"]["trocar"] = parts[1]
    for definition in definitions["$defs"].values():
        properties = definition.get("properties", {})
        definition["properties"] = {key: {"anyOf": [value, _EMPTY]} for key, value in properties.items()}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"Trocar: {kind} file", **definitions,
            **parts[0]}
