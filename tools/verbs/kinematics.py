"""`trocar kinematics`: forward and inverse kinematics, Jacobians and gravity of anybody's files, without a robot.

JSON lines in, JSON lines out; poses are 4×4, joints rad or m, Jacobians 6×n with linear rows first.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from numpy.typing import NDArray

from trocar.procs.config.loading.offline import OfflineArm, load_offline
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.gravity import Gravity, up_of
from trocar.procs.kinematics.inverse.arms import inverse_of
from trocar.procs.kinematics.master_gravity import MasterGravity
from trocar.procs.kinematics.poses import PoseError, check_matrix
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import tell
from trocar.tools.verbs.options import PathOption

Array = NDArray[np.float64]
Row = dict[str, Any]
Answer = Callable[[Row], Row]

KinematicOption: TypeAlias = Annotated[
    Path | None, typer.Option("--kinematic", metavar="FILE", help="A kinematic file, e.g. kinematic/PSM.json.")]
ToolOption: TypeAlias = Annotated[
    Path | None, typer.Option("--tool", metavar="FILE", help="A tool file, e.g. tool/LARGE_NEEDLE_DRIVER_400006.json.")]
ArmOption: TypeAlias = Annotated[
    Path | None, typer.Option("--arm", metavar="FILE", help="An arm file: names kinematics, tool, endoscope, pitch.")]


class Wrong(ValueError):
    """A line cannot be answered: what is wrong with it."""


def fk(kinematic: KinematicOption = None, tool: ToolOption = None, arm: ArmOption = None,
       path: PathOption = None) -> int:
    """Pose of the tip. In: {"q": [...]}. Out adds fk (with the tool's or endoscope's tip) and fk_notip.

    Example: echo '{"q": [0, 0, 0.1]}' | trocar kinematics fk --kinematic kinematic/PSM.json
    """
    chain = forward(load(kinematic, tool, arm, path))

    def answer(row: Row) -> Row:
        q = joints(row, "q", chain.n)
        return {"fk": chain.fk(q).tolist(), "fk_notip": chain.fk_to(q, chain.n).tolist()}

    return answered(answer)


def jacobian(kinematic: KinematicOption = None, tool: ToolOption = None, arm: ArmOption = None,
             path: PathOption = None) -> int:
    """Jacobians. In: {"q": [...]}. Out adds jb (at the tip, in tip axes) and js (at the base's origin, in its axes).

    Example: echo '{"q": [0, 0, 0.1, 0]}' | trocar kinematics jacobian --kinematic kinematic/ECM.json
    """
    chain = forward(load(kinematic, tool, arm, path))

    def answer(row: Row) -> Row:
        q = joints(row, "q", chain.n)
        return {"jb": chain.body_jacobian(q).tolist(), "js": chain.spatial_jacobian(q).tolist()}

    return answered(answer)


def ik(kinematic: KinematicOption = None, tool: ToolOption = None, arm: ArmOption = None,
       path: PathOption = None) -> int:
    """Joints for a pose. In: {"goal": 4×4, "seed": [...]}. Out adds ok, q and reason (empty if ok).

    Without a solution q is the seed. The seed may be left out: then it is the middle of the joints' ranges.

    Example: trocar kinematics ik --arm arms/MTML-demo.yaml < goals.jsonl
    """
    offline = load(kinematic, tool, arm, path)
    chain = forward(offline)
    try:
        solver = inverse_of(offline.kind, offline.chain, offline.tool,
                            offline.endoscope.tip if offline.endoscope else None)
    except ValueError as error:
        raise Problem(str(error)) from None
    middle = 0.5 * (chain.lower + chain.upper)

    def answer(row: Row) -> Row:
        goal = matrix(row, "goal")
        seed = joints(row, "seed", chain.n) if "seed" in row else middle
        ok = solver.solve(goal, seed)
        return {"ok": ok, "q": solver.q.tolist(), "reason": solver.reason}

    return answered(answer)


def gravity(kinematic: KinematicOption = None, tool: ToolOption = None, arm: ArmOption = None,
            path: PathOption = None,
            camera_mass: Annotated[float | None, typer.Option("--camera-mass", min=0.0, metavar="KG",
                                                              help="Of an ECM; default: its endoscope's.")] = None,
            ) -> int:
    """Holding efforts. In: {"q": [...]}, optional pitch (mounting, rad), for masters qd. Out adds tau, N·m or N.

    Joints are those of the arm, or of the links of the file that has the masses.

    Example: echo '{"q": [0, 0, 0.1, 0], "pitch": -0.785}' | trocar kinematics gravity --kinematic kinematic/ECM.json
    """
    offline = load(kinematic, tool, arm, path)
    if offline.master_gravity is not None:
        master = MasterGravity(offline.master_gravity)
        return answered(lambda row: {"tau": master.effort(
            joints(row, "q", 7), joints(row, "qd", 7) if "qd" in row else np.zeros(7)).tolist()})
    weights = offline.weights
    if weights is None:
        raise Problem(f"{offline.chain.source}: no link has a mass: this arm is not compensated, or needs --arm FILE")
    camera = camera_mass if camera_mass is not None else offline.endoscope.mass if offline.endoscope else None

    def answer(row: Row) -> Row:
        q = joints(row, "q", None)
        pitch = row.get("pitch", offline.mounting_pitch)
        if not isinstance(pitch, int | float) or not np.isfinite(pitch):
            raise Wrong("pitch: a number [rad]")
        try:
            return {"tau": Gravity(weights, len(q), up_of(pitch), camera).effort(q).tolist()}
        except ValueError as error:
            raise Wrong(str(error)) from None

    return answered(answer)


def load(kinematic: Path | None, tool: Path | None, arm: Path | None, path: list[Path] | None) -> OfflineArm:
    """What the options name; Misuse without a file, Problem with every mistake of the files."""
    if kinematic is None and arm is None:
        raise Misuse("no arm given; use --kinematic FILE or --arm FILE")
    offline, problems = load_offline(kinematic, tool, arm, search=path or ())
    if offline is None:
        raise Problem("\n".join(str(problem) for problem in problems))
    return offline


def forward(offline: OfflineArm) -> Kinematics:
    """The whole chain, with its tip."""
    return Kinematics(offline.chain, offline.tool, offline.endoscope.tip if offline.endoscope else None)


def answered(answer: Answer) -> int:
    """Answer standard input line by line; exit code 1 when a line was wrong, which is said in its place."""
    code = 0
    for number, row in lines():
        try:
            if isinstance(row, Wrong):
                raise row
            reported = {**row, **answer(row)}
        except Wrong as wrong:
            code, reported = 1, {"line": number, "error": str(wrong)}
        tell(json.dumps(reported, allow_nan=False), flush=True)
    return code


def lines() -> Iterator[tuple[int, Row | Wrong]]:
    """Numbered objects of standard input; empty lines are passed over."""
    for number, text in enumerate(sys.stdin, 1):
        if not text.strip():
            continue
        try:
            row = json.loads(text)
        except ValueError as error:
            yield number, Wrong(f"not JSON: {error}")
            continue
        yield number, row if isinstance(row, dict) else Wrong("not an object like {\"q\": [...]}")


def joints(row: Row, key: str, count: int | None) -> Array:
    """(n,) of a line; Wrong unless they are so many finite numbers."""
    values = _numbers(row, key)
    if values.ndim != 1 or (count is not None and len(values) != count) or not len(values):
        raise Wrong(f"{key}: {count if count is not None else 'some'} numbers, one a joint; not shape {values.shape}")
    return values


def matrix(row: Row, key: str) -> Array:
    """(4, 4) of a line; Wrong unless it is a rigid transform."""
    values = _numbers(row, key)
    try:
        check_matrix(values)
    except PoseError as error:
        raise Wrong(f"{key}: {error}") from None
    return values


def _numbers(row: Row, key: str) -> Array:
    if key not in row:
        raise Wrong(f"{key} is missing")
    try:
        values = np.array(row[key], dtype=np.float64)
    except (ValueError, TypeError):
        raise Wrong(f"{key}: not numbers") from None
    if not np.isfinite(values).all():
        raise Wrong(f"{key}: not finite")
    return values
