"""The files of one arm by themselves, for calculations without a system: kinematics, tool, endoscope, weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from procs.lib import document
from procs.lib.config.arm_file import EcmFile, MtmFile, PsmFile
from procs.lib.config.arms import arm_chain
from procs.lib.config.chains import load_chain, load_tool
from procs.lib.config.context import Context, Opened
from procs.lib.config.instruments import psm_tool
from procs.lib.config.kinds import kind_of
from procs.lib.config.problem import ERROR, Problem
from procs.lib.config.search import search_path
from procs.lib.config.weights import measured_weight, weighing_links
from procs.lib.endoscopes import Endoscope, endoscope
from procs.lib.gravity_parameters import MasterGravityParameters
from procs.lib.paths import PROJECT_CONFIGS, given_file, not_found

MODELS: dict[str, type[PsmFile] | type[EcmFile] | type[MtmFile]] = {"psm": PsmFile, "ecm": EcmFile, "mtm": MtmFile}
KINDS = {7: "MTM", 4: "ECM", 3: "PSM"}
"""What a kinematic file without an arm file is taken for, by its joints; others can be nothing but computed."""


@dataclass(frozen=True, slots=True)
class OfflineArm:
    """What can be computed with. `weights` are the links with their masses, None where no file has any."""

    kind: str  # PSM, ECM, MTM, or "" for a chain that is no arm's
    chain: document.Chain
    tool: document.Tool | None = None
    endoscope: Endoscope | None = None
    weights: document.Chain | None = None
    master_gravity: MasterGravityParameters | None = None
    mounting_pitch: float = 0.0


def load_offline(
    kinematic: Path | None, tool: Path | None, arm: Path | None, *, search: Sequence[Path] = (),
    configs: Path = PROJECT_CONFIGS,
) -> tuple[OfflineArm | None, tuple[Problem, ...]]:
    """An arm from a kinematic file or an arm file, or both: what is given by itself takes the place of what it names.

    None with errors. `search` is what `--path` gives; the files themselves are looked for there and in `configs`, too.
    """
    kinematic, tool, arm = (given_file(path, search, configs) if path is not None else None
                            for path in (kinematic, tool, arm))
    absent = [Problem(str(path), 0, "", "", not_found(path, search, configs), "a file")
              for path in (kinematic, tool, arm) if path is not None and not path.exists()]
    if absent:
        return None, tuple(absent)
    beside = tuple(path.parent for path in (arm, kinematic, tool) if path is not None)
    context = Context(search_path((Path.cwd(), *beside, *search, configs)))
    found = _of_arm_file(context, arm, kinematic) if arm is not None else None
    if found is None and arm is None and kinematic is not None:
        chain = load_chain(context, kinematic)
        if chain is not None:
            weighs = any(link.mass > 0.0 or any(link.com) for link in chain.links)  # an ECM's is that of its camera
            found = OfflineArm(KINDS.get(len(chain.links), ""), chain, weights=chain if weighs else None)
    chosen = load_tool(context, tool, tool.stem) if tool is not None else None
    problems = tuple(dict.fromkeys(context.problems))
    if found is None or any(problem.severity == ERROR for problem in problems):
        return None, problems
    if chosen is not None:
        found = OfflineArm("PSM", found.chain, chosen, None, found.weights, None, found.mounting_pitch)
    return found, problems


def _of_arm_file(context: Context, path: Path, kinematic: Path | None) -> OfflineArm | None:
    source = context.read(path)
    if source is None:
        return None
    kind = kind_of(source)
    if kind not in MODELS:
        context.error(source, ("$id",), "is no arm file", "dvrk-psm, dvrk-ecm or dvrk-mtm.schema.json")
        return None
    opened = context.open(MODELS[kind], path)
    if opened is None:
        return None
    content, pitch = opened.content, opened.content.mounting_pitch or 0.0
    chain = load_chain(context, kinematic) if kinematic is not None else arm_chain(context, opened)
    if chain is None:
        return None
    if isinstance(content, PsmFile):
        tool = psm_tool(context, Opened(opened.source, content))
        return OfflineArm("PSM", chain, tool, None, weighing_links(context, opened.source, content, "PSM"), None, pitch)
    if isinstance(content, EcmFile):
        weights = weighing_links(context, opened.source, content, "ECM") or chain
        return OfflineArm("ECM", chain, None, endoscope(content.endoscope), weights, None, pitch)
    parameters = measured_weight(context, opened.source, content)
    return OfflineArm("MTM", chain, None, None, None, parameters, pitch)
