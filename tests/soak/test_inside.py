"""The judge of walls in the storm: what it sees, and what it does not mind."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tests.arm.arm_configs import fixed_arm
from tests.soak.inside import SetpointJudge
from tests.soak.motion import Truth
from trocar.shm.topics import ARM_STATE, ARM_WALLS

STEP_NS, COUNT, HERE = 2_000_000, 1000, (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)


def truth(topic: Any, fields: tuple[str, ...], count: int) -> Truth:
    """Records as the witness has them."""
    rows = [(field.name, field.dtype) for field in topic.fields if field.name in fields]
    made = np.zeros(count, dtype=[("epoch", "<u8"), ("stamp_ns", "<u8"), *rows])
    made["stamp_ns"] = 1_000_000_000 + STEP_NS * np.arange(count)
    return made


def states(depth: Any) -> Truth:
    """An arm that goes straight down (k,)."""
    made = truth(ARM_STATE, ("is_homed", "control_mode", "setpoint_position", "base_frame"), COUNT)
    made["is_homed"], made["control_mode"] = True, 1
    made["setpoint_position"][:, :6], made["setpoint_position"][:, 2] = HERE, depth
    made["base_frame"][:, 6] = 1.0
    return made


def floor() -> Truth:
    """A plane 0.13 m deep, for the tip."""
    made = truth(ARM_WALLS, tuple(field.name for field in ARM_WALLS.fields), 1)
    made["count"], made["active"][0, 0], made["pose"][0, 0] = 1, True, (0.0, 0.0, -0.13, 0.0, 0.0, 0.0, 1.0)
    for name, word in (("name", b"floor"), ("shape", b"plane"), ("keep", b"out"), ("of", b"tip"), ("frame", b"base")):
        made[name][0, 0] = word
    return made


def test_a_setpoint_that_enters_a_wall_is_seen_and_one_that_leaves_it_is_not_minded() -> None:
    judge = SetpointJudge(fixed_arm())
    down, up = np.linspace(0.11, 0.15, COUNT), np.linspace(0.16, 0.12, COUNT)
    assert judge.inside(states(down), floor()) and not judge.inside(states(up), floor())
    unpowered = states(down)
    unpowered["is_homed"][:] = False
    assert not judge.inside(unpowered, floor())


def test_a_setpoint_that_jumps_is_seen() -> None:
    judge = SetpointJudge(fixed_arm())
    assert judge.jumps(states(np.where(np.arange(COUNT) < 900, 0.1, 0.2))) and not judge.jumps(states(0.1))


def test_an_arm_that_comes_nearer_to_another_is_seen() -> None:
    judge, other = (SetpointJudge(dataclasses.replace(fixed_arm(), name=name)) for name in ("PSM1", "PSM2"))
    there, still = states(0.12), states(0.12)
    there["base_frame"][:, 0] = 0.02
    assert not judge.apart(other, still, there)
    turned = states(0.12)
    turned["setpoint_position"][:, 0] = np.linspace(0.0, 0.2, COUNT)
    mirrored = states(0.12)
    mirrored["setpoint_position"][:, 0] = np.linspace(0.0, -0.2, COUNT)
    assert bool(judge.apart(other, turned, there)) is not bool(judge.apart(other, mirrored, there))
