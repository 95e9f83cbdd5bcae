"""A master's gripper: the angle of its potentiometer, closed and pinched."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_master import MasterHarness, master


class GripperRig(MasterHarness):
    """The gripper is the first axis of io's record, another robot's."""

    def __init__(self, angle: float = 0.5, **changes: Any) -> None:
        super().__init__(master(gripper="MTML_gripper", **changes))
        self.turn(angle)

    def turn(self, angle: float) -> None:
        self.io.record["pot_position"][0] = angle

    def reported(self) -> list[tuple[Any, ...]]:
        reported = [e if e[0] == "gripper/pinch" else (e[0], bool(e[2]))
                    for e in self.reports.of("gripper/closed", "gripper/pinch")]
        self.reports.events.clear()
        return [event[:2] if event[0] == "gripper/closed" else event[:1] for event in reported]


CLOSED, OPEN, PINCH = ("gripper/closed", True), ("gripper/closed", False), ("gripper/pinch",)


def test_angle_is_seen_without_power() -> None:
    harness = GripperRig(0.5)
    harness.run(0.1)
    assert harness.arm.state == "DISABLED" and harness.state["gripper_valid"]
    assert harness.state["gripper_position"] == 0.5
    assert harness.state["gripper_velocity"] == 0.0


def test_velocity_follows_the_angle() -> None:
    harness = GripperRig(0.0)
    harness.run(0.1)
    for step in range(50):
        harness.turn(0.2 * step * harness.period_ns * 1e-9)
        harness.step()
    assert harness.state["gripper_velocity"] == pytest.approx(0.2, rel=0.01)
    harness.run(0.3)
    assert abs(harness.state["gripper_velocity"]) < 1e-3


def test_closing_counts_once_it_has_lasted() -> None:
    harness = GripperRig(0.5)
    harness.run(0.1)
    assert harness.reported() == []
    harness.turn(-0.01)
    harness.run(0.18)
    assert harness.reported() == []
    harness.run(0.04)
    assert harness.reported() == [CLOSED, PINCH]
    harness.turn(0.01)
    harness.run(0.02)
    assert harness.reported() == [OPEN]


def test_a_short_touch_is_no_pinch() -> None:
    harness = GripperRig(0.5)
    harness.run(0.1)
    for _ in range(3):
        harness.turn(-0.01)
        harness.run(0.15)
        harness.turn(0.3)
        harness.run(0.05)
    assert harness.reported() == []


def test_zero_and_debounce_are_those_of_the_file() -> None:
    harness = GripperRig(0.5, gripper_zero=0.3, gripper_debounce_s=0.0)
    harness.run(0.1)
    harness.turn(0.3)
    harness.run(0.02)
    assert harness.reported() == [CLOSED, PINCH]


def test_a_gripper_that_is_found_closed_was_not_pinched() -> None:
    harness = GripperRig(-0.1)
    harness.run(0.5)
    assert harness.reported() == [CLOSED]


def test_what_io_does_not_measure_is_not_valid() -> None:
    harness = GripperRig(0.5)
    harness.run(0.1)
    harness.turn(np.nan)
    harness.run(0.05)
    assert not harness.state["gripper_valid"]
    harness.turn(0.4)
    harness.run(0.05)
    assert harness.state["gripper_valid"] and abs(harness.state["gripper_velocity"]) < 1e-9
    harness.io.deaf = True
    harness.run(0.1)
    assert not harness.state["gripper_valid"]


def test_a_master_without_a_gripper_shows_none() -> None:
    harness = MasterHarness()
    harness.run(0.1)
    assert not harness.state["gripper_valid"]


def test_a_kinematic_master_has_a_gripper_at_zero_and_no_roll_to_find() -> None:
    harness = MasterHarness(dataclasses.replace(master(), simulation="KINEMATIC"))
    harness.io.flag("biased", True)  # as those that are played always are
    harness.io.flag("bias_generation", 1)
    harness.homed()
    assert harness.state["gripper_valid"] and harness.state["gripper_position"] == 0.0
    assert not [command for command in harness.io.sent if command[0] in ("set_encoder", "bias_encoders")]
    harness.run(0.02)
    assert harness.state["cartesian_valid"] and harness.state["is_homed"]
