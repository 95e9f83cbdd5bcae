"""The files of one arm by themselves, for calculations without a system: kinematics, tool, endoscope, weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.config.loading.chains import arm_chain, load_chain, load_tool, measured_weight, weighing_links
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.instruments import psm_tool
from trocar.procs.config.loading.kinds import kind_of
from trocar.procs.config.models.arm_file import ArmFile, EcmFile, PsmFile
from trocar.procs.config.read.problem import ERROR, FileProblem
from trocar.procs.document import system as document
from trocar.procs.document.arms import MasterGravityParameters
from trocar.procs.kinematics.endoscopes import Endoscope, endoscope
from trocar.procs.machine.paths import PROJECT_CONFIGS, given_file, not_found
from trocar.procs.tables.arm_types import ARM_TYPES, class_of

BY_JOINTS = {row.joints: name for name, row in ARM_TYPES.items()}
"""Assumed arm type of a kinematic file without an arm file, by its number of joints; others are bare chains."""


@dataclass(frozen=True, slots=True)
class OfflineArm:
    """An arm for calculations. `weights`: the links with masses; None if no file has any."""

    kind: str  # PSM, ECM, MTM, or "" for a chain that is no arm's
    chain: document.Chain
    tool: document.Tool | None = None
    endoscope: Endoscope | None = None
    weights: document.Chain | None = None
    master_gravity: MasterGravityParameters | None = None
    mounting_pitch: float = 0.0


def load_offline(
    kinematic: Path | None, tool: Path | None, arm: Path | None, *, search: Sequence[Path] = (),
) -> tuple[OfflineArm | None, tuple[FileProblem, ...]]:
    """An arm from a kinematic file or an arm file, or both; a given file replaces the one named in the arm file.

    None with errors. `search`: the folders of `--path`; the files themselves are also searched there and in `configs/`.
    """
    given = [given_file(path, search, PROJECT_CONFIGS) if path is not None else None for path in (kinematic, tool, arm)]
    absent = [FileProblem(str(path), 0, "", "", not_found(path, search, PROJECT_CONFIGS), "a file")
              for path in given if path is not None and not path.exists()]
    if absent:
        return None, tuple(absent)
    kinematic, tool, arm = given
    context = Context.beside([path for path in (arm, kinematic, tool) if path is not None], search, PROJECT_CONFIGS)
    found = _of_chain(load_chain(context, kinematic)) if arm is None else _of_arm_file(context, arm, kinematic)
    chosen = load_tool(context, tool, tool.stem) if tool is not None else None
    problems = tuple(dict.fromkeys(context.problems))
    if found is None or any(problem.severity == ERROR for problem in problems):
        return None, problems
    if chosen is not None:
        found = OfflineArm("PSM", found.chain, chosen, None, found.weights, None, found.mounting_pitch)
    return found, problems


def _of_chain(chain: document.Chain | None) -> OfflineArm | None:
    if chain is None:
        return None
    weighs = any(link.mass > 0.0 or any(link.com) for link in chain.links)  # an ECM's is that of its camera
    return OfflineArm(BY_JOINTS.get(len(chain.links), ""), chain, weights=chain if weighs else None)


def _of_arm_file(context: Context, path: Path, kinematic: Path | None) -> OfflineArm | None:
    read = context.read(path)
    if read is None:
        return None
    arm_type = kind_of(read.source.data).upper()
    if arm_type not in ARM_TYPES:
        *most, last = (name.lower() for name in ARM_TYPES)
        read.error("$id", "is no arm file", f"dvrk-{', dvrk-'.join(most)} or dvrk-{last}.schema.json")
        return None
    opened = context.open(class_of(ARM_TYPES[arm_type].arm_file, ArmFile), path)
    if opened is None:
        return None
    content = opened.content
    chain = load_chain(context, kinematic) if kinematic is not None else arm_chain(opened)
    if chain is None:
        return None
    weights = weighing_links(opened, arm_type)
    tool = psm_tool(Opened(context, opened.source, content)) if isinstance(content, PsmFile) else None
    parameters = measured_weight(opened)
    camera = None
    if isinstance(content, EcmFile):
        camera, weights = endoscope(content.endoscope), weights or chain
    return OfflineArm(arm_type, chain, tool, camera, weights, parameters, content.mounting_pitch or 0.0)
