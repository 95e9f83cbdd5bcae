"""What arms do at homing, by hand and without their processes: the roll of masters, discs and instruments of PSMs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.instruments import EmulatedInstruments
from trocar.procs.kinematics.coupling import coupling

ROLL, STOP = 6, math.radians(-480.0)
SEARCH, SPEED = 6.5 * math.pi, 2.0 * math.pi  # rad, rad/s


class Hand:
    """Setpoints for one robot of a rig."""

    def __init__(self, harness: BoardsHarness, robot: str) -> None:
        self.harness, self.robot, self.arm = harness, robot, harness.arms[robot]
        self.place = harness.robots.names.index(robot)
        self.axes = harness.robots.slices[self.place]
        self.arm.mode[...] = 1

    @property
    def position(self) -> np.ndarray:
        return self.harness.record.position[self.axes]

    @property
    def truth(self) -> np.ndarray:
        return self.harness.plant.position[self.harness.world.wiring.robots[self.robot]]

    def ask(self, name: str, *values: float) -> None:
        done = self.harness.do(name, self.robot, *values)
        assert done.outcome == "done", (name, done.answers, self.harness.errors())

    def begin_here(self) -> None:
        self.arm.in_effort[...] = False
        self.arm.position[: len(self.position)] = self.harness.record.setpoint_position[self.axes]

    def go(self, goal: np.ndarray, seconds: float) -> None:
        """Smoothly there."""
        start, count = self.arm.position[: len(goal)].copy(), round(seconds / self.harness.io.period_s)
        for k in range(1, count + 1):
            x = k / count
            self.arm.position[: len(goal)] = start + (goal - start) * x * x * (3.0 - 2.0 * x)
            self.harness.cycle()

    def find_stop(self) -> float:
        """Roll down until it lags by half a turn, the other actuators held; returns how far it was asked to go."""
        self.begin_here()
        start = float(self.arm.position[ROLL])
        way = 0.0
        while way < SEARCH:
            way += SPEED * self.harness.io.period_s
            self.arm.position[ROLL] = start - way
            self.harness.cycle()
            if self.position[ROLL] - self.arm.position[ROLL] > math.pi:
                break
        return way


@pytest.mark.slow
@pytest.mark.parametrize(("system", "robot", "roll"), [
    ("jhu-dVRK/system-MTML", "MTML", -8.3), ("jhu-dVRK/system-MTML", "MTML", 7.8),
    pytest.param("jhu-dVRK/system-MTMR", "MTMR", 0.3, marks=pytest.mark.soak),  # tests/arm homes it from there
])
def test_the_roll_of_a_master_is_found_by_its_stop_wherever_it_was(system: str, robot: str, roll: float) -> None:
    harness = rig_of(system)
    hand, record = Hand(harness, robot), harness.record
    somewhere = hand.truth.copy()
    somewhere[ROLL] = roll
    harness.plant.place(robot, somewhere)
    hand.ask("power_on")
    hand.ask("bias_encoders", 300, ROLL)
    assert record.biased[hand.place] and record.encoder_set[hand.axes].tolist() == [True] * 6 + [False]
    np.testing.assert_allclose(hand.position[:ROLL], hand.truth[:ROLL], atol=0.02)
    hand.ask("pid_enable", 1)
    assert hand.find_stop() < SEARCH
    assert hand.truth[ROLL] == pytest.approx(STOP, abs=0.01) and harness.errors() == []
    np.testing.assert_allclose(hand.truth[:ROLL], somewhere[:ROLL], atol=0.04)  # nobody compensates its weight
    before = int(record.bias_generation[hand.place])
    hand.ask("pid_enable", 0)
    hand.ask("set_encoder", ROLL, STOP)
    assert record.encoder_set[hand.axes].all() and record.bias_generation[hand.place] == before + 1
    assert hand.position[ROLL] == pytest.approx(hand.truth[ROLL], abs=0.01)
    for name in ("tracking_check", "pot_check", "pid_enable"):
        hand.ask(name, 1)
    hand.begin_here()
    hand.go(np.zeros(7), 3.0)
    harness.run(0.5)
    assert harness.errors() == [] and np.abs(hand.truth).max() < math.radians(4.0)


def loaded_psm(system: str, tool: str = "") -> tuple[BoardsHarness, Hand, np.ndarray]:
    """Held at the trocar with the discs at 0, then with an instrument; the range in which that is engaged (2, 4)."""
    harness = rig_of(system)
    whole = harness.system.emulated()
    harness.bring_up("PSM1")
    if harness.io.robots[0].brakes:
        assert harness.do("brake_release", "PSM1").outcome == "done"
    hand = Hand(harness, "PSM1")
    hand.begin_here()
    rest = hand.arm.position[:7] * (1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    hand.go(rest, 1.0)
    board_faults = BoardFaults(harness.world, harness.plant)
    if not tool:
        board_faults.press("PSM1_adapter", True)
        return harness, hand, np.radians([[-171.0] * 4, [171.0] * 4])
    EmulatedInstruments(whole, harness.world, board_faults, harness.plant).insert("PSM1", tool)
    held = next(one for one in whole.arm("PSM1").tools if one.name == tool)
    to_actuator = coupling(7, whole.arm("PSM1").chain, held).joint_to_actuator[3:, 3:]
    return harness, hand, np.array([held.engage_lower, held.engage_upper]) @ to_actuator.T


@pytest.mark.slow
@pytest.mark.parametrize(("system", "tool"), [
    pytest.param("jhu-dVRK/system-PSM1", "", marks=pytest.mark.soak),  # this and the snake: tests/arm engages them
    pytest.param("jhu-daVinci-Si/system-PSM1", "", marks=pytest.mark.soak),
    ("jhu-dVRK/system-PSM1", "BOWEL_GRASPER:400127"),  # engaged beyond the limits of its own file
    pytest.param("jhu-dVRK/system-PSM1", "NEEDLE_DRIVER:400117", marks=pytest.mark.soak),
    ("jhu-daVinci-Si/system-PSM1", "LARGE_NEEDLE_DRIVER:420006[..11]"),
])
def test_discs_and_instruments_turn_as_far_as_engaging_turns_them(system: str, tool: str) -> None:
    harness, hand, range_of_discs = loaded_psm(system, tool)
    rest = hand.arm.position[:7].copy()
    for end in (0, 1, 0):
        hand.go(np.concatenate((rest[:3], range_of_discs[end])), 1.4)
        harness.run(0.1)
        np.testing.assert_allclose(hand.truth[3:], range_of_discs[end], atol=math.radians(1.0))
        np.testing.assert_allclose(hand.position[3:], hand.truth[3:], atol=math.radians(1.0))
    hand.go(rest, 1.4)
    assert harness.errors() == []
    inputs = {row.name: bool(on) for row, on in zip(harness.io.digital_inputs, harness.record.input, strict=True)}
    assert inputs["PSM1_adapter"] and inputs["PSM1_tool"] is bool(tool)
