"""PSMs of real sites on emulated boards, stepped: what is put on is engaged, and kept when their process dies."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache, cached_property

import numpy as np
import pytest

from tests.arm.on_boards import SLOW, OnBoards, of_site
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.instruments import EmulatedInstruments
from trocar.procs.host.objects import RememberedObjects
from trocar.procs.kinematics.forward import Kinematics

pytestmark = pytest.mark.slow
MAX_JUMP = 0.5e-3  # m
NEEDLE_DRIVER = "LARGE_NEEDLE_DRIVER:400006"
SITES = (("jhu-dVRK", "5MM_NEEDLE_DRIVER:400117"),
         pytest.param("jhu-daVinci-Si", "LARGE_NEEDLE_DRIVER:420006[11]", marks=pytest.mark.soak))


class Site:
    """The PSM1 of a site, with somebody who puts things on it."""

    def __init__(self, site: str) -> None:
        self.robot = robot = of_site(f"{site}/system-PSM1", "PSM1", *SLOW)
        robot.document = dataclasses.replace(robot.document, tool_detection="MANUAL")
        robot.start_arm()
        world, plant = robot.harness.world, robot.harness.plant
        self.board_faults = BoardFaults(world, plant)
        self.hands = EmulatedInstruments(robot.system.emulated(), world, self.board_faults, plant)

    def with_adapter(self) -> None:
        """Homed; its adapter is put on, and being engaged."""
        self.robot.run(0.6)
        self.robot.homed()
        self.board_faults.press("PSM1_adapter", True)
        self.robot.until(lambda: self.robot.arm.state == "ENGAGING_ADAPTER", 3.0)

    def until_engaged(self) -> None:
        self.robot.until(lambda: self.robot.state["is_homed"])

    def put_on(self, name: str) -> None:
        """Named when the arm asks; the arm begins to engage it."""
        self.hands.insert("PSM1", name)
        self.robot.until(lambda: self.robot.reports.of("tool_type_request"), 3.0)
        assert self.robot.do("set_tool_type", (), name).outcomes == ["done"]
        assert self.robot.arm.state == "ENGAGING_TOOL"


def problems(robot: OnBoards) -> list[object]:
    return [*robot.harness.errors(), *robot.reports.of("error")]


def tip(robot: OnBoards) -> np.ndarray:
    """Where the tip really is."""
    space = robot.arm.joints
    return Kinematics(robot.document.chain, robot.arm.detection.tool).fk(
        (space.to_joint @ robot.truth)[: space.count].copy(), np.eye(4))[:3, 3]


class EngagedSite:
    """A site on the way to an instrument that is on; tests begin where they need it, as engaging takes half a minute.

    `begun`: its adapter is being engaged, `bare`: it is engaged, `whole`: a needle driver is engaged as well.
    """

    def __init__(self, site: str) -> None:
        self.site = Site(site)
        self.site.with_adapter()
        self.begun = RememberedObjects({"site": self.site})
        self.site.until_engaged()
        assert self.site.robot.state["count"] == 7 and not problems(self.site.robot)
        self.bare = RememberedObjects({"site": self.site})

    @cached_property
    def whole(self) -> RememberedObjects:
        self.bare.put_back()
        self.site.put_on(NEEDLE_DRIVER)
        self.site.until_engaged()
        return RememberedObjects({"site": self.site})


@pytest.fixture(scope="module")
def engaging() -> Callable[[str], EngagedSite]:
    """By site."""
    return cache(EngagedSite)


@pytest.mark.parametrize(("site", "name"), SITES)
def test_adapter_and_instrument_of_a_real_site_are_engaged(engaging: Callable[[str], EngagedSite], site: str, name: str
                                                           ) -> None:
    engaging(site).bare.put_back()
    made = engaging(site).site
    robot = made.robot
    made.put_on(name)
    made.until_engaged()
    engaged_well(robot, 8 if "5MM" in name else 6)


def engaged_well(robot: OnBoards, joints: int) -> None:
    robot.run(0.2)
    assert robot.state["count"] == joints and robot.state["cartesian_valid"]
    assert not problems(robot) and not robot.reports.of("goal_reached")
    assert np.abs(robot.truth[3:]).max() < 0.03


def test_a_process_that_dies_while_engaging_begins_it_again(engaging: Callable[[str], EngagedSite]) -> None:
    made = engaging("jhu-dVRK").site
    engaging("jhu-dVRK").begun.put_back()
    dies_while_engaging(made)
    engaging("jhu-dVRK").bare.put_back()
    made.put_on(NEEDLE_DRIVER)
    dies_while_engaging(made)
    made.until_engaged()
    engaged_well(made.robot, 6)


def dies_while_engaging(made: Site) -> None:
    robot, state = made.robot, made.robot.arm.state
    assert state in ("ENGAGING_ADAPTER", "ENGAGING_TOOL")
    robot.run(2.0)
    robot.away(0.3)
    held = robot.truth.copy()
    robot.until(lambda: robot.arm.state == state, 0.1)
    assert np.abs(robot.truth - held).max() < 1e-3
    robot.run(1.0)
    assert robot.arm.state == state and not problems(robot)


@pytest.fixture
def site(engaging: Callable[[str], EngagedSite]) -> Site:
    """A needle driver engaged."""
    engaging("jhu-dVRK").whole.put_back()
    return engaging("jhu-dVRK").site


@pytest.mark.parametrize("doing", (
    pytest.param("holding", marks=pytest.mark.soak), "moving", "effort", "clutched"))
def test_a_process_that_dies_with_an_instrument_on_jerks_nothing(site: Site, doing: str) -> None:
    robot = site.robot
    move = robot.do("move_jp", (0.1, -0.1, 0.12, 0.2, 0.1, -0.1))
    robot.until(lambda: "done" in move.outcomes)
    robot.run(0.3)
    if doing == "moving":
        robot.do("move_jp", (0.5, 0.3, 0.2, 0.2, 0.1, -0.1))
    elif doing == "effort":
        robot.do("body/servo_cf", (0.0,) * 6)
    elif doing == "clutched":
        site.board_faults.press("PSM1_arm_clutch", True)
    robot.run(0.4)
    before, jumps = tip(robot), [0.0]

    def look() -> None:
        jumps.append(float(np.linalg.norm(tip(robot) - last[0])))
        last[0] = tip(robot)

    for _ in range(round(0.3 / robot.period_s)):
        robot.step(alive=False)
    robot.start_arm()
    last = [tip(robot)]
    robot.run(0.2, look)
    assert robot.arm.state == ("MANUAL" if doing == "clutched" else "HOMED")
    assert max(jumps) < MAX_JUMP / 5 and robot.state["count"] == 6 and robot.state["instrument"] == 4
    if doing != "moving":
        assert np.linalg.norm(last[0] - before) < MAX_JUMP
    assert not problems(robot)
