"""Checks of any configuration file by itself: its kind, and all problems of the file and of those that it names."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePath

from trocar.procs.config.loading.arms import check_pid
from trocar.procs.config.loading.buses import BusFiles
from trocar.procs.config.loading.carts import check_cart
from trocar.procs.config.loading.chains import (
    arm_chain,
    check_chain,
    check_tool,
    load_tool,
    measured_weight,
    weighing_links,
)
from trocar.procs.config.loading.context import Context, ModelType, Opened
from trocar.procs.config.loading.instruments import check_index, file_of, psm_tool
from trocar.procs.config.loading.io_checks import check_bus
from trocar.procs.config.loading.load import load_system
from trocar.procs.config.models.arm_file import ArmFile, PsmFile
from trocar.procs.config.models.gravity_file import load_master_gravity
from trocar.procs.config.models.hid_file import load_hid
from trocar.procs.config.models.kinematic_file import KinematicFile, ToolFile, ToolIndexFile
from trocar.procs.config.models.lookup_file import check_table
from trocar.procs.config.models.pid_file import PidFile
from trocar.procs.config.models.system_file import IoKeys
from trocar.procs.config.read.problem import WARNING, FileProblem
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.config.read.validate import fields_of
from trocar.procs.document.cart import CLASSIC, FIXED, SI
from trocar.procs.machine.paths import PROJECT_CONFIGS, given_file, not_found
from trocar.procs.tables.arm_types import ARM_TYPES, class_of

SYSTEM = "system"
UNKNOWN = "unknown"

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

_IDS = {head["$id"]: kind for kind, head in HEADS.items()}


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
    context = Context.beside([path], search, configs)
    _CHECKS[kind](context, path)
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
    keys = set(data)
    if "$id" in keys:
        return _IDS.get(str(data["$id"]), UNKNOWN)
    if "instruments" in keys:
        return "tool index"
    if {"DH", "tooltip_offset"} <= keys or {"DH", "jaw"} <= keys:
        return "tool"
    if "DH" in keys:
        return "kinematic"
    if {"robots", "digital_inputs", "digital_outputs"} & keys:
        return "io"
    if {"serial", "lookup"} <= keys:
        return "potentiometer table"
    if "GC_controller" in keys:
        return "gravity"
    if "pid" in keys:
        return "pid"
    if {"id_vendor", "id_product"} & keys:
        return "head sensor"
    if "kinematic" in keys:
        return arm_kind(keys, str(data["kinematic"]), name) or "psm"
    arms = data.get("arms")
    first = next((set(arm) for arm in arms if isinstance(arm, dict)), set()) if isinstance(arms, list) else set()
    if "measured_cp" in first:
        return "setup joints, fixed"
    if {"DH", "primary_offsets", "simulated_position"} & first:
        return "setup joints, Classic" if "plug_number" in first else "setup joints, Si"
    return SYSTEM if {"arms", "IOs", "consoles"} & keys else UNKNOWN


def _unknown(source: SourceFile) -> FileProblem:
    if "$id" in source.data:
        return source.problem(("$id",), "no known kind of file", allowed=", ".join(_IDS))
    return source.problem((), "this kind of file is not checked", severity=WARNING)


def _check_io(context: Context, path: Path) -> None:
    bus = BusFiles(IoKeys(name="IO", port="fw"), ())
    bus.add(context, path)
    check_bus(bus.opened())


def _check(context: Context, path: Path, model: type[ModelType], check: Callable[[Opened[ModelType]], object]) -> None:
    opened = context.open(model, path)
    if opened is not None:
        check(opened)


def _check_arm(opened: Opened[ArmFile], arm_type: str) -> None:
    arm_chain(opened)
    weighing_links(opened, arm_type)
    if isinstance(opened.content, PsmFile):
        psm_tool(Opened(opened.context, opened.source, opened.content))
    measured_weight(opened)


def _check_index(opened: Opened[ToolIndexFile]) -> None:
    check_index(opened)
    for number, row in enumerate(opened.content.instruments):
        found = file_of(opened.context, opened.source.path, row.file)
        if found is None:
            opened.warning(("instruments", number, "file"), "no such file: it cannot be chosen", "a tool file")
        else:
            load_tool(opened.context, found, row.file)


_CHECKS: dict[str, Callable[[Context, Path], object]] = {
    "io": _check_io,
    "pid": partial(_check, model=PidFile, check=partial(check_pid, robot=None)),
    **{name.lower(): partial(_check, model=class_of(row.arm_file, ArmFile), check=partial(_check_arm, arm_type=name))
       for name, row in ARM_TYPES.items()},
    "kinematic": partial(_check, model=KinematicFile, check=check_chain),
    "tool": partial(_check, model=ToolFile, check=check_tool),
    "tool index": partial(_check, model=ToolIndexFile, check=_check_index),
    "setup joints, Classic": partial(check_cart, kind=CLASSIC),
    "setup joints, Si": partial(check_cart, kind=SI),
    "setup joints, fixed": partial(check_cart, kind=FIXED),
    "potentiometer table": check_table,
    "gravity": load_master_gravity,
    "head sensor": load_hid,
}
