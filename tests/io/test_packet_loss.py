"""Lost datagrams: tolerated within the watchdog time, never taken for fresh samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from procs.config import load_system
from procs.fpga import registers
from tests import stock
from tests.io.boards_harness import Rig
from tests.system.robot import ROOT

SWING, HZ = 0.15, 0.8  # rad: 0.75 rad/s, 65 counts a cycle
JOINT = 0


@pytest.fixture
def rig() -> Rig:
    loaded = load_system(stock.find("dvrk-site/jhu-dVRK/system-PSM1.json"), search=[stock.find("dvrk-share")],
                         boards="emulated")
    assert loaded.system is not None
    made = Rig(loaded.system)
    made.bring_up("PSM1")
    made.cycle()
    arm = made.arms["PSM1"]
    arm.position[:7] = made.record.setpoint_position
    arm.mode[...] = 1
    return made


def truth(rig: Rig) -> float:
    """Where the joint is now, from where its present physics step began."""
    world = rig.world
    since_s = (rig.clock.ns - world.epoch_ns) * 1e-9 - world.begin / registers.CLOCK_HZ
    return float(world.position[JOINT] + world.velocity[JOINT] * since_s)


def swing(rig: Rig, seconds: float, start: np.ndarray) -> tuple[int, float]:
    """Follow a sine; (cycles without a sample, largest age of the last good one, s). Every sample is today's."""
    arm, missed, oldest = rig.arms["PSM1"], 0, 0.0
    cycles = round(seconds * 1e9 / rig.period_ns)
    shown = rig.record.position.copy()
    for k in range(cycles):
        arm.position[JOINT] = start[JOINT] + SWING * math.sin(2 * math.pi * HZ * k * rig.period_ns * 1e-9)
        rig.cycle()
        record = rig.record
        if not record.valid:
            missed += 1
            oldest = max(oldest, float(record.age_ns) * 1e-9)
            np.testing.assert_array_equal(record.position, shown)
            continue
        assert record.age_ns == 0
        # the sample before would be off by a whole cycle's way
        way = abs(float(rig.world.velocity[JOINT])) * rig.period_ns * 1e-9
        if way > 1e-4:
            assert abs(float(record.position[JOINT]) - truth(rig)) < way / 2
        shown = record.position.copy()
    return missed, oldest


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("seconds", [
    0.5, pytest.param(5.0, marks=pytest.mark.soak), pytest.param(30.0, marks=pytest.mark.soak)])
def test_lost_datagrams_neither_stop_the_robot_nor_make_old_samples_new(rig: Rig, rate: float, seconds: float) -> None:
    start = rig.arms["PSM1"].position.copy()
    rig.link.loss = rate
    missed, oldest = swing(rig, seconds, start)
    cycles = seconds * 1e9 / rig.period_ns
    lost = 1.0 - (1.0 - rate) ** 3  # query, read, reply
    assert 0.5 * lost < missed / cycles < 1.5 * lost
    assert oldest < rig.io.watchdog_s
    assert rig.errors() == [] and rig.record.powered[0] and rig.record.pid_enabled[0]
    rig.link.loss = 0.0
    assert swing(rig, 0.2, start) == (0, 0.0)
    assert rig.errors() == []


@pytest.mark.parametrize("seed", [7, 38, 59])
def test_a_light_joint_does_not_ring_when_samples_come_rarely(seed: int) -> None:
    loaded = load_system(ROOT / "configs" / "systems" / "demo-teleop.yaml", search=[], boards="emulated")
    assert loaded.system is not None
    rig = Rig(loaded.system)
    rig.bring_up("PSM1")
    place = rig.robots.names.index("PSM1")
    roll = rig.robots.slices[place].start + 3
    arm = rig.arms["PSM1"]
    arm.position[:7] = rig.record.setpoint_position[rig.robots.slices[place]]
    arm.mode[...] = 1
    rig.run(0.3)
    start, shown = float(arm.position[3]), []
    rig.link.seed(seed)
    rig.link.loss = 0.43
    for k in range(75):
        arm.position[3] = start + 0.02 * math.sin(2 * math.pi * HZ * k * rig.period_ns * 1e-9)
        rig.cycle()
        if not rig.record.valid:
            rig.clock.ns += 2_000_000  # what io waits for a reply that does not come
        if not rig.record.pid_enabled[place]:
            break
        shown.append(float(rig.world.position[roll]))
    assert len(shown) > 20
    ways = np.abs(np.array(shown[5:]) - np.array(shown[:-5]))
    assert ways.max() < 0.006  # rad in five cycles, of which the sine asks for 0.001; 0.1 where efforts stay whole


def test_silence_shorter_than_the_watchdog_is_survived_and_a_longer_one_is_a_fault(rig: Rig) -> None:
    start = rig.arms["PSM1"].position.copy()
    for _ in range(10):
        rig.link.loss = 1.0
        missed, oldest = swing(rig, 0.02, start)
        assert missed == 30 and oldest < rig.io.watchdog_s
        rig.link.loss = 0.0
        assert swing(rig, 0.1, start) == (0, 0.0)
    assert rig.errors() == [] and rig.record.pid_enabled[0]
    rig.link.loss = 1.0
    rig.run(0.05)
    assert ("bad-reads", "PSM1") in rig.errors()
    assert not rig.record.pid_enabled[0] and not rig.record.power_wanted[0]
    assert not rig.world.lines.on.any(), "the boards' watchdogs have cut the amplifiers by themselves"
    rig.link.loss = 0.0
    rig.run(0.1)
    assert rig.record.valid
    assert rig.do("power_on", "PSM1").outcome == "done"
