"""The process of an arm from ROS: its record, its commands on ROS, and what a loss does, with a CRTK arm beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import World
from tests.tools.from_ros.stage import RosStage, ros_stage
from trocar.procs.ros_messages.messages import (
    Bool,
    Empty,
    JointStates,
    PoseStamped,
    Quaternion,
    String,
    StringStamped,
    WrenchStamped,
)
from trocar.shm.mailbox.client import Client, LoopClient, begin

HERE = (0.01, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0)
QUARTER = [[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@pytest.fixture
def stage(world: World, tmp_path: Path) -> Iterator[RosStage]:
    with ros_stage(world.name, tmp_path) as made:
        yield made


def test_its_record_is_that_of_an_arm_here(stage: RosStage) -> None:
    stage.x = 0.02
    stage.come()
    assert stage.value("state") == b"ENABLED" and stage.value("is_homed") and stage.value("reference_valid")
    assert stage.value("measured_cp").tolist() == [0.02, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0]
    assert stage.value("has_jaw") and stage.value("jaw_setpoint_position") == 0.5
    assert stage.value("reference_frame") == b"PSM1_base" and not stage.value("gripper_valid")
    assert not stage.process.error


def test_an_arm_that_is_not_there_is_named_with_a_remedy(stage: RosStage) -> None:
    stage.wait(3.1)
    assert not stage.ring.newest()
    assert "no message on measured_cp of /PSM1 in ROS domain" in stage.process.error
    assert "no program publishes it; start the program of that arm" in stage.process.error


def test_a_silent_arm_has_no_records_and_voids_what_operators_asked_for(stage: RosStage) -> None:
    stage.come()
    stage.errors()
    generation = stage.faults.generation()
    stage.ring.newest()
    last = stage.ring.sequence
    stage.wait(0.2)
    stage.ring.newest()
    assert stage.ring.sequence == last
    assert stage.faults.void("PSM1") > generation
    (error,) = stage.errors()
    assert "/PSM1/measured_cp is silent" in error and "ROS domain" in error
    assert "is silent" in stage.process.error
    stage.come()
    assert not stage.process.error and stage.ring.newest() and stage.ring.sequence > last


@pytest.mark.parametrize("lost", [True, False])
def test_a_command_that_an_operator_asked_for_before_a_silence_is_refused_after_it(stage: RosStage, lost: bool) -> None:
    """A teleoperation that was enabled before sends it."""
    stage.come()
    teleop, heard = LoopClient(stage.system, "PSM1", "teleop"), stage.hear("servo_cp", PoseStamped)
    teleop.on_behalf(begin(stage.system))
    if lost:
        stage.wait(0.2)
        stage.come()
    teleop.send("servo_cp", HERE)
    stage.take()
    (reply,) = teleop.poll()
    assert (reply.outcome == "refused" and "needs an operator's command given after" in reply.text) is lost
    assert len(heard.take()) == (not lost)
    teleop.close()


def test_a_fault_of_the_arm_is_reported_and_voids_commands(stage: RosStage) -> None:
    stage.come()
    stage.errors()
    generation = stage.faults.generation()
    stage.state, stage.is_homed = "FAULT", False
    stage.run(0.05)
    assert stage.value("state") == b"FAULT" and stage.faults.void("PSM1") > generation
    assert stage.errors() == ["PSM1 is in FAULT on ROS"]


def test_an_arm_that_loses_power_voids_commands_without_an_error(stage: RosStage) -> None:
    stage.come()
    stage.errors()
    generation = stage.faults.generation()
    stage.state, stage.is_homed = "DISABLED", False
    stage.run(0.05)
    assert stage.faults.void("PSM1") > generation and stage.errors() == []


def test_errors_and_warnings_of_the_arm_are_shown_here(stage: RosStage) -> None:
    stage.come()
    stage.errors()
    stage.publish("error", String("cable broken"))
    stage.publish("warning", String("cable worn"))
    stage.run(0.05)
    assert stage.errors() == ["PSM1 on ROS: cable broken"]
    texts = {row["text"].decode() for row in stage.events.last(100)}
    assert "PSM1 on ROS: cable worn" in texts


def test_goals_are_published_in_the_frame_of_the_arm_and_of_those_that_wait_the_newest(stage: RosStage) -> None:
    stage.come()
    heard = stage.hear("servo_cp", PoseStamped)
    for x in (0.01, 0.02):
        stage.client.send("servo_cp", (x, *HERE[1:]))
    stage.take()
    (goal,) = heard.take()
    assert goal.pose.position.x == 0.02 and goal.header.frame_id == "PSM1_base" and goal.header.stamp.sec > 0
    assert [reply.outcome for reply in stage.replies()] == ["done", "done"]


@pytest.mark.parametrize(
    ("name", "values", "message", "numbers"),
    [("jaw/servo_jp", (0.3,), JointStates, lambda got: got.position == [0.3]),
     ("free", (), Empty, lambda got: True),
     ("use_gravity_compensation", (1.0,), Bool, lambda got: got.data is True),
     ("body/servo_cf", (1, 2, 3, 4, 5, 6, 0.03, 1), WrenchStamped,
      lambda got: got.wrench.torque.z == 6 and got.header.frame_id == "PSM1_base"),
     ("body/servo_cf", (1, 2, 3, 4, 5, 6), WrenchStamped, lambda got: got.header.frame_id == "")],
)
def test_each_command_has_its_message(stage: RosStage, name: str, values: Any, message: Any, numbers: Any) -> None:
    stage.come()
    heard = stage.hear(name, message)
    stage.send(name, values)
    (got,) = heard.take()
    assert numbers(got)


def test_commands_to_an_absent_arm_are_refused_but_stops_are_sent(stage: RosStage) -> None:
    goals, stops, words = (stage.hear(*each) for each in (
        ("servo_cp", PoseStamped), ("hold", Empty), ("state_command", StringStamped)))
    stage.send("servo_cp", HERE)
    stage.send("state_command", (), "enable")
    stage.send("hold")
    stage.send("state_command", (), "disable")
    assert not goals.take() and len(stops.take()) == 1 and [each.string for each in words.take()] == ["disable"]
    outcomes = [(reply.outcome, "PSM1 is not there" in reply.text) for reply in stage.replies()]
    assert outcomes == [("refused", True), ("refused", True), ("done", False), ("accepted", False)]


def test_a_change_of_state_is_done_when_the_arm_shows_it(stage: RosStage) -> None:
    stage.state, stage.is_homed = "DISABLED", False
    stage.come()
    heard = stage.hear("state_command", StringStamped)
    stage.send("state_command", (), "enable")
    assert [each.string for each in heard.take()] == ["enable"]
    stage.run(0.05)
    assert [reply.outcome for reply in stage.replies()] == ["accepted"]
    stage.state = "ENABLED"
    stage.run(0.05)
    assert [reply.outcome for reply in stage.replies()] == ["done"]


@pytest.mark.parametrize(("reached", "outcome"), [(True, "done"), (False, "failed")])
def test_a_move_ends_with_the_arms_own_word(stage: RosStage, reached: bool, outcome: str) -> None:
    stage.come()
    stage.hear("move_cp", PoseStamped)
    stage.send("move_cp", HERE)
    stage.is_busy = True
    stage.run(0.05)
    assert [reply.outcome for reply in stage.replies()] == ["accepted"] and stage.value("is_busy")
    stage.publish("goal_reached", Bool(reached))
    stage.run(0.05)
    assert [reply.outcome for reply in stage.replies()] == [outcome]


def test_a_move_of_an_arm_without_goal_reached_ends_when_it_is_not_busy_any_more(stage: RosStage) -> None:
    stage.come()
    stage.send("move_cp", HERE)
    stage.is_busy = True
    stage.run(0.05)
    stage.is_busy = False
    stage.run(0.05)
    assert [reply.outcome for reply in stage.replies()] == ["accepted", "done"]


def test_a_move_of_a_lost_arm_has_failed(stage: RosStage) -> None:
    stage.come()
    stage.send("move_cp", HERE)
    stage.wait(0.2)
    _, failed = stage.replies()
    assert failed.outcome == "failed" and "is silent" in failed.text


def test_another_programs_stop_ends_a_stream_until_it_pauses(stage: RosStage) -> None:
    stage.come()
    other = Client(stage.system, "PSM1", peer=1)
    heard = stage.hear("servo_cp", PoseStamped)
    stage.send("servo_cp", HERE)
    other.send("hold")
    stage.take()
    stage.send("servo_cp", HERE)
    _, refused = stage.replies()
    assert refused.outcome == "refused" and "this stream has ended" in refused.text
    assert stage.process.cells("state")["stops"] == 1, "teleoperations stop, too"
    stage.run(0.6)
    stage.send("servo_cp", HERE)
    assert [reply.outcome for reply in stage.replies()] == ["done"] and len(heard.take()) == 2
    other.close()


def test_a_second_program_does_not_interrupt_a_stream(stage: RosStage) -> None:
    stage.come()
    other = Client(stage.system, "PSM1", peer=1)
    stage.send("servo_cp", HERE)
    other.send("servo_cp", HERE)
    stage.take()
    (refused,) = other.poll()
    assert refused.outcome == "refused" and "is streaming positions" in refused.text
    other.close()


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [("servo_cp", (math.nan, *HERE[1:]), ""), ("servo_cp", HERE[:3], "takes"), ("servo_cp", (*HERE, 1.0), "takes")])
def test_wrong_numbers_are_refused_here(stage: RosStage, name: str, values: Any, says: str) -> None:
    stage.come()
    heard = stage.hear(name, PoseStamped)
    stage.send(name, values)
    (reply,) = stage.replies()
    assert reply.outcome == "refused" and says in reply.text and not heard.take()


def test_a_base_frame_of_the_file_is_put_on_and_taken_off(world: World, tmp_path: Path) -> None:
    with ros_stage(world.name, tmp_path,
                   base_frame={"reference_frame": "HRSV", "transform": QUARTER}) as stage:
        stage.x = 0.02
        stage.come()
        assert stage.value("reference_frame") == b"HRSV"
        assert stage.value("measured_cp")[:3] == pytest.approx([0.1, 0.02, -0.1])
        heard = stage.hear("servo_cp", PoseStamped)
        stage.send("servo_cp", stage.value("measured_cp"))
        (goal,) = heard.take()
        assert goal.header.frame_id == "PSM1_base"
        assert [goal.pose.position.x, goal.pose.position.y] == pytest.approx([0.02, 0.0])
        assert np.allclose([abs(goal.pose.orientation.w), goal.pose.orientation.z], [1.0, 0.0])


def test_a_wrong_message_is_a_loss_and_never_an_end(stage: RosStage) -> None:
    stage.come()
    stage.errors()
    wrong = stage.pose()
    wrong.header.stamp.sec += 1
    wrong.pose.orientation = Quaternion(0.0, 0.0, 0.0, math.nan)
    stage.publish("measured_cp", wrong)
    stage.take()
    assert not stage.process.arm.is_there and any("must be finite" in text for text in stage.errors())
    stage.come()
    assert stage.value("reference_valid")
