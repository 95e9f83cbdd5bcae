"""The robot in space: where the links of every arm and setup arm are, from its joints and its kinematic chain."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.names import none_such
from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.cart import Cart, CartArm
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.rings import Rings, present, seen_ns
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import carrying, inverse_carrying
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import given_pose, inverse, matrix_from_pose, pose_from_matrix
from trocar.procs.kinematics.trajectory import Trajectory
from trocar.procs.kinematics.walls.recorded import recorded_walls
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.memory.segment import SegmentError

Array = NDArray[np.float64]
LATE_NS: Final = 500_000_000
NEAR: Final = 0.03
"""Fraction of its range to which a joint may approach a limit without notice."""
SLACK: Final = 1e-6
DAMPING: Final = 1e-5
"""Limits joint velocities where a chain is singular."""


class SceneArm:
    """One arm: the frames of its links in the frame in which its poses are given."""

    def __init__(self, document: SystemConfig, arm: ArmConfig, rings: Rings = present) -> None:
        """Attach; SegmentError when its record cannot be read."""
        self._arm = arm
        self._reader = rings(document.name, arm.name, "state", "arm")
        self._cells = {name: self._reader.field(name) for name in (
            "position", "count", "tool", "base_frame", "reference_frame", "state", "valid", "has_jaw", "jaw_position",
            "setpoint_position", "gripper_position", "reference_valid", "trajectory_ratio_v", "trajectory_ratio_a")}
        self._tool, self.kinematics = "", carrying(arm, arm.endoscope)
        self._solver: InverseSolver | None = None
        self._sequence, self._seen_ns = 0, 0
        self._base = np.eye(4)

    def read(self, now_ns: int) -> dict[str, Any]:
        """`frames`: x y z and quaternion x y z w of the base, of each joint and of the tip, one after the other.

        `late`: they are old, `age` s. `turns` (rad): angles of the arm's parts with meshes about their own z.
        """
        if not self.look():
            return {"frames": [], "late": True}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, seen_ns(self._reader, now_ns)
        cells, count = self._cells, min(self.kinematics.n, int(self._cells["count"]))
        is_late = now_ns - self._seen_ns > LATE_NS
        q = np.nan_to_num(cells["position"][:self.kinematics.n])
        q[count:] = 0.0
        known = dict(zip(self.kinematics.names, q.tolist(), strict=True))
        return {"frames": frames_of(self.kinematics, q, self._base),
                "turns": [round(row.turn(known), 5) for row in self._arm.meshes], "near": self.near(q, NEAR).tolist(),
                "state": cells["state"].item().decode(errors="replace"),
                "jaw": float(cells["jaw_position"]) if cells["has_jaw"] else None,
                "frame": cells["reference_frame"].item().decode(errors="replace"),
                "valid": bool(cells["valid"]), "late": is_late,
                "age": round((now_ns - self._seen_ns) * 1e-9) if is_late else 0}

    def look(self) -> bool:
        """Take base and instrument of the newest record; whether there is one."""
        if not self._reader.newest():
            return False
        tool = self._cells["tool"].item().decode(errors="replace") or self._arm.endoscope
        if tool != self._tool:
            self._tool, self.kinematics, self._solver = tool, carrying(self._arm, tool), None
        base = self._cells["base_frame"]
        self._base = matrix_from_pose(base) if np.isfinite(base).all() and base[3:].any() else np.eye(4)
        return True

    def near(self, q: Array, share: float) -> NDArray[np.bool_]:
        """Which joints are so near to a limit, as a share of their range, or beyond one."""
        lower, upper = self.kinematics.lower, self.kinematics.upper
        found: NDArray[np.bool_] = np.minimum(q - lower, upper - q) < share * (upper - lower)
        return found

    def at(self, q: Array) -> dict[str, Any]:
        """Where its links would be at these joints, and which of those are beyond their limits."""
        if len(q) != self.kinematics.n:
            raise ValueError(f"{self._arm.name} has {self.kinematics.n} joints now, not {len(q)}")
        return {"frames": frames_of(self.kinematics, q, self._base), "beyond": self.near(q, -SLACK).tolist(),
                "seconds": self.seconds(q)}

    def seconds(self, q: Array) -> float | None:
        """Duration of a move there, planned as the arm does; None: it would be refused."""
        n, cells = self.kinematics.n, self._cells
        limits = ARM_TYPES[self._arm.type].moves.scaled(*(float(cells[f"trajectory_ratio_{x}"]) or 1.0 for x in "va"))
        v_max, a_max = (np.pad(row[:n], (0, max(0, n - len(row))), mode="edge") for row in limits)
        trajectory = Trajectory(n, self._arm.jerk_time_s)
        begin = np.nan_to_num(cells["setpoint_position"][:n])
        error = trajectory.start(begin, np.zeros(n), np.array(q), v_max, a_max, 0.0)
        return None if error is not None else round(trajectory.duration, 1)

    def reaching(self, pose: Array) -> dict[str, Any]:
        """The same for a pose (7,) of its tip in the frame of its poses; ValueError: out of reach, with the reason."""
        cells, name = self._cells, self._arm.name
        if not cells["reference_valid"]:
            raise ValueError(f"{name}: its tip is not known")
        if self._solver is None:
            self._solver = inverse_carrying(self._arm, self._tool)
        seed = np.nan_to_num(cells["setpoint_position"][:self.kinematics.n])
        if not self._solver.solve(inverse(self._base) @ given_pose(pose), seed):
            raise ValueError(f"{name} cannot go there: {self._solver.reason}")
        return self.at(self._solver.q)

    def velocity(self, twist: Array, in_tip: bool) -> Array:
        """Joint velocities (n,) that move the tip so, m/s and rad/s in axes of the tip or of the frame of its poses.

        Where a joint would be faster than in moves, as near the remote centre, the whole motion is that much slower.
        """
        n = self.kinematics.n
        if int(self._cells["count"]) != n:
            raise ValueError(f"{self._arm.name}: its tip is not known")
        q = np.nan_to_num(self._cells["position"][:n])
        found = joint_velocity(self.kinematics, q, twist, None if in_tip else self._base[:3, :3])
        return slowed(found, ARM_TYPES[self._arm.type].moves.velocity)

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


class SceneWalls:
    """The walls of one arm."""

    def __init__(self, system: str, arm: str, rings: Rings = present) -> None:
        """Attach; SegmentError when its record cannot be read."""
        self._reader = rings(system, arm, "walls", "arm")
        self._sequence, self._shown = 0, dict[str, Any]()

    def read(self) -> dict[str, Any]:
        """`walls`: shape, side, pose in its frame, size, and how near the setpoint is; `at`: the one that stops it."""
        if self._reader.newest() and self._reader.sequence != self._sequence:
            self._sequence = self._reader.sequence
            stopped = self._reader.field("stopped_by").item().decode(errors="replace")
            self._shown = {"at": stopped, "walls": [
                {"name": row.wall.name, "shape": row.wall.shape, "keep": row.wall.keep, "frame": row.wall.frame,
                 "pose": [*row.wall.position, *row.wall.orientation], "size": row.wall.size,
                 "near": row.nearness}
                for row in recorded_walls(self._reader.field)]}
        return self._shown

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


class SceneCart:
    """One cart."""

    def __init__(self, system: str, cart: Cart, rings: Rings = present) -> None:
        """Attach; SegmentError when its record cannot be read."""
        self._reader = rings(system, cart.name, "state", "suj")
        self._positions, self._valid = (self._reader.field(name) for name in ("position", "setup_valid"))
        self._arms = [(place, arm, Kinematics(arm.chain)) for place, arm in enumerate(cart.arms)
                      if arm.chain is not None and arm.world is not None and arm.tip is not None]
        self._sequence, self._seen_ns = 0, 0
        self._shown: dict[str, tuple[bytes, list[float]]] = {}

    def read(self, now_ns: int) -> dict[str, Any]:
        """Of each setup arm: `frames` in the cart, x y z and quaternion x y z w of its base, of each joint and of the
        base of the arm that it carries; whether its joints are known; the arm that it carries."""
        if not self._reader.newest():
            return {}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, seen_ns(self._reader, now_ns)
        late = now_ns - self._seen_ns > LATE_NS
        return {arm.name: {"frames": self._frames(place, arm, kinematics), "late": late,
                           "valid": bool(self._valid[place]), "carries": arm.carries}
                for place, arm, kinematics in self._arms}

    def _frames(self, place: int, arm: CartArm, kinematics: Kinematics) -> list[float]:
        position = np.nan_to_num(self._positions[place, :arm.joints])
        key, before = position.tobytes(), self._shown.get(arm.name)
        if before is None or before[0] != key:  # setup arms are at rest nearly all the time
            before = self._shown[arm.name] = key, setup_frames(arm, kinematics, position)
        return before[1]

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


def setup_frames(arm: CartArm, kinematics: Kinematics, position: Array) -> list[float]:
    """Poses of base, joints and carried base, 7 numbers each; joints without potentiometers are at 0."""
    q = np.zeros(kinematics.n)
    q[:len(position)] = position
    return frames_of(kinematics, q, np.array(arm.world), np.array(arm.tip))


def frames_of(kinematics: Kinematics, q: Array, base: Array, carried: Array | None = None) -> list[float]:
    """Poses of base, joints and tip, or of the `carried` part there, 7 numbers each, of an arm with this base."""
    poses = [pose_from_matrix(base)]
    matrix = np.eye(4)
    for frame in kinematics.links.frames(q.tolist()):
        matrix[:3] = np.reshape(frame, (3, 4))
        poses.append(pose_from_matrix(base @ matrix))
    tip = base @ kinematics.fk(q)
    poses.append(pose_from_matrix(tip if carried is None else tip @ carried))
    return [round(float(value), 5) for value in np.concatenate(poses)]


def slowed(velocity: Array, most: Sequence[float]) -> Array:
    """Joint velocities (n,) in the same direction, none beyond `most`; joints without an entry use the last one."""
    n = len(velocity)
    bounds = np.pad(np.array(most[:n]), (0, max(0, n - len(most))), mode="edge")
    return velocity / max(1.0, float(np.abs(velocity / bounds).max(initial=0.0)))


def joint_velocity(kinematics: Kinematics, q: Array, twist: Array, base: Array | None) -> Array:
    """Joint velocities for this tip motion; in the tip's axes, or in axes oriented like `base`.

    Chains with fewer than six joints realize rotations as closely as possible, and translations with any resulting
    rotation.
    """
    kinematics.update(q)
    if base is not None:
        turn = base @ kinematics.tip[:3, :3]
        twist = np.concatenate((turn.T @ twist[:3], turn.T @ twist[3:]))
    rows = 6 if kinematics.n >= 6 or twist[3:].any() else 3
    jacobian = kinematics.body[:rows]
    found: Array = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(rows), twist[:rows])
    return found


class ShownPose:
    """The pose of an arm, or setup arm, that a program shows: `trocar commission` while it asks for it."""

    def __init__(self, document: SystemConfig, rings: Rings = present) -> None:
        """Attach; SegmentError when the system's record cannot be read."""
        self._reader = rings(document.name, "system", "state", "system")
        self._arm, self._position = (self._reader.field(name) for name in ("shown_arm", "shown_position"))
        self._setups = {f"{cart.name}/{arm.name}": (arm, Kinematics(arm.chain)) for cart in document.carts
                        for arm in cart.arms if arm.chain is not None and arm.world is not None}
        self._sequence, self._seen_ns = 0, 0

    def read(self, now_ns: int, arms: Mapping[str, SceneArm]) -> dict[str, Any] | None:
        """`name` and `frames`; None: none is shown."""
        if not self._reader.newest():
            return None
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, seen_ns(self._reader, now_ns)
        name = self._arm.item().decode(errors="replace")
        if not name or now_ns - self._seen_ns > LATE_NS:
            return None
        position = np.nan_to_num(self._position)
        if name in self._setups:
            arm, kinematics = self._setups[name]
            return {"name": name, "frames": setup_frames(arm, kinematics, position[:arm.joints])}
        scene = arms.get(name)
        if scene is None:
            return None
        return {"name": name, "frames": scene.at(position[:scene.kinematics.n])["frames"]}

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


