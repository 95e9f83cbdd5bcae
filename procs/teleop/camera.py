"""Camera control with two masters: the operator holds the scene between the hands.

Positions and velocities are in the masters' reference frame (x right, y up, z away from the view), in m and m/s; ECM
joints are yaw, pitch, insertion, roll (rad, m). Formulas as in dVRK 2.4, mtsTeleOperationECM, in closed form.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array

STIFFNESS: Final = 150.0  # N/m: keeps the distance between the hands
DAMPING: Final = np.array((10.0, 10.0, 40.0))  # N·s/m
LOWEST: Final = np.array((-0.4, -0.2, 0.01))  # m: both masters must be beyond this to begin
HIGHEST: Final = np.array((0.4, 0.2, 0.8))
APART: Final = 0.03  # m: closer together, across the view, small motions of the hands would turn the camera far


class Camera:
    """`goal` (4,) are the ECM's joints, `left_force` and `right_force` (3,) the forces on the masters."""

    def __init__(self, scale: float, roll_offset: float) -> None:
        """`scale` applies to the insertion only; `roll_offset` (rad) of the camera on the ECM."""
        self.scale, self._roll_offset = scale, roll_offset
        self.goal = np.zeros(4)
        self.left_force, self.right_force = np.zeros(3), np.zeros(3)
        self._first_joints = np.zeros(4)

    def begin(self, left: Array, right: Array, joints: Array) -> None:
        """Hold the scene from here on: positions (3,) of the masters, the ECM's setpoint (4,)."""
        self._first_joints[...] = self.goal[...] = joints
        span, centre, up, side = _scene(left, right)
        self._width, self._depth = 0.5 * float(side @ span), 0.5 * float(_unit(centre) @ span)
        self._distance = float(np.linalg.norm(centre))
        self._yaw, self._pitch, self._roll = _directions(centre, up)
        self._first_turn = _turn(joints)

    def step(self, left: Array, right: Array, left_velocity: Array, right_velocity: Array) -> Array:
        """The ECM's joints and the masters' forces for their positions and velocities (3,)."""
        _, centre, up, side = _scene(left, right)
        away = self._width * side + self._depth * _unit(centre)
        self.left_force[...] = STIFFNESS * (centre - away - left) - DAMPING * left_velocity
        self.right_force[...] = STIFFNESS * (centre + away - right) - DAMPING * right_velocity
        yaw, pitch, roll = _directions(centre, up)
        by_yaw = -_signed_angle(self._yaw, yaw, 1)
        by_pitch = _signed_angle(self._pitch, pitch, 0)
        by_roll = -_signed_angle(self._roll, roll, 2)
        by_depth = self.scale * (self._distance - float(np.linalg.norm(centre)))
        first = self._first_joints
        turn = by_roll + float(first[3]) + self._roll_offset
        cosine, sine = math.cos(turn), math.sin(turn)
        self.goal[...] = first
        self.goal += (by_yaw * cosine - by_pitch * sine, by_pitch * cosine + by_yaw * sine, by_depth, by_roll)
        return self.goal

    def orientation(self, first: Array) -> Array:
        """A master's orientation (3, 3) for the present goal, from its orientation `first` at `begin`."""
        return (_turn(self.goal) @ self._first_turn.T).T @ first


def outside(name: str, place: Array) -> str:
    """Why a master at `place` (3,) may not begin, "": it may."""
    if np.all((place >= LOWEST) & (place <= HIGHEST)):
        return ""
    at = ", ".join(f"{value:.3f}" for value in place)
    return (f"{name} is at ({at}) m, it must be within x ±0.4, y ±0.2, z 0.01 to 0.8: is its base frame set to the "
            "view's frame?")


def too_close(left: Array, right: Array, least: float = APART) -> str:
    """Why masters at these places (3,) give the camera no clear direction, "": they do.

    The roll of the scene is that of the line between them, as seen: it turns by a motion divided by their distance.
    """
    apart = float(np.linalg.norm(_cross(right - left, _unit(0.5 * (left + right)))))
    if apart >= least:
        return ""
    return (f"the masters are {apart * 1e3:.1f} mm apart in the view; required: {least * 1e3:.0f} mm; "
            "move the hands apart, and check the base frames of both masters")


def _scene(left: Array, right: Array) -> tuple[Array, Array, Array, Array]:
    """Vector from left to right; the middle; up and side of the plane through both and the eye."""
    span, centre = right - left, 0.5 * (left + right)
    up = _unit(_cross(span, centre))
    return span, centre, up, _unit(_cross(centre, up))


def _directions(centre: Array, up: Array) -> tuple[Array, Array, Array]:
    """Directions of the scene from above and from the side, and its roll."""
    return (_unit(np.array((centre[0], 0.0, centre[2]))), _unit(np.array((0.0, centre[1], centre[2]))),
            _unit(np.array((up[0], up[1], 0.0))))


def _signed_angle(first: Array, now: Array, axis: int) -> float:
    """The angle from one vector to another about an axis of the frame, to which both are perpendicular.

    Avoids the arc cosine, which turns a change in the last bit into 15 nrad for nearly equal vectors.
    """
    return math.atan2(float(_cross(first, now)[axis]), float(first @ now))


def _cross(first: Array, second: Array) -> Array:
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()  # numpy's takes ten times as long for one pair
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))


def _unit(vector: Array) -> Array:
    length = math.sqrt(vector @ vector)
    return vector / length if length > 0.0 else vector


def _turn(joints: Array) -> Array:
    """Rz(roll) · Ry(yaw) · Rx(pitch) of the ECM's joints."""
    (cz, sz), (cy, sy), (cx, sx) = ((math.cos(a), math.sin(a)) for a in (joints[3], joints[0], joints[1]))
    return np.array((
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (-sy, cy * sx, cy * cx),
    ))
