"""Plans with a jerk limit, by the package ruckig, which has no build for ARM: https://docs.ruckig.com."""

from __future__ import annotations

import math

import ruckig

from trocar.procs.kinematics.pieces import Pieces, pieces
from trocar.procs.kinematics.poses import Array


def jerk_limited(position: Array, velocity: Array, acceleration: list[float], goal: Array, v_max: Array, a_max: Array,
                 jerk_time_s: float) -> tuple[float, tuple[Pieces, ...]]:
    """The duration, s, and the motions of all joints, which end at rest together; infinity: ruckig has found none.

    All (n,). Acceleration reaches its limit in `jerk_time_s`.
    """
    n = len(position)
    request, path = ruckig.InputParameter(n), ruckig.Trajectory(n)
    request.synchronization = ruckig.Synchronization.Phase  # by time if phase is not possible
    request.current_position, request.current_velocity = position.tolist(), velocity.tolist()
    request.current_acceleration, request.target_position = acceleration, goal.tolist()
    request.max_velocity, request.max_acceleration = v_max.tolist(), a_max.tolist()
    request.max_jerk = [a / jerk_time_s for a in a_max.tolist()]
    try:
        if ruckig.Ruckig(n).calculate(request, path) != ruckig.Result.Working:
            return math.inf, ()
    except (ruckig.RuckigError, ValueError):  # the latter for a move of more than 7600 s
        return math.inf, ()
    (profiles,) = path.profiles
    return path.duration, tuple([pieces(start, speed, (
        *zip(each.brake.t, each.brake.a, each.brake.j, strict=True), *zip(each.t, each.a, each.j, strict=False)))
        for start, speed, each in zip(position.tolist(), velocity.tolist(), profiles, strict=True)])
