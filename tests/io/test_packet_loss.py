"""Lost datagrams: tolerated within the watchdog time, never taken for fresh samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from tests.system.robot import ROOT
from trocar.procs.config import load_system
from trocar.procs.fpga import registers

pytestmark = pytest.mark.slow

SWING, HZ = 0.15, 0.8  # rad: 0.75 rad/s, 65 counts a cycle
JOINT = 0


@pytest.fixture
def harness() -> BoardsHarness:
    made = rig_of("jhu-dVRK/system-PSM1", ())
    made.bring_up("PSM1")
    made.cycle()
    arm = made.arms["PSM1"]
    arm.position[:7] = made.record.setpoint_position
    arm.mode[...] = 1
    return made


def truth(harness: BoardsHarness) -> float:
    """Where the joint is now, from where its present physics step began."""
    world = harness.world
    since_s = (harness.clock.ns - world.epoch_ns) * 1e-9 - world.begin / registers.CLOCK_HZ
    return float(world.position[JOINT] + world.velocity[JOINT] * since_s)


def swing(harness: BoardsHarness, seconds: float, start: np.ndarray) -> tuple[int, float]:
    """Follow a sine; (cycles without a sample, largest age of the last good one, s). Every sample is today's."""
    arm, missed, oldest = harness.arms["PSM1"], 0, 0.0
    cycles = round(seconds * 1e9 / harness.period_ns)
    shown = harness.record.position.copy()
    for k in range(cycles):
        arm.position[JOINT] = start[JOINT] + SWING * math.sin(2 * math.pi * HZ * k * harness.period_ns * 1e-9)
        harness.cycle()
        record = harness.record
        if not record.valid:
            missed += 1
            oldest = max(oldest, float(record.age_ns) * 1e-9)
            np.testing.assert_array_equal(record.position, shown)
            continue
        assert record.age_ns == 0
        # the sample before would be off by a whole cycle's way
        way = abs(float(harness.world.velocity[JOINT])) * harness.period_ns * 1e-9
        if way > 1e-4:
            assert abs(float(record.position[JOINT]) - truth(harness)) < way / 2
        shown = record.position.copy()
    return missed, oldest


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("seconds", [
    0.5, pytest.param(5.0, marks=pytest.mark.soak), pytest.param(30.0, marks=pytest.mark.soak)])
def test_lost_datagrams_neither_stop_the_robot_nor_make_old_samples_new(harness: BoardsHarness, rate: float,
                                                                        seconds: float) -> None:
    start = harness.arms["PSM1"].position.copy()
    harness.link.loss = rate
    missed, oldest = swing(harness, seconds, start)
    cycles = seconds * 1e9 / harness.period_ns
    lost = 1.0 - (1.0 - rate) ** 3  # query, read, reply
    assert 0.5 * lost < missed / cycles < 1.5 * lost
    assert oldest < harness.io.watchdog_s
    assert harness.errors() == [] and harness.record.powered[0] and harness.record.pid_enabled[0]
    harness.link.loss = 0.0
    assert swing(harness, 0.2, start) == (0, 0.0)
    assert harness.errors() == []


@pytest.mark.parametrize("seed", [7, 38, 59])
def test_a_light_joint_does_not_ring_when_samples_come_rarely(seed: int) -> None:
    loaded = load_system(ROOT / "configs" / "systems" / "demo-teleop.yaml", search=[], boards="emulated")
    assert loaded.system is not None
    harness = BoardsHarness(loaded.system)
    harness.bring_up("PSM1")
    place = harness.robots.names.index("PSM1")
    roll = harness.robots.slices[place].start + 3
    arm = harness.arms["PSM1"]
    arm.position[:7] = harness.record.setpoint_position[harness.robots.slices[place]]
    arm.mode[...] = 1
    harness.run(0.3)
    start, shown = float(arm.position[3]), []
    harness.link.seed(seed)
    harness.link.loss = 0.43
    for k in range(75):
        arm.position[3] = start + 0.02 * math.sin(2 * math.pi * HZ * k * harness.period_ns * 1e-9)
        harness.cycle()
        if not harness.record.valid:
            harness.clock.ns += 2_000_000  # what io waits for a reply that does not come
        if not harness.record.pid_enabled[place]:
            break
        shown.append(float(harness.world.position[roll]))
    assert len(shown) > 20
    ways = np.abs(np.array(shown[5:]) - np.array(shown[:-5]))
    assert ways.max() < 0.006  # rad in five cycles, of which the sine asks for 0.001; 0.1 where efforts stay whole


def test_silence_shorter_than_the_watchdog_is_survived_and_a_longer_one_is_a_fault(harness: BoardsHarness) -> None:
    start = harness.arms["PSM1"].position.copy()
    for _ in range(10):
        harness.link.loss = 1.0
        missed, oldest = swing(harness, 0.02, start)
        assert missed == 30 and oldest < harness.io.watchdog_s
        harness.link.loss = 0.0
        assert swing(harness, 0.1, start) == (0, 0.0)
    assert harness.errors() == [] and harness.record.pid_enabled[0]
    harness.link.loss = 1.0
    harness.run(0.05)
    assert ("bad-reads", "PSM1") in harness.errors()
    assert not harness.record.pid_enabled[0] and not harness.record.power_requested[0]
    assert not harness.world.lines.on.any(), "the boards' watchdogs have cut the amplifiers by themselves"
    harness.link.loss = 0.0
    harness.run(0.1)
    assert harness.record.valid
    assert harness.do("power_on", "PSM1").outcome == "done"
