"""Joint spaces of every kind of arm, with an instrument and without: all that the others read of them."""

from __future__ import annotations

import dataclasses
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.arm.arm_configs import CHAIN, TOOL, bare_arm, fixed_arm
from tests.cases import cases
from tests.traces import Trace
from trocar.procs.arm.joints import JointSpace, joints, kinematic_home
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.arms import ArmConfig, Tool

FILES = ("demo", "demo-psm-si", "demo-ecm", "demo-ecm-si", "demo-mtm")
ARRAYS = ("lower", "upper", "v_max", "a_max", "effort_speed", "effort_zone", "rated", "to_joint", "to_actuator", "none")


NAMES = ("demo PSM1", "demo PSM1 bare", "demo-psm-si PSM1", "demo-psm-si PSM1 bare", "demo-ecm ECM", "demo-ecm-si ECM",
         "demo-mtm MTML", "demo-mtm MTMR", "PSM with a snake")


@cache
def arms() -> dict[str, tuple[ArmConfig, Tool | None]]:
    found: dict[str, tuple[ArmConfig, Tool | None]] = {}
    for file in FILES:
        system = load_system(PROJECT_CONFIGS / "systems" / f"{file}.yaml").system
        assert system is not None
        found |= {f"{file} {arm.name}": (arm, arm.tool) for arm in system.arms}
        found |= {f"{file} {arm.name} bare": (arm, None) for arm in system.arms if arm.tool}
    found["PSM with a snake"] = (found["demo PSM1"][0], stock.tool("NEEDLE_DRIVER_400117"))
    return found


def shown(space: JointSpace) -> list[tuple[str, object]]:
    axes = range(space.size)
    return [("tool", space.tool), ("names", space.names), ("count", space.count), ("size", space.size),
            ("axes", space.axes), ("jaw", space.has_jaw), ("one to one", space.one_to_one),
            ("called", [space.name(axis) for axis in axes]), ("units", [space.unit(axis) for axis in axes]),
            ("kinematics", space.kinematics is not None), ("inverse", space.inverse is not None),
            *((name, "-" if value is None else value) for name, value in (("free", space.free),
                                                                          ("paired", space.paired))),
            *((name, getattr(space, name)) for name in ARRAYS)]


def test_joint_spaces_are_what_they_were() -> None:
    trace = Trace()
    assert tuple(sorted(arms())) == tuple(sorted(NAMES))
    for name in NAMES:
        arm, tool = arms()[name]
        space = joints(arm, tool)
        trace.look([name], [*shown(space), ("home", kinematic_home(arm, space))])
    trace.compare(Path(__file__).parent / "traces" / "joint-spaces.txt")


@cases("name", NAMES)
def test_power_is_the_same_for_joints_and_actuators(name: str) -> None:
    space = joints(*arms()[name])
    there = space.to_joint @ space.to_actuator
    assert there == pytest.approx(np.eye(space.size) if space.paired is None else space.paired, abs=1e-9)
    assert space.to_actuator @ space.to_joint == pytest.approx(np.eye(space.axes), abs=1e-9)


@cases("name", NAMES)
def test_what_is_clipped_comes_to_its_limit_and_may_stay_where_it_is(name: str) -> None:
    space, random = joints(*arms()[name]), np.random.default_rng(1)
    inside = 0.5 * (space.lower + space.upper)
    assert not space.clip(inside.copy()).any() and space.clip(inside.copy()) is space.none
    for _ in range(30):
        values = inside + random.choice((0.0, 0.3, 0.6, -0.7), size=space.size) * (space.upper - space.lower)
        wanted = values.copy() if space.paired is None else space.paired @ values
        here = inside + random.choice((0.0, 0.55, -0.8), size=space.size) * (space.upper - space.lower)
        for lower, upper, place in ((space.lower, space.upper, None),
                                    (np.minimum(space.lower, here), np.maximum(space.upper, here), here)):
            got = values.copy()
            outside = space.clip(got, place)
            assert (got == np.clip(wanted, lower, upper)).all() and (outside == (got != wanted)).all()


def test_what_became_of_joints_is_told_with_names_and_units() -> None:
    space = joints(fixed_arm(), TOOL)
    which = np.array((True, False, True, False, False, False, True))
    assert space.named(which) == "yaw, insertion, jaw"
    assert space.changed(which, np.arange(7) + 0.1234, np.zeros(7)) == (
        "yaw 0.123 → 0.000 rad, insertion 2.123 → 0.000 m, jaw 6.123 → 0.000 rad")
    bare = joints(bare_arm())
    assert bare.changed(np.arange(7) > 1, np.ones(7), np.zeros(7)).startswith(
        "insertion 1.000 → 0.000 m, disc_1 1.000 → 0.000 rad")
    assert bare.lacks_inverse == "there is no instrument, so no tip"
    assert space.lacks_inverse == "no inverse kinematics of this arm"


def test_chains_of_another_length_cannot_be_driven() -> None:
    short = dataclasses.replace(CHAIN, links=CHAIN.links[:2])
    ecm = arms()["demo-ecm ECM"][0]
    for arm, tool, reason in (
            (dataclasses.replace(bare_arm(), chain=short), None,
             "PSM1: PSM.json has 2 joints; a PSM has 3"),
            (dataclasses.replace(ecm, chain=CHAIN), None, "ECM: PSM.json has 3 joints; an ECM has 4"),
            (fixed_arm(), dataclasses.replace(TOOL, links=TOOL.links[:2]),
             "PSM1: with LARGE_NEEDLE_DRIVER_400006 there are 5 joints; 6 were expected"),
            (fixed_arm(), dataclasses.replace(TOOL, snake=True),
             "PSM1: with LARGE_NEEDLE_DRIVER_400006 there are 6 joints; 8 were expected")):
        with pytest.raises(ValueError, match=f"^{re.escape(reason)}$"):
            joints(arm, tool)


def test_an_arm_says_nothing_of_efforts_that_its_file_does_not_rate() -> None:
    links = (dataclasses.replace(CHAIN.links[0], effort_max=0.0), *CHAIN.links[1:])
    space = joints(dataclasses.replace(fixed_arm(), chain=dataclasses.replace(CHAIN, links=links)), TOOL)
    assert space.rated[0] == np.inf and (space.rated[1:] < np.inf).all()
