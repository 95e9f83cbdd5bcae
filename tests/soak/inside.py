"""Whether recorded setpoints were inside walls, nearer to the other arm than they may be, or jumped."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from tests.soak.judge import Violation, beyond_bounds
from tests.soak.motion import SetpointTrace, Truth, bounds
from trocar.procs.arm.joints import body_of, joints
from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.walls import ARMS, BASE
from trocar.procs.kinematics.poses import inverse, matrix_from_pose, normalised
from trocar.procs.kinematics.walls.moved import MovedWalls
from trocar.procs.kinematics.walls.recorded import RecordedWall, recorded_walls
from trocar.procs.kinematics.walls.walls import MOST, ArmWalls, pose_of

APART_M: Final = 0.005
EXACT_M, TRACKING_M = 2e-6, 3e-3
"""How far a setpoint may be inside a wall, and nearer to the other arm, which is where it is measured."""
CHANGE_NS, SETTLED_NS, GAP_NS = 20_000_000, 500_000_000, 50_000_000
MODES = (1, 2)  # position, trajectory
SPARSE = 10  # records: the distance of both arms is looked at less often


class SetpointJudge:
    """Of one arm."""

    def __init__(self, arm: ArmConfig) -> None:
        """It carries its one instrument."""
        self.arm, self._space = arm, joints(arm, arm.tool)
        space, self._n = self._space, self._space.count
        assert space.kinematics is not None
        self.kinematics, self.body = space.kinematics, body_of(arm, space)
        self._limits = ArmWalls(self.kinematics, self.body, space.lower[: self._n], space.upper[: self._n], space.free,
                                int(self.body.solid.sum()))

    def driven(self, state: Truth) -> Any:
        """Records (k,) in which it is homed and follows positions, and has done so for a while."""
        on = state["is_homed"] & np.isin(state["control_mode"], MODES)
        breaks = ~on
        breaks[1:] |= (np.diff(state["stamp_ns"]) > GAP_NS) | (np.diff(state["epoch"]) != 0)
        breaks[:1] = True
        last = np.maximum.accumulate(np.where(breaks, state["stamp_ns"], 0))
        return on & (state["stamp_ns"] - last > SETTLED_NS)

    def jumps(self, state: Truth) -> list[Violation]:
        """Setpoints that moved faster than streams and moves may."""
        on, count = self.driven(state), len(state)
        runs = np.cumsum(np.diff(on, prepend=False))
        return beyond_bounds(SetpointTrace(
            self.arm.name, "the arm with walls", state["stamp_ns"], state["setpoint_position"][:, : self._n], on,
            np.zeros(count, dtype=np.bool_), runs, self.kinematics.is_prismatic), bounds(self.arm.type)[: self._n])

    def inside(self, state: Truth, kept: Truth) -> list[Violation]:
        """Setpoints that were inside a wall, or went deeper into one."""
        found, least = list[Violation](), dict[str, float]()
        on = self.driven(state)
        for begin_ns, end_ns, walls in _spans(kept):
            first, last = np.searchsorted(state["stamp_ns"], (begin_ns, end_ns - CHANGE_NS))
            fixed = [row for row in walls if row.active and row.wall.frame == BASE and row.wall.shape != ARMS]
            least = {row.wall.name: least.get(row.wall.name, -np.inf) for row in fixed}
            self._put(fixed)
            for k in range(first, last):
                if not on[k]:
                    least = dict.fromkeys(least, -np.inf)
                    continue
                for row, value in zip(fixed, self._look(state["setpoint_position"][k]), strict=False):
                    name, most = row.wall.name, min(value, 0.0)
                    if value < least[name] - EXACT_M:
                        found.append(Violation(self.arm.name, int(state["stamp_ns"][k]), "walls", -1e3 * value,
                                               -1e3 * least[name], f"mm inside {row.wall.shape} {name}"))
                    least[name] = most if least[name] == -np.inf else max(most, least[name])
        return found

    def _put(self, walls: list[RecordedWall]) -> None:
        self._limits.guards[...] = 0
        for place, row in enumerate(walls):
            self._limits.put(place, row.wall, pose_of(row.wall))

    def _look(self, q: Any) -> list[float]:
        self._limits.goal[...] = q[: self._n]
        self._limits.look()
        values: list[float] = self._limits.value.min(axis=1).tolist()
        return values

    def apart(self, other: SetpointJudge, state: Truth, there: Truth) -> list[Violation]:
        """Setpoints nearer to those of the other arm than they may be, or than they were."""
        limits, n = self._limits, other.kinematics.n
        position = np.zeros(n)
        moved = MovedWalls(other.kinematics, other.body, np.eye(n), position)
        rows = slice(MOST, MOST + int(other.body.solid.sum()))
        moved.fill(limits.frames[rows], limits.size[rows], None)
        limits.guards[...], limits.group[rows], limits.margin[rows] = 0, 0, APART_M
        limits.guards[rows] = 15
        found, least, bases = list[Violation](), -np.inf, b""
        on, theirs_on = self.driven(state), other.driven(there)
        at = np.searchsorted(there["stamp_ns"], state["stamp_ns"]) - 1
        for k in range(0, len(state), SPARSE):
            frames = state["base_frame"][k], there["base_frame"][at[k]]
            now = frames[0].tobytes() + frames[1].tobytes()
            if at[k] < 0 or not on[k] or not theirs_on[at[k]] or now != bases:
                bases, least = now, -np.inf
                if at[k] < 0 or not on[k] or not theirs_on[at[k]]:
                    continue
            own, base = (matrix_from_pose(normalised(frame)) for frame in frames)
            moved.relation[...], position[...] = (inverse(own) @ base)[:3], there["setpoint_position"][at[k], :n]
            moved.follow()
            value = min(self._look(state["setpoint_position"][k])[rows])
            if value < least - TRACKING_M:
                found.append(Violation(self.arm.name, int(state["stamp_ns"][k]), "walls", -1e3 * value, -1e3 * least,
                                       f"mm nearer to {other.arm.name}"))
            least = min(value, 0.0) if least == -np.inf else max(min(value, 0.0), least)
        limits.guards[...] = 0
        return found


def _spans(kept: Truth) -> Iterator[tuple[int, int, list[RecordedWall]]]:
    """From each change of the walls to the next one."""
    whole, begin = b"", 0
    parts = [name for name in ("name", "pose", "size", "active", "margin", "of", "keep", "epoch") if len(kept)]
    starts = []
    for k in range(len(kept)):
        now = b"".join(kept[name][k].tobytes() for name in parts)
        if now != whole:
            whole = now
            starts.append(k)
    for begin, end in zip(starts, [*starts[1:], None], strict=True):
        row = kept[begin]
        yield (int(row["stamp_ns"]), int(kept["stamp_ns"][end]) if end is not None else 1 << 62,
               recorded_walls(lambda name, row=row: np.asarray(row[name])))
