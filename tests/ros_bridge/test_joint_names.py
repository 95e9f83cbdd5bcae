"""Positions with names move the joints of these names, and nothing else: permuted names are put in order."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros_bridge.hosted_bridge import HostedBridge, bridged
from trocar.procs.ros_messages.messages import JointStates

NAMES = ["yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw"]
GOAL = [0.01, 0.02, 0.12, 0.03, 0.04, 0.05]
"""In the order of the joints."""
START = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]
BACKWARDS = [5, 4, 3, 2, 1, 0]


@pytest.fixture(scope="module")
def bridge() -> Iterator[HostedBridge]:
    with bridged() as made:
        yield made


def setpoint(bridge: HostedBridge) -> list[float]:
    reader = bridge.host.reader("PSM1")
    assert reader.newest()
    return [round(value, 6) for value in reader.field("setpoint_position")[:6].tolist()]


def permuted(values: list[Any], order: list[int]) -> list[Any]:
    return [values[place] for place in order]


@pytest.fixture
def begin(bridge: HostedBridge) -> list[float]:
    if setpoint(bridge) != START:
        bridge.tell("PSM1/move_jp", JointStates(position=START))
        bridge.run_until(lambda: setpoint(bridge) == START)
    return START


@pytest.mark.parametrize(("names", "order"), [
    (NAMES, BACKWARDS), ([f"outer_{name}" for name in NAMES], [2, 0, 1, 5, 3, 4]), ([*"012345"], [0, 1, 2, 3, 4, 5]),
    ([], [0, 1, 2, 3, 4, 5])])
def test_names_put_positions_in_order(bridge: HostedBridge, begin: list[float], names: list[str],
                                      order: list[int]) -> None:
    bridge.tell("PSM1/move_jp", JointStates(name=permuted(names, order) if names else [],
                                            position=permuted(GOAL, order)))
    bridge.run_until(lambda: setpoint(bridge) == GOAL)
    assert setpoint(bridge) == GOAL


def test_velocities_are_put_in_order_with_their_positions(bridge: HostedBridge, begin: list[float]) -> None:
    near = [0.01, 0.0, 0.1, 0.0, 0.0, 0.0]
    speed = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
    bridge.tell("PSM1/servo_jp", JointStates(name=permuted(NAMES, BACKWARDS), position=permuted(near, BACKWARDS),
                                             velocity=permuted(speed, BACKWARDS)), 0.5)
    assert setpoint(bridge)[2:] == near[2:] and setpoint(bridge)[0] > 0.005


WRONG = {
    "unknown": (["jaw", *NAMES[1:]], GOAL), "doubled": (["yaw", "yaw", *NAMES[2:]], GOAL),
    "doubled by a synonym": (["outer_pitch", *NAMES[1:]], GOAL), "empty": ([""] * 6, GOAL),
    "too few names": (NAMES[:5], GOAL), "one joint": (["pitch"], [0.02]), "too many names": ([*NAMES, "jaw"], GOAL),
    "too few positions": (NAMES, GOAL[:5]), "of a master": (["wrist_platform", *NAMES[1:]], GOAL),
}


@pytest.mark.parametrize("case", WRONG)
def test_names_that_do_not_fit_are_refused_with_the_known_ones_and_the_key(
        bridge: HostedBridge, begin: list[float], case: str) -> None:
    names, position = WRONG[case]
    heard = bridge.refused("PSM1/move_jp", JointStates(name=names, position=position), "PSM1", "ros_bridge")
    assert setpoint(bridge) == begin
    for component, texts in heard.items():
        assert len([text for text in texts if "PSM1" in text]) >= 1, component
        assert all(name in texts[0] for name in (*NAMES, "check_names")), component
    assert len(heard["PSM1"]) == len(heard["ros_bridge"]) == 1


@pytest.mark.parametrize(("command", "names", "position", "velocity"), [
    ("servo_jp", [], [0.01, 0.0, 0.1], [0.0, 0.0, 0.01]), ("servo_jp", [], [0.01, 0.0, 0.1, 0.0, 0.0, 0.0] * 2, []),
    ("servo_jp", [], [], [0.01, 0.0, 0.1, 0.0, 0.0, 0.0]), ("servo_jr", NAMES, [], [0.01, 0.0, 0.1, 0.0, 0.0, 0.0])])
def test_numbers_in_other_fields_are_not_taken_for_positions(
        bridge: HostedBridge, begin: list[float], command: str, names: list[str], position: list[float],
        velocity: list[float]) -> None:
    message = JointStates(name=names, position=position, velocity=velocity)
    assert len(bridge.refused(f"PSM1/{command}", message, "PSM1")["PSM1"]) == 1
    assert setpoint(bridge) == begin


@pytest.mark.parametrize("names", [[], NAMES])
def test_velocities_alone_are_followed_with_and_without_names(bridge: HostedBridge, begin: list[float],
                                                              names: list[str]) -> None:
    message = JointStates(name=names, velocity=[0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not bridge.refused("PSM1/servo_jv", message, "PSM1")["PSM1"]
    assert setpoint(bridge)[0] > begin[0]


@pytest.mark.parametrize(("command", "part"), [("servo_jp", "position"), ("servo_jr", "position"),
                                               ("servo_jv", "velocity"), ("servo_jf", "effort"),
                                               ("move_jp", "position"), ("move_jr", "position")])
def test_every_command_with_names_checks_them(bridge: HostedBridge, begin: list[float], command: str,
                                              part: str) -> None:
    message = JointStates(name=["yaw"] * 6)
    setattr(message, part, [0.001] * 6)
    assert len(bridge.refused(f"PSM1/{command}", message, "PSM1")["PSM1"]) == 1
    assert setpoint(bridge) == begin


@pytest.mark.parametrize(("command", "part", "value"), [
    ("jaw/servo_jp", "position", 0.1), ("jaw/move_jp", "position", 0.2), ("jaw/servo_jf", "effort", 0.01)])
def test_a_jaw_is_named_jaw_or_not_at_all(bridge: HostedBridge, command: str, part: str, value: float) -> None:
    for name, refused in (("jaw", 0), ("gripper", 1)):
        message = JointStates(name=[name])
        setattr(message, part, [value])
        heard = bridge.refused(f"PSM1/{command}", message, "PSM1")["PSM1"]
        assert ["check_names" in text for text in heard if name in text] == [True] * refused, (name, heard)


def test_the_key_ignores_names(bridge: HostedBridge, begin: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    commands = bridge.loop._incoming
    monkeypatch.setattr(commands, "_bridge", dataclasses.replace(commands._bridge, check_names=False))
    bridge.tell("PSM1/move_jp", JointStates(name=[*"abcdef"], position=GOAL))
    bridge.run_until(lambda: setpoint(bridge) == GOAL)
    assert setpoint(bridge) == GOAL
