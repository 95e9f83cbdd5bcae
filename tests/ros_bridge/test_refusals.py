"""Who sends a message over ROS learns there why it was refused, whether the bridge or the component refuses it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros_bridge.hosted_bridge import HostedBridge, bridged
from trocar.procs.ros_messages.messages import (
    Bool,
    Empty,
    Float64,
    JointStates,
    OperatingState,
    PoseStamped,
    String,
    StringStamped,
)


@pytest.fixture(scope="module")
def bridge() -> Iterator[HostedBridge]:
    with bridged(sets=("ros.may_power=false",)) as made:
        yield made


@pytest.fixture(scope="module")
def teleoperation() -> Iterator[HostedBridge]:
    with bridged(arms=(), file="kinematic-teleop.yaml") as made:
        yield made


REFUSED: dict[str, tuple[str, Any]] = {
    "too few joints": ("PSM1/move_jp", JointStates(position=[0.1])),
    "not finite": ("PSM1/move_jp", JointStates(position=[math.nan] * 6)),
    "without a quaternion": ("PSM1/servo_cp", PoseStamped()),
    "out of bounds": ("PSM1/trajectory_j/set_ratio", Float64(2.0)),
    "by the bridge itself": ("PSM1/state_command", StringStamped(string="home")),
    "too long a text": ("PSM1/set_tool_type", String("x" * 100)),
    "reported by the arm as well": ("PSM1/servo_jp", JointStates(position=[1.0, 1.0, 0.1, 0.0, 0.0, 0.0])),
    "for the system": ("system/set_volume", Float64(math.nan)),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_is_published_once_by_the_component_that_the_message_was_for(bridge: HostedBridge, case: str) -> None:
    topic, message = REFUSED[case]
    component, _, command = topic.partition("/")
    heard = bridge.refused(topic, message, component, "ros_bridge")
    own = [text for text in heard[component] if text.startswith(component)]  # `system` repeats those of others
    assert len([text for text in own if command in text]) == 1, heard
    assert len([text for text in heard["ros_bridge"] if command in text and component in text]) == 1, heard
    assert len([text for text in heard["/rosout"] if text.startswith(tuple(heard["ros_bridge"]))]) == 1, heard


@pytest.mark.parametrize(("command", "message", "is_of_bridge"), [
    ("trajectory_j/set_ratio", Float64(3.0), False), ("state_command", StringStamped(string="enable"), True)])
def test_only_a_refusal_of_the_bridge_itself_ends_with_the_page_of_its_topics(
        bridge: HostedBridge, command: str, message: Any, is_of_bridge: bool) -> None:
    heard = bridge.refused(f"PSM1/{command}", message)["/rosout"]
    assert {"docs/commands.md" in text for text in heard if command in text} == {is_of_bridge}, heard


def test_a_move_that_the_bridge_refuses_is_over_at_once_for_clients_that_wait(bridge: HostedBridge) -> None:
    for topic, message in (("PSM1/goal_reached", Bool), ("PSM1/operating_state", OperatingState)):
        bridge.hear(topic, message)
    bridge.run(0.3)
    for topic in ("PSM1/goal_reached", "PSM1/operating_state"):
        bridge.came(topic)
    bridge.tell("PSM1/move_jp", JointStates(name=["no_such_joint"], position=[0.1]), 0.3)
    assert [message.data for message in bridge.came("PSM1/goal_reached")] == [False]
    busy = [message.is_busy for message in bridge.came("PSM1/operating_state")]
    assert True in busy and not busy[-1]


@pytest.mark.parametrize(("topics", "reached"), [(("hold", "move_jp"), True), (("move_jp", "hold"), False)])
def test_messages_that_are_found_together_are_carried_out_in_the_order_of_publication(
        bridge: HostedBridge, topics: tuple[str, str], reached: bool) -> None:
    bridge.hear("PSM1/goal_reached", Bool)
    bridge.hear("PSM1/measured_js", JointStates)
    bridge.run(0.3)
    goal = list(bridge.came("PSM1/measured_js")[-1].position)
    goal[0] += 0.02
    bridge.came("PSM1/goal_reached")
    messages = {"hold": Empty(), "move_jp": JointStates(position=goal)}
    bridge.tell_together([(f"PSM1/{topic}", messages[topic]) for topic in topics], 0.6)
    assert [message.data for message in bridge.came("PSM1/goal_reached")] == [reached]


def test_the_same_refusal_is_published_once_a_second(bridge: HostedBridge) -> None:
    message = JointStates(position=[0.1])
    bridge.refused("PSM1/servo_jp", message, "PSM1")
    for _ in range(5):
        bridge.tell("PSM1/servo_jp", message, 0.05)
    assert not [text for text in bridge.warned("PSM1") if "servo_jp" in text]


RATIOS = [("PSM1/trajectory_j/set_ratio", 0.0), ("PSM1/trajectory_j/set_ratio_v", -1.0),
          ("PSM1/trajectory_j/set_ratio_a", 5.0), ("MTMR_PSM1/set_scale", math.nan), ("MTMR_PSM1/set_scale", 5.0),
          ("console/teleop/set_scale", 0.0)]


@pytest.mark.parametrize(("topic", "value"), RATIOS)
def test_a_refused_ratio_is_a_warning_of_its_component_for_all_clients(
        teleoperation: HostedBridge, topic: str, value: float) -> None:
    component = topic.partition("/")[0]
    heard = teleoperation.refused(topic, Float64(value), component)
    named = [text for text in heard[component] if topic.rpartition("/")[2] in text]
    assert len(named) == 1 and "allowed" in named[0], heard
    assert any(named[0] in text for text in heard["/rosout"])
