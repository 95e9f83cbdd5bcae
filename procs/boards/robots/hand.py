"""A virtual hand: a spring and a damper between a robot's tip and a commanded pose.

It represents the surgeon's hand at a master's gripper. Force and torque are limited, so that a distant pose pulls no
harder than a person does; poses are targets, a path is a stream of poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.procs.boards.robots.plant import Plant
from trocar.procs.kinematics import poses
from trocar.procs.kinematics.poses import Array

MOST = (5000.0, 10.0, 200.0, 1.0, 100.0, 5.0)  # of each field of a grip: far from shaking at steps of 1 ms


@dataclass(frozen=True, slots=True)
class Grip:
    """Stiffness of a hand's grip; defaults: a relaxed person's grip on a master's gripper."""

    stiffness: float = 200.0  # N/m
    turning_stiffness: float = 0.4  # N·m/rad
    damping: float = 12.0  # N·s/m
    turning_damping: float = 0.008  # N·m·s/rad
    most_force: float = 20.0  # N
    most_torque: float = 0.4  # N·m

    @classmethod
    def of(cls, *values: float) -> Grip:
        """From the first few fields; ValueError: too much of one. Damping left out follows the stiffness."""
        for name, value, most in zip(cls.__slots__, values, MOST, strict=False):
            if not 0.0 <= value <= most:
                raise ValueError(f"a hand's {name.replace('_', ' ')} is {value:g}; allowed: 0 to {most:g}")
        usual = cls()
        given = dict(zip(cls.__slots__, values, strict=False))
        for damping, stiffness in (("damping", "stiffness"), ("turning_damping", "turning_stiffness")):
            ratio = given.get(stiffness, getattr(usual, stiffness)) / getattr(usual, stiffness)
            given.setdefault(damping, getattr(usual, damping) * math.sqrt(ratio))
        return cls(**given)


class Hands:
    """At most one hand per robot. No cost while there is none."""

    def __init__(self, plant: Plant, robots: tuple[str, ...]) -> None:
        """No hand on any robot; `robots` have a tip to hold."""
        self._plant, self._robots = plant, robots
        self._targets: dict[str, tuple[Array, Grip]] = {}

    def hold(self, robot: str, pose: Array, grip: Grip | None = None) -> None:
        """Pull the tip of a robot to a pose (7,) in its base frame; default grip: the previous one.

        PoseError, a ValueError, for an invalid pose; KeyError names the robots that have a tip.
        """
        self._look_for(robot)
        target = poses.matrix_from_pose(poses.normalised(pose))
        held = self._targets.get(robot)
        self._targets[robot] = target, grip or (held[1] if held else Grip())
        if self.pull not in self._plant.before_step:
            self._plant.before_step.append(self.pull)

    def release(self, robot: str) -> None:
        """Release the tip."""
        self._look_for(robot)
        self._targets.pop(robot, None)
        if not self._targets and self.pull in self._plant.before_step:
            self._plant.before_step.remove(self.pull)

    def pull(self) -> None:
        """Force and torque of every hand for the next step."""
        for robot, (target, grip) in self._targets.items():
            self._plant.pull(robot, wrench(target, grip, self._plant.tip(robot), self._plant.tip_twist(robot)))

    def _look_for(self, robot: str) -> None:
        if robot not in self._robots:
            raise KeyError(f"{robot or 'no name'}: no arm to hold; there are {', '.join(self._robots) or 'none'}")


def wrench(target: Array, grip: Grip, tip: Array, twist: Array) -> Array:
    """Force and torque (6,) of a hand on a tip, all in the base frame."""
    result = np.empty(6)
    force = grip.stiffness * (target[:3, 3] - tip[:3, 3]) - grip.damping * twist[:3]
    turn = poses.rotation_vector(target[:3, :3] @ tip[:3, :3].T)
    torque = grip.turning_stiffness * turn - grip.turning_damping * twist[3:]
    result[:3] = _limited(force, grip.most_force)
    result[3:] = _limited(torque, grip.most_torque)
    return result


def _limited(vector: Array, most: float) -> Array:
    length = math.sqrt(float(vector @ vector))
    return vector * (most / length) if length > most else vector
