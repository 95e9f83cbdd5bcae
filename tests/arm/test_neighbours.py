"""Walls that move with another arm, of which only its last record and io's measurements are there."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from tests import stock
from tests.arm.arm_configs import EYE, fixed_arm
from tests.arm.fake_io import ArmHarness, Record
from tests.arm.fake_requests import FakeRequest
from tests.arm.test_ecm import ecm
from tests.arm.test_governor import fastest, recording
from tests.arm.test_psm import DEEP, at
from tests.arm.test_walls import add, push, tip
from trocar.procs.arm.joints import joints
from trocar.procs.arm.neighbours import LARGEST
from trocar.procs.arm.other_arm import OtherArm
from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.walls import Wall
from trocar.procs.kinematics.poses import inverse, pose_from_matrix
from trocar.procs.native.library import native
from trocar.procs.tables.arm_types import ARM_TYPES, base_name
from trocar.shm.topics import ARM_STATE, IO_STATE

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")
ARMS = Wall("arms", "arms", margin=0.005, arms=("PSM2",))
HELD = dataclasses.replace(ARMS, unknown="hold")
FAR = (Wall("plane", "plane", (0.0, 0.0, -0.6)), Wall("box", "box", (0.5, 0.0, 0.0), size=(0.1, 0.1, 0.1)),
       Wall("sphere", "sphere", (0.0, 0.5, -0.2), size=(0.1,)), Wall("room", "sphere", size=(0.9,), keep="in"),
       Wall("cylinder", "cylinder", (-0.5, 0.0, -0.2), size=(0.05, 0.2)),
       Wall("cone", "cone", (0.0, -0.6, 0.0), (1.0, 0.0, 0.0, 0.0), (0.3,)),
       Wall("capsule", "capsule", (0.5, 0.5, -0.2), size=(0.05, 0.2)),
       Wall("view", "cone", size=(1.2,), keep="in", of="tip", frame="PSM2"))
NEAR_X, SIDE = -0.05, 0.03
"""m: where the other arm is, and where the own one goes: x of its base."""


class FakeOther:
    """Another arm: its record, which its process may have left behind, and io's."""

    def __init__(self, arm: ArmConfig | None = None) -> None:
        self.arm = arm or dataclasses.replace(fixed_arm(), name="PSM2")
        self.axes = ARM_TYPES[self.arm.type].actuators
        self.state = Record(ARM_STATE)
        self.measured = Record(IO_STATE, axes=self.axes, drives=self.axes, robots=1, inputs=0, outputs=0)
        self.measured["biased"][0] = True
        self.state["tool"][...], self.state["instrument"][...] = b"LARGE_NEEDLE_DRIVER_400006", 4
        self.put(np.eye(4), "world")
        self._stamp_ns = 5_000_000_000
        self.fresh = True
        """Its io measures."""
        self.harness: ArmHarness | None = None

    @property
    def stamp_ns(self) -> int:
        """When its io wrote its record."""
        if self.fresh and self.harness is not None:
            self._stamp_ns = self.harness.now_ns
        return self._stamp_ns

    def put(self, base: Any, frame: str = "world", *, known: bool = True) -> None:
        """Its base frame."""
        self.state["cartesian_valid"][...], self.state["reference_valid"][...] = True, known
        self.state["reference_frame"][...], self.state["base_frame"][...] = frame.encode(), pose_from_matrix(base)

    def go(self, q: Any) -> None:
        """To joints, and the jaw."""
        space = joints(self.arm, self.arm.tool)
        self.measured["position"][...] = space.to_actuator @ np.array(q)

    def other(self, name: str) -> OtherArm:
        """See ArmContext."""
        if name != self.arm.name:
            raise ValueError(name)
        return OtherArm(self.arm, self, self, 0, 0)

    # a reader of its record, and of io's

    def look(self, now_ns: int) -> bool:
        return now_ns > 0

    def field(self, name: str) -> Any:
        return self.state[name] if name in ARM_FIELDS else self.measured[name]