class SceneSource:
    """All arms and carts, in one message."""

    def __init__(self, document: SystemConfig, rings: Rings = present) -> None:
        self._arms: dict[str, SceneArm] = {}
        self._walls: dict[str, SceneWalls] = {}
        for arm in document.arms:
            with contextlib.suppress(SegmentError):
                self._arms[arm.name] = SceneArm(document, arm, rings)
                self._walls[arm.name] = SceneWalls(document.name, arm.name, rings)
        self._carts: dict[str, SceneCart] = {}
        for cart in document.carts:
            with contextlib.suppress(SegmentError):
                self._carts[cart.name] = SceneCart(document.name, cart, rings)
        self._shown: ShownPose | None = None
        with contextlib.suppress(SegmentError):
            self._shown = ShownPose(document, rings)

    def read(self, now_ns: int) -> dict[str, Any]:
        """`arms`, their `walls`, and `carts` with their setup arms, by name; `shown`: the pose that a program shows."""
        return {"age": 0.0, "arms": {name: arm.read(now_ns) for name, arm in self._arms.items()},
                "walls": {name: walls.read() for name, walls in self._walls.items()},
                "carts": {name: cart.read(now_ns) for name, cart in self._carts.items()},
                "shown": self._shown.read(now_ns, self._arms) if self._shown is not None else None}

    def close(self) -> None:
        """Unmap."""
        opened: tuple[SceneArm | SceneWalls | SceneCart, ...] = (
            *self._arms.values(), *self._walls.values(), *self._carts.values())
        for each in opened:
            each.close()
        if self._shown is not None:
            self._shown.close()


class ArmModels:
    """Computations for pages, without commands to arms: a preview of a move, joint velocities for a tip motion."""

    def __init__(self, document: SystemConfig) -> None:
        self._document = document
        self._arms: dict[str, SceneArm] = {}

    def arm(self, name: str) -> SceneArm:
        """The arm in its current state; ValueError if there is none."""
        if name not in self._arms:
            arm = next((row for row in self._document.arms if row.name == name), None)
            if arm is None:
                raise ValueError(none_such("arm", name[:80], [row.name for row in self._document.arms]))
            self._arms[name] = SceneArm(self._document, arm)
        self._arms[name].look()
        return self._arms[name]

    def close(self) -> None:
        """Unmap."""
        for arm in self._arms.values():
            arm.close()
        self._arms.clear()
