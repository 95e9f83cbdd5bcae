"""Headers count: a pose of `local/measured_cp` given back stays where it is, one of an unknown frame is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros_bridge.hosted_bridge import HostedBridge, bridged
from trocar.procs.ros_bridge.incoming import COMMAND_TOPICS
from trocar.procs.ros_messages.command_messages import frame_of
from trocar.procs.ros_messages.messages import CartesianState, JointStates, PoseStamped

BASE = (0.05, 0.0, -0.03, 0.0, 0.0, 0.6, 0.8)
MOST = 1e-5


@pytest.fixture(scope="module")
def bridge() -> Iterator[HostedBridge]:
    with bridged() as made:
        made.tell("PSM1/move_jp", JointStates(position=[0.1, 0.1, 0.12, 0.0, 0.0, 0.0]), 2.0)
        made.host.client("PSM1").send("set_base_frame", BASE, "ECM")
        for topic in ("PSM1/local/measured_cp", "PSM1/measured_cp"):
            made.hear(topic, PoseStamped)
        yield made


def tip(bridge: HostedBridge, topic: str) -> PoseStamped:
    bridge.came(topic)
    bridge.run(0.2)
    message: PoseStamped = bridge.came(topic)[-1]
    return message


def setpoint(bridge: HostedBridge) -> Any:
    reader = bridge.host.reader("PSM1")
    assert reader.newest()
    return reader.field("setpoint_position")[:6].copy()


@pytest.mark.parametrize("command", ["move_cp", "servo_cp"])
@pytest.mark.parametrize(("topic", "frame"), [("PSM1/local/measured_cp", "PSM1_base"), ("PSM1/measured_cp", "ECM")])
def test_a_published_pose_given_back_moves_nothing(bridge: HostedBridge, topic: str, frame: str, command: str) -> None:
    message, before = tip(bridge, topic), setpoint(bridge)
    assert message.header.frame_id == frame
    bridge.tell(f"PSM1/{command}", message, 0.5)
    assert abs(setpoint(bridge) - before).max() < MOST


def test_a_state_in_the_base_is_followed_there(bridge: HostedBridge) -> None:
    message, before = tip(bridge, "PSM1/local/measured_cp"), setpoint(bridge)
    state = CartesianState(header=message.header, pose=message.pose)
    state.pose_is_valid.data = True
    state.pose.position.z -= 0.001
    bridge.tell("PSM1/servo_cs", state, 0.5)
    assert 1e-4 < abs(setpoint(bridge) - before).max() < 0.02


FRAMED = [row.topic for row in COMMAND_TOPICS if row.kind == "arm" and row.taken.text is frame_of]


def message_for(bridge: HostedBridge, topic: str) -> Any:
    row = next(row for row in COMMAND_TOPICS if row.kind == "arm" and row.topic == topic)
    message: Any = row.taken.message()
    if hasattr(message, "pose"):
        message.pose = tip(bridge, "PSM1/measured_cp").pose
    if hasattr(message, "pose_is_valid"):
        message.pose_is_valid.data = True
    message.header.frame_id = "world"
    return message


@pytest.mark.parametrize("topic", FRAMED)
def test_an_unknown_frame_is_refused_for_every_command_that_has_one(bridge: HostedBridge, topic: str) -> None:
    message, before = message_for(bridge, topic), setpoint(bridge)
    texts = bridge.refused(f"PSM1/{topic}", message, "PSM1")["PSM1"]
    assert [text for text in texts if topic in text and "world" in text and "PSM1_base" in text and "ECM" in text]
    assert abs(setpoint(bridge) - before).max() < MOST


def test_every_message_of_an_arm_with_a_header_and_numbers_in_a_frame_gives_it() -> None:
    assert set(FRAMED) == {"servo_cp", "servo_cr", "servo_cs", "servo_ci", "body/servo_cf", "spatial/servo_cf",
                           "move_cp", "move_cr"}


def test_the_key_ignores_frames_but_not_the_name_of_a_base_frame(
        bridge: HostedBridge, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = bridge.loop._incoming
    monkeypatch.setattr(commands, "_bridge", dataclasses.replace(commands._bridge, check_frames=False))
    message, before = tip(bridge, "PSM1/measured_cp"), setpoint(bridge)
    message.header.frame_id = "world"
    message.pose.position.z -= 0.002
    bridge.tell("PSM1/move_cp", message, 1.0)
    assert abs(setpoint(bridge) - before).max() > 1e-3
    bridge.tell("PSM1/set_base_frame", message)
    assert tip(bridge, "PSM1/measured_cp").header.frame_id == "world"
    bridge.host.client("PSM1").send("set_base_frame", BASE, "ECM")
    bridge.run(0.1)