ARM_FIELDS = {"tool", "instrument", "reference_frame", "base_frame", "cartesian_valid", "reference_valid"}


def shifted(x: float) -> Any:
    base = np.eye(4)
    base[0, 3] = x
    return base


def beside(wall: Wall = ARMS, other: FakeOther | None = None) -> tuple[ArmHarness, FakeOther]:
    """Both straight down and 12 cm deep, the other one to the side."""
    there = other or FakeOther()
    if there.arm.type == "PSM":
        there.go((0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0))
    there.put(shifted(NEAR_X))
    made = there.harness = ArmHarness(fixed_arm(walls=(wall,), base_frame=EYE, reference_frame="world"),
                                      other=there.other)
    made = at(made.homed(), DEEP)
    made.run(0.1)
    return made, there


def slid(made: ArmHarness, x: float, speed: float = 0.05) -> list[str]:
    """Stream the tip to a place at its height."""
    return push(made, (x, 0.0, tip(made)[2]), speed)


def test_an_arm_stops_beside_another_and_names_it() -> None:
    made, _ = beside()
    assert made.walls["active"][0] and made.walls["distance"][0] == pytest.approx(0.05 - 2 * 0.0042 - 0.005, abs=1e-6)
    assert slid(made, NEAR_X)[-1] == "at wall arms: PSM2"
    assert made.walls["distance"][0] == pytest.approx(0.0, abs=1e-4) and made.walls.text("stopped_by") == "arms: PSM2"
    assert made.send("move_jp", (0.5, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes != made.send(
        "move_jp", (-0.5, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes, "one of both ways is free"


def test_an_arm_that_another_comes_near_to_stays_and_may_leave() -> None:
    made, there = beside()
    here = tip(made)
    there.put(shifted(-0.006))  # 7 mm nearer than it may be
    made.run(0.1)
    assert made.walls["distance"][0] == pytest.approx(-0.0074, abs=1e-4) and (tip(made) == here).all()
    slid(made, -0.02)
    assert tip(made)[0] == pytest.approx(here[0], abs=1e-5), "not nearer"
    slid(made, 0.02)
    assert tip(made)[0] == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize("wall", [ARMS, HELD])
@pytest.mark.parametrize("spoiled", ["base", "frame", "encoders", "numbers", "absurd", "never"])
def test_while_it_is_unknown_where_the_other_arm_is_the_wall_is_off_or_the_arm_holds(spoiled: str, wall: Wall) -> None:
    made, there = beside(wall)
    if spoiled in ("numbers", "absurd"):  # since this arm's process has run
        there.measured["position"][1] = math.nan if spoiled == "numbers" else 1e30
        made.start_arm()
        made.run(0.9)
    elif spoiled == "base":
        there.put(shifted(NEAR_X), known=False)
    elif spoiled == "frame":
        there.put(shifted(NEAR_X), "elsewhere")
    elif spoiled == "encoders":
        there.measured["biased"][0] = False
    else:
        there.measured["sample_age_ns"][0] = -1
    made.run(0.1)
    assert not made.walls["active"][0] and any(event[1] == "wall-off" for event in made.reports.events)
    here, goal = tip(made), made.state["setpoint_position"][:6].copy()
    goal[0] += 0.001
    answer = made.send("servo_jp", goal)
    made.run(0.1)
    assert answer.outcomes == ["done"] and ("at wall arms (" in answer.replies[-1][1]) is (wall is HELD)
    assert (tip(made) == here).all() is np.bool_(wall is HELD)
    goal[0] += 0.01
    assert made.send("move_jp", goal).outcomes[0] == ("refused" if wall is HELD else "accepted")


@pytest.mark.parametrize(("axis", "value"), [(1, math.nan), (0, 1e30), (2, -1e30), (0, 3.0), (2, 0.4), (5, 20.0)])
def test_of_an_arm_that_cannot_be_where_it_is_measured_its_last_place_counts_and_grows(axis: int, value: float) -> None:
    made, there = beside()
    before = float(made.walls["distance"][0])
    there.measured["position"][axis] = value
    made.run(0.02)
    assert float(made.walls["distance"][0]) == before
    made.run(0.08)
    assert made.walls["active"][0] and float(made.walls["distance"][0]) < before - 0.05


def test_an_arm_that_is_measured_no_more_may_be_anywhere_near_until_it_is_measured_again() -> None:
    made, there = beside()
    before, here = float(made.walls["distance"][0]), tip(made)
    assert there.stamp_ns == made.now_ns
    there.fresh = False
    made.run(0.025)
    assert float(made.walls["distance"][0]) == before
    made.run(1.0)
    assert float(made.walls["distance"][0]) == pytest.approx(before - LARGEST, abs=1e-6) and (tip(made) == here).all()
    answers = slid(made, -0.02)
    assert answers[-1].startswith("at wall arms: PSM2, not measured for ") and tip(made)[0] >= here[0] - 1e-9
    slid(made, 0.02)
    assert tip(made)[0] == pytest.approx(0.02, abs=1e-4), "leaving is free"
    there.fresh = True
    made.run(0.1)
    assert float(made.walls["distance"][0]) == pytest.approx(before, abs=1e-6)


def test_an_instrument_too_near_to_another_is_retracted_along_it() -> None:
    for tilt in (0.0, 0.1, -0.1):
        made, there = beside()
        turned = shifted(-0.006)
        turned[[0, 2], [0, 2]], turned[0, 2], turned[2, 0] = math.cos(tilt), math.sin(tilt), -math.sin(tilt)
        there.put(turned)
        made.run(0.1)
        here = tip(made)
        assert made.walls["distance"][0] < -0.007
        if tilt == 0.0:
            assert made.send("move_jp", (0.0, 0.0, 0.11, 0.0, 0.0, 0.0)).outcomes[-1] == "accepted"
            made.run(1.0)
        goal = made.state["local_setpoint_cp"].copy()
        for _ in range(600):
            goal[2] = min(goal[2] + 1e-4, here[2] + 0.03)
            made.send("servo_cp", goal, base_name("PSM1"))
        assert tip(made)[2] == pytest.approx(here[2] + 0.03, abs=5e-4), tilt


@pytest.mark.parametrize(("x", "tilt"), [(-0.010, 0.0), (-0.012, 0.0), (-0.012, -0.05), (-0.012, -0.1)])
def test_a_move_retracts_an_instrument_with_a_bent_wrist_that_is_too_near_to_another(x: float, tilt: float) -> None:
    made, there = beside()
    made = at(made, (0.0, 0.0, 0.12, 0.0, 0.6, 0.0))
    there.go((0.0, 0.0, 0.10, 0.0, 0.0, 0.0, 0.0))
    turned = shifted(x)
    turned[[0, 2], [0, 2]], turned[0, 2], turned[2, 0] = math.cos(tilt), math.sin(tilt), -math.sin(tilt)
    there.put(turned)
    made.run(0.1)
    assert made.walls["distance"][0] < 0.0
    move = made.send("move_jp", (0.0, 0.0, 0.07, 0.0, 0.6, 0.0))
    made.until(lambda: move.outcomes[-1] != "accepted")
    assert move.outcomes[-1] == "done", move.replies


def test_a_goal_from_which_a_wall_kept_an_arm_is_forgotten_with_its_stream() -> None:
    for wall in (ARMS, HELD):
        made, there = beside(wall)
        goal = made.state["setpoint_position"][:6].copy()
        goal[0] -= 0.09 * made.arm.control.motion.governor.speed[0]
        made.send("servo_jp", goal)
        if wall is HELD:
            there.measured["biased"][0] = False
        else:
            there.put(shifted(tip(made)[0] - 0.0134))
        made.run(1.5)
        here = tip(made)
        there.measured["biased"][0] = True
        there.put(shifted(-0.5))
        made.run(1.0)
        assert tip(made) == pytest.approx(here, abs=1e-6), wall.unknown


def test_an_arm_that_is_measured_no_more_does_not_push_this_one() -> None:
    made, there = beside()
    efforts = []
    for cycle in range(400):
        there.fresh = cycle < 50
        made.send("servo_cf", np.zeros(6))
        efforts.append(made.setpoint["effort"].copy())
    assert made.walls["distance"][0] < -0.05 and np.abs(efforts).max() == 0.0


def test_a_base_that_changes_moves_an_arm_that_is_measured_no_more_too() -> None:
    made, there = beside()
    there.fresh = False
    made.run(1.0)
    before = float(made.walls["distance"][0])
    there.put(shifted(NEAR_X - 0.1))
    made.run(0.1)
    assert float(made.walls["distance"][0]) == pytest.approx(before + 0.1, abs=1e-5)


def test_an_arm_without_an_instrument_is_nowhere_and_an_unknown_one_is_the_longest() -> None:
    made, there = beside()
    before = float(made.walls["distance"][0])
    there.state["instrument"][...], there.state["tool"][...] = 1, b""
    made.run(0.1)
    assert made.walls["active"][0] and math.isnan(made.walls["distance"][0])
    assert made.reports.of("warning") == [("warning", "other-arm-gone", "PSM1: arms: PSM2 has no instrument now")]
    there.state["instrument"][...] = 2
    there.go((0.0, 0.0, 0.12, 0.0, 0.0, 1.2, 0.0))  # a wrist that cannot be known: it counts as straight
    made.run(0.1)
    assert float(made.walls["distance"][0]) == pytest.approx(before, abs=1e-6)


def test_an_instrument_that_is_gone_is_reported_once_in_a_while_and_when_the_arm_is_homed_again() -> None:
    made, there = beside()

    def swap(times: int) -> int:
        for _ in range(times):
            there.state["instrument"][...], there.state["tool"][...] = 1, b""
            made.run(0.1)
            there.state["instrument"][...], there.state["tool"][...] = 4, b"LARGE_NEEDLE_DRIVER_400006"
            made.run(0.1)
        return sum(code == "other-arm-gone" for _, code, _ in made.reports.of("warning"))

    assert swap(5) == 1
    made.reports.events.clear()
    made.send("state_command", (), "disable")
    there.state["instrument"][...], there.state["tool"][...] = 1, b""
    made.run(2.0)
    assert not made.reports.of("warning")
    with made.hurried():
        made.reach("HOMED")
        made.run(0.1)
    assert [code for _, code, _ in made.reports.of("warning")] == ["other-arm-gone"]


def test_two_bases_are_related_through_the_tip_of_one_of_the_arms() -> None:
    camera = FakeOther(ecm())
    q = np.array((0.1, -0.2, 0.1, 0.3))
    camera.go(q)
    space = joints(camera.arm)
    assert space.kinematics is not None
    view = space.kinematics.fk(q, np.eye(4))
    wanted = dataclasses.replace(ARMS, arms=("ECM",))
    made, _ = beside(wanted, camera)
    distances = []
    own = shifted(0.05)
    for frames in ((own, "world", "world"), (inverse(view) @ own, "ECM", "Cart")):
        made.send("set_base_frame", pose_from_matrix(frames[0]), frames[1])
        camera.put(np.eye(4), frames[2])
        made.run(0.1)
        assert made.walls["active"][0]
        distances.append(float(made.walls["distance"][0]))
    kinematics = made.arm.control.joints.kinematics
    assert kinematics is not None
    made.send("set_base_frame", pose_from_matrix(np.eye(4)), "Cart")
    here = kinematics.fk(made.state["position"][:6], np.eye(4))
    camera.put(inverse(here) @ inverse(own), "PSM1")
    made.run(0.1)
    distances.append(float(made.walls["distance"][0]))
    np.testing.assert_allclose(distances, distances[0], atol=1e-7)


def test_a_wall_hangs_at_the_tip_of_the_endoscope_and_outlives_the_process() -> None:
    camera = FakeOther(ecm())
    camera.go((0.0, 0.0, 0.0, 0.0))
    made, _ = beside(Wall("floor", "plane", (0.0, 0.0, -0.2)), camera)
    camera.put(np.eye(4))
    space = joints(camera.arm)
    assert space.kinematics is not None
    view = space.kinematics.fk(np.zeros(4), np.eye(4))
    place = inverse(view) @ made.arm.control.joints.kinematics.fk(made.state["setpoint_position"][:6], np.eye(4))
    add(made, Wall("near", "sphere", tuple(place[:3, 3].tolist()), size=(0.01,), keep="in", of="tip", frame="ECM"))
    made.run(0.1)
    assert made.walls["active"][1] and made.walls["distance"][1] == pytest.approx(0.01, abs=1e-6)
    made.start_arm()
    made.run(1.0)
    assert made.walls["count"] == 2 and bytes(made.walls["frame"][1]) == b"ECM" and made.walls["active"][1]
    camera.go((0.0, 0.0, 0.02, 0.0))  # the camera advances, and the sphere with it
    made.run(0.1)
    assert made.walls["distance"][1] == pytest.approx(0.01 - 0.02, abs=1e-3)
    start = tip(made)
    push(made, start + (0.0, 0.0, -0.01))
    assert tip(made)[2] == pytest.approx(start[2] - 0.01, abs=1e-3), "towards the middle is free"
    assert made.send("add_wall", (0.0,) * 6 + (1.0, 0.01), "w sphere PSM9").outcomes == ["refused"]
    assert made.send("add_wall", (0.0,) * 6 + (1.0,), "w arms").outcomes == ["refused"]


@pytest.mark.parametrize(("name", "columns"), [("psm_measured_one.csv", slice(0, 7)),
                                               ("classic_tool_fixed.csv", slice(1, 7))])
def test_with_walls_far_away_recorded_motions_give_the_same_setpoints_bit_for_bit(name: str, columns: slice) -> None:
    positions = fastest(recording(name)[:, columns])[250:750]
    there = FakeOther()
    there.go((0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0))
    above = np.eye(4)
    above[2, 3] = 0.5
    there.put(above)
    walled = ArmHarness(fixed_arm(walls=(*FAR, ARMS), base_frame=EYE, reference_frame="world"), other=there.other)
    there.harness = walled
    free = ArmHarness(fixed_arm(base_frame=EYE, reference_frame="world"))
    for made in (free, walled):
        at(made.homed(), positions[0, :6])
    assert walled.walls["active"][: len(FAR) + 1].all()
    for position in positions:
        jaw = [("jaw/servo_jp", np.clip(position[6:], -0.3, 1.0))] * len(position[6:])
        for requests in ([("servo_jp", position[:6])], jaw, [], [], [], [], []):  # 200 Hz
            for made in (free, walled):
                made.step(*(FakeRequest(*request) for request in requests))
            for field in ("position", "velocity", "effort"):
                assert free.setpoint[field].tobytes() == walled.setpoint[field].tobytes()
    assert free.reports.events == walled.reports.events


def test_snakes_and_needle_drivers_are_found_by_their_names() -> None:
    snake = stock.tool("NEEDLE_DRIVER_400117")
    there = FakeOther(dataclasses.replace(fixed_arm(), name="PSM2", tools=(*fixed_arm().tools, snake)))
    other = there.other("PSM2")
    there.state["tool"][...] = snake.name.encode()
    other.look(1)
    assert other.space is not None and other.space.tool == snake.name and other.is_known
