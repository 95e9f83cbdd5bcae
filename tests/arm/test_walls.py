"""Walls: a homed arm stays on their allowed side, whatever is asked of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import PERIOD_NS, ArmHarness
from tests.arm.fake_requests import FakeRequest
from tests.arm.test_psm import DEEP, at
from trocar.procs.document.walls import Wall
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.procs.kinematics.walls.walls import MOST
from trocar.procs.native.library import NativeLibrary, native
from trocar.procs.tables.arm_types import base_name

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")
FLOOR = Wall("floor", "plane", (0.0, 0.0, -0.13), of="tip")
HERE = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
EXACT = 1e-9  # m


def harness(*walls: Wall) -> ArmHarness:
    """Homed, 0.12 m deep, with walls of its configuration."""
    return at(ArmHarness(fixed_arm(walls=walls)).homed(), DEEP)


def add(made: ArmHarness, wall: Wall) -> None:
    """A wall by command."""
    values = (*wall.position, *wall.orientation, *wall.size, wall.margin)
    text = f"{wall.name} {wall.shape} {wall.keep} {wall.of} {wall.frame}"
    assert made.send("add_wall", values, text).outcomes == ["done"]


def tip(made: ArmHarness) -> np.ndarray:
    return made.state["local_setpoint_cp"][:3].copy()


def pose(made: ArmHarness, place: Any) -> np.ndarray:
    """The present orientation at another place, as a goal."""
    goal = made.state["local_setpoint_cp"].copy()
    goal[:3] = place
    return goal


def push(made: ArmHarness, to: Any, speed: float = 0.05) -> list[str]:
    """Stream the tip to a place at a speed, then hold it there for a while; returns all answers."""
    start, answers = tip(made), list[str]()
    way = np.array(to) - start
    count = int(np.linalg.norm(way) / (speed * PERIOD_NS * 1e-9)) + 1
    for share in np.concatenate((np.linspace(0.0, 1.0, count), np.ones(300))):
        answers.append(made.send("servo_cp", pose(made, start + share * way), base_name("PSM1")).replies[-1][1])
    return answers


def test_a_stream_into_a_plane_stays_above_it_and_slides_along() -> None:
    made = harness(FLOOR)
    lowest, start = math.inf, tip(made)
    for share in np.linspace(0.0, 1.0, 1500):
        made.send("servo_cp", pose(made, start + share * np.array((0.03, 0.0, -0.04))))
        lowest = min(lowest, tip(made)[2])
    assert lowest >= -0.13 - EXACT
    made.run(0.5)
    assert tip(made) == pytest.approx((start[0] + 0.03, start[1], -0.13), abs=2e-4), "the nearest allowed place"
    assert made.arm.control.machine.state == "HOMED" and not made.io.flag("fault")
    assert made.walls.text("stopped_by") == "floor" and abs(made.walls["distance"][0]) < 2e-4


def test_the_answer_and_one_event_name_the_wall() -> None:
    made = harness(FLOOR)
    answers = push(made, (0.0, 0.0, -0.14))
    assert answers[0] == "" and answers[-1] == "at wall floor"
    assert [event[1] for event in made.reports.of("warning")] == ["at-wall"]


def test_the_setpoint_slows_down_before_a_wall() -> None:
    made = harness(FLOOR)
    start, heights = tip(made), []
    for share in np.linspace(0.0, 1.0, 150):  # 40 mm in 0.3 s
        made.send("servo_cp", pose(made, start + share * np.array((0.0, 0.0, -0.04))))
        heights.append(tip(made)[2] + 0.13)
    speeds = -np.diff(heights) / (PERIOD_NS * 1e-9)
    assert (speeds <= np.array(heights[:-1]) / 0.05 + 1e-6).all() and min(heights) >= -EXACT


def test_a_stream_far_behind_a_wall_goes_on_and_comes_back_and_one_that_jumps_ends() -> None:
    made = harness(FLOOR)
    push(made, (0.0, 0.0, -0.2))  # 70 mm beyond
    assert tip(made)[2] == pytest.approx(-0.13, abs=1e-4)
    start = np.array((0.0, 0.0, -0.2))
    for share in np.linspace(0.0, 1.0, 2000):
        assert made.send("servo_cp", pose(made, start + share * np.array((0.0, 0.0, 0.08)))).outcomes[-1] == "done"
    made.run(0.2)
    assert tip(made)[2] == pytest.approx(-0.12, abs=1e-4)
    push(made, (0.0, 0.0, -0.16))
    assert made.send("servo_cp", pose(made, (0.05, 0.05, -0.2))).outcomes[-1] == "refused"


def test_a_move_across_a_wall_is_refused_before_it_begins() -> None:
    made = harness(FLOOR)
    goal = HERE.copy()
    goal[2] = 0.17
    refused = made.send("move_jp", goal)
    assert refused.outcomes == ["refused"] and "floor" in refused.replies[-1][1]
    here = tip(made)
    made.run(0.1)
    assert (tip(made) == here).all()
    goal[2] = 0.125
    move = made.send("move_jp", goal)
    made.until(lambda: move.outcomes[-1] in ("done", "failed"))
    assert move.outcomes[-1] == "done"


def test_a_move_is_refused_though_both_of_its_ends_are_allowed() -> None:
    made = at(harness(), (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    add(made, Wall("ball", "sphere", (0.0, 0.0, -0.115), size=(0.01,), of="tip"))
    assert made.send("move_jp", (-0.3, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes == ["refused"]
    assert made.send("move_jp", (-0.3, 0.0, 0.08, 0.0, 0.0, 0.0)).outcomes == ["accepted"]


def test_a_wall_that_appears_in_the_way_of_a_move_stops_it() -> None:
    made = harness()
    move = made.send("move_jp", (0.0, 0.0, 0.2, 0.0, 0.0, 0.0))
    made.run(0.05)
    made.send("add_wall", (0.0, 0.0, -0.14, 0.0, 0.0, 0.0, 1.0), "floor plane tip")
    made.until(lambda: move.outcomes[-1] in ("done", "failed"))
    assert move.outcomes[-1] == "failed" and "floor" in move.replies[-1][1]
    assert -0.14 - EXACT <= tip(made)[2] < -0.12
    made.run(0.2)
    assert tip(made)[2] >= -0.14 - EXACT


def test_from_inside_a_new_wall_only_the_way_out_is_free() -> None:
    made = harness()
    here = tip(made)
    add(made, Wall("lid", "plane", (0.0, 0.0, -0.1), of="tip"))  # 13 mm above the tip
    made.run(0.1)
    assert (tip(made) == here).all(), "nothing moves because a wall came"
    push(made, here + (0.0, 0.0, -0.01))
    assert tip(made)[2] == pytest.approx(here[2], abs=1e-6)
    push(made, here + (0.0, 0.0, 0.03))
    assert tip(made)[2] == pytest.approx(here[2] + 0.03, abs=1e-4)
    assert made.send("move_jp", (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes == ["refused"]


def test_walls_outlive_the_process_of_the_arm() -> None:
    made = harness(FLOOR)
    made.send("add_wall", (0.0, 0.0, -0.12, 0.0, 0.0, 0.0, 1.0, 0.002), "low plane tip")
    assert made.walls["count"] == 2 and made.walls["by_command"][:2].tolist() == [False, True]
    made.start_arm()
    made.run(1.0)
    assert [bytes(name) for name in made.walls["name"][:2]] == [b"floor", b"low"]
    push(made, (0.0, 0.0, -0.14))
    assert tip(made)[2] == pytest.approx(-0.118, abs=1e-4)
    assert made.send("remove_wall", (), "low").outcomes == ["done"]
    assert made.send("remove_wall", (), "low").outcomes == ["refused"]
    push(made, (0.0, 0.0, -0.14))
    assert tip(made)[2] == pytest.approx(-0.13, abs=1e-4)


@pytest.mark.parametrize(("text", "values"), [
    ("a", (0,) * 6 + (1,)), ("a cube", (0,) * 6 + (1,)), ("a sphere", (0,) * 6 + (1,)),
    ("a sphere hand", (0,) * 6 + (1, 0.01)), ("a sphere", (0,) * 6 + (2, 0.01)), ("a sphere", (0,) * 6 + (1, 0.0)),
    ("a cone", (0,) * 6 + (1, 1.6)), ("floor plane", (0,) * 6 + (1,)), ("a/b plane", (0,) * 6 + (1,)),
    ("a sphere", (0,) * 6 + (1, 0.01, 0.01, 0.01)),
])
def test_a_wall_that_cannot_be_is_refused(text: str, values: Any) -> None:
    made = harness(FLOOR)
    assert made.send("add_wall", values, text).outcomes == ["refused"] and made.walls["count"] == 1


def test_a_wall_in_the_reference_frame_moves_with_the_base_and_is_off_while_that_is_unknown() -> None:
    made, base = harness(), np.eye(4)
    base[2, 3] = 0.13
    made.send("set_base_frame", pose_from_matrix(base), "world")
    add(made, Wall("table", "plane", frame="reference", of="tip"))
    push(made, (0.0, 0.0, -0.15))
    assert made.state["setpoint_cp"][2] == pytest.approx(0.0, abs=1e-4)
    made.send("set_base_frame", (), "world")
    assert not made.walls["active"][0] and math.isnan(made.walls["distance"][0])
    assert any(event[1] == "wall-off" for event in made.reports.events)


def test_velocities_end_at_a_wall() -> None:
    made = harness(FLOOR)
    for _ in range(600):
        made.send("servo_jv", (0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
        assert tip(made)[2] >= -0.13 - EXACT
    assert tip(made)[2] == pytest.approx(-0.13, abs=1e-4)
    assert abs(made.setpoint["velocity"][2]) < 1e-6, "and so does the velocity feed"
    before = float(made.state["jaw_setpoint_position"])
    for _ in range(200):
        made.send("servo_jv", (0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
        made.send("jaw/servo_jp", (before + 0.3,))
    assert float(made.state["jaw_setpoint_position"]) == pytest.approx(before + 0.3, abs=1e-3)


SHAPES = some.one_of(
    some.builds(lambda size: ("sphere", (size,)), some.floats(0.005, 0.03)),
    some.builds(lambda a, b, c: ("box", (a, b, c)), *[some.floats(0.01, 0.05)] * 3),
    some.builds(lambda a, b: ("cylinder", (a, b)), *[some.floats(0.01, 0.04)] * 2),
    some.builds(lambda a, b: ("capsule", (a, b)), some.floats(0.005, 0.02), some.floats(0.01, 0.05)),
    some.just(("plane", ())))
NUMBER = some.floats(-1.0, 1.0)


@given(shape=SHAPES, place=some.tuples(NUMBER, NUMBER, NUMBER), turn=some.tuples(NUMBER, NUMBER, NUMBER),
       of=some.sampled_from(("tip", "jaw", "shaft", "instrument")),
       steps=some.lists(some.tuples(*[NUMBER] * 6), min_size=2, max_size=3))
def test_no_stream_brings_any_part_nearer_to_a_wall_than_it_may_be(shape: Any, place: Any, turn: Any, of: str,
                                                                   steps: Any) -> None:
    quaternion = np.array((*turn, 1.0)) / np.linalg.norm((*turn, 1.0))
    wall = Wall("w", shape[0], (0.05 * place[0], 0.05 * place[1], -0.12 + 0.05 * place[2]), tuple(quaternion.tolist()),
                shape[1], of=of)
    made = harness()
    add(made, wall)
    goal, scale = HERE.copy(), np.array((0.15, 0.15, 0.02, 0.5, 0.5, 0.5))
    least = min(float(made.walls["distance"][0]), 0.0)
    for change in steps:
        target = HERE + scale * np.array(change)
        for share in np.linspace(0.0, 1.0, 60):
            made.send("servo_jp", goal + share * (target - goal))
            made.arm.control.walls.is_news = True
            made.arm.control.walls.show(made.arm.control.here, made.now_ns)
            distance = float(made.walls["distance"][0])
            assert distance >= least - EXACT
            least = min(max(distance, least), 0.0)
        goal = target


def test_in_effort_mode_a_wall_pushes_softly() -> None:
    efforts = []
    for floor in (-0.2, -0.1225, -0.112):  # far, 9 mm below the tip, 1.5 mm above it
        made = harness()
        add(made, Wall("floor", "plane", (0.0, 0.0, floor), of="tip"))
        made.send("free")
        made.run(0.05)
        assert made.setpoint["in_effort"][2]
        efforts.append(float(made.setpoint["effort"][2]))
    assert efforts[1] - efforts[0] == pytest.approx(-0.5, abs=0.01), "500 N/m from 10 mm on, upwards"
    assert efforts[2] == -1.0, "no more than the joint's largest effort"


def test_a_jaw_that_streams_beside_the_arm_changes_nothing_at_a_wall() -> None:
    made = harness(FLOOR)
    start = tip(made)
    for share in np.linspace(0.0, 1.0, 800):
        goal = pose(made, start + share * np.array((0.0, 0.0, -0.08)))
        assert made.send("servo_cp", goal, base_name("PSM1")).outcomes == ["done"]
        assert made.send("jaw/servo_jp", (0.3 * share,)).outcomes == ["done"]
    assert tip(made)[2] == pytest.approx(-0.13, abs=1e-4)


def test_the_next_stream_is_judged_by_its_own_goals() -> None:
    made = harness(FLOOR)
    push(made, (0.0, 0.0, -0.2))
    assert made.walls.text("stopped_by") == "floor"
    made = at(made, (0.3, 0.0, 0.1, 0.0, 0.0, 0.0))
    assert made.walls.text("stopped_by") == ""
    here = tip(made)
    assert made.send("servo_cp", pose(made, here), base_name("PSM1")).outcomes == ["done"]
    assert made.send("servo_cp", pose(made, here + (0.0, 0.0, 0.003)), base_name("PSM1")).outcomes == ["done"]
    assert made.send("servo_cp", pose(made, (0.0, 0.0, -0.2)), base_name("PSM1")).outcomes == ["refused"]


def test_a_running_move_stops_at_a_new_wall_also_if_its_speed_changes_all_the_time() -> None:
    made = harness()
    move = made.send("move_jp", (0.0, 0.0, 0.2, 0.0, 0.0, 0.0))
    made.run(0.05)
    add(made, Wall("floor", "plane", (0.0, 0.0, -0.14), of="tip"))
    for number in range(1500):
        made.send("trajectory_j/set_ratio", (0.9 + 0.1 * (number % 2),))
        assert tip(made)[2] >= -0.14 - EXACT
    assert move.outcomes[-1] == "failed"


def test_a_restart_brings_no_more_walls_than_there_is_room_for() -> None:
    made = harness(*(Wall(f"w{i}", "plane", (0.0, 0.0, -0.2 - 0.01 * i), of="tip") for i in range(16)))
    assert made.send("remove_wall", (), "w3").outcomes == ["done"]
    plane = (0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0)
    assert made.send("add_wall", plane, "mine plane").outcomes == ["refused"], "w3 comes back"
    assert made.send("add_wall", plane, "w3 plane").outcomes == ["refused"]
    made.start_arm()
    made.run(0.1)
    assert made.walls["count"] == 16


@pytest.mark.parametrize(("field", "value"), [
    ("margin", math.nan), ("margin", -1.0), ("frame", b"xx"), ("name", b" a b"), ("size", math.inf), ("pose", math.nan),
    ("shape", b"cube"), ("count", 255)])
def test_a_torn_record_adds_no_wall_after_a_restart(field: str, value: Any) -> None:
    made = harness()
    add(made, Wall("ball", "sphere", (0.0, 0.0, -0.2), size=(0.02,), of="tip"))
    cell = made.walls[field]
    cell[... if field == "count" else 0] = value
    made.start_arm()
    made.run(1.0)
    assert made.walls["count"] == int(field == "count")
    assert made.send("move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes == ["accepted"]


def test_an_arm_inside_a_cone_slows_down_before_its_side() -> None:
    made = harness(Wall("field", "cone", orientation=(1.0, 0.0, 0.0, 0.0), size=(0.3,), keep="in", of="shaft"))
    angles = []
    for share in np.linspace(0.0, 1.0, 500):
        made.send("servo_jp", (0.6 * share, 0.0, 0.12, 0.0, 0.0, 0.0))
        angles.append(float(made.state["setpoint_position"][0]))
    made.run(0.5)
    assert float(made.state["setpoint_position"][0]) == pytest.approx(0.3, abs=1e-4)
    steps = np.diff(angles)
    assert steps.max() > 0.001 and steps[-1] < 0.2 * steps.max()


def test_where_numpy_would_be_too_slow_there_are_no_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.procs.arm.walls.native", lambda: NativeLibrary(None, "it is not compiled"))
    made = harness()
    refused = made.send("add_wall", (0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0), "floor plane")
    assert refused.outcomes == ["refused"] and "it is not compiled" in refused.replies[-1][1]
    with pytest.raises(ValueError, match="it is not compiled"):
        harness(FLOOR)


def test_the_record_has_room_for_all_walls_of_an_arm() -> None:
    assert {len(harness().walls[name]) for name in ("name", "pose", "distance", "active")} == {MOST}


def test_a_wall_is_acknowledged_once_the_record_that_outlives_the_process_has_it() -> None:
    made = harness()
    request = FakeRequest("add_wall", (0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0), "floor plane")
    made.arm.step(made.now_ns, made.io.stamp_ns, made.io.epoch, (request,))
    assert request.outcomes == [] and made.walls["count"] == 0
    made.step()
    assert request.outcomes == ["done"] and made.walls["count"] == 1
