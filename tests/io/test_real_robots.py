"""Robots of real sites on emulated boards: powered, biased, held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.fpga import lookup, registers
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.start import prepare


@pytest.mark.parametrize(("system", "robot"), [
    ("jhu-dVRK/system-PSM1", "PSM1"),
    pytest.param("jhu-daVinci-Si/system-PSM1", "PSM1", marks=pytest.mark.slow),
    pytest.param("jhu-daVinci-Si/system-ECM", "ECM", marks=pytest.mark.slow),
    pytest.param("jhu-daVinci/system-ECM", "ECM", marks=pytest.mark.slow), ("jhu-dVRK/system-MTML", "MTML"),
])
def test_a_robot_of_a_real_site_is_powered_biased_and_held(system: str, robot: str) -> None:
    harness = rig_of(system)
    harness.bring_up(robot)
    place, axes = harness.robots.names.index(robot), harness.robots.slices[harness.robots.names.index(robot)]
    if harness.io.robots[place].brakes:
        assert not harness.record.brakes_released[place]
        assert harness.do("brake_release", robot).outcome == "done"
        harness.run(2.2)
        assert harness.record.brakes_released[place]
    start = harness.record.setpoint_position[axes].copy()
    harness.run(0.3)
    assert harness.errors() == []
    assert harness.record.powered[place] and harness.record.amps_on[place] and harness.record.pid_enabled[place]
    np.testing.assert_array_equal(harness.record.setpoint_position[axes], start)
    assert np.abs(harness.record.position_error[axes]).max() < 0.1
    truth = harness.world.position[harness.world.wiring.robots[robot]]
    assert np.abs(truth - harness.record.position[axes]).max() < 0.02


@pytest.mark.slow
def test_a_reading_without_a_position_cuts_power_and_opens_the_relays_each_time_it_is_met() -> None:
    harness = rig_of("jhu-daVinci-Si/system-PSM1")
    harness.bring_up("PSM1")
    tables = harness.world.wiring.tables
    table = lookup.unpack(harness.io.robots[0].lookup, 7)
    nowhere = int(np.flatnonzero(np.isnan(table[2]))[0])
    honest = tables.readings

    def broken(position: np.ndarray) -> np.ndarray:
        found = honest(position)
        found[2] = nowhere
        return found

    tables.readings = broken  # type: ignore[method-assign]
    harness.run(0.1)
    assert ("pot-missing", "PSM1") in harness.errors()
    (event,) = [event for event in harness.events if event.code == "pot-missing"]
    assert event.axis == 2
    assert not harness.record.power_requested[0] and not harness.record.relay[0]
    harness.events.clear()
    assert harness.do("power_on", "PSM1").outcome == "failed"
    assert ("pot-missing", "PSM1") in harness.errors()
    tables.readings = honest  # type: ignore[method-assign]
    harness.run(0.1)
    harness.bring_up("PSM1")


def test_a_file_for_another_si_arm_is_refused_before_anything_is_powered() -> None:
    system = rig_of("jhu-daVinci-Si/system-PSM1").system
    assert system.emulation is not None
    whole = system.emulated()
    other = replace(whole.ios[0], robots=(replace(whole.ios[0].robots[0], serial="334809"),))
    emulation = replace(system.emulation, ios=(other,))
    with pytest.raises(PortError, match=r"board 6 identifies as p292409\.cal.*334809 should be p334809\.cal"):
        BoardsHarness(replace(system, emulation=emulation))


def test_preloaded_encoders_of_an_si_arm_survive_a_restart_of_io() -> None:
    harness = rig_of("jhu-daVinci-Si/system-PSM1")
    assert not harness.preset.any()
    harness.bring_up("PSM1")
    harness.run(0.1)
    before = harness.record.encoder_bits.copy()
    assert prepare(harness.robots, harness.port).all()
    harness.port.read_all()
    after = harness.port.blocks[0, harness.port.columns.position][:7].astype(np.int64) - 0x800000
    assert np.abs(after - before).max() < 50


@pytest.mark.parametrize("system", ["jhu-daVinci-Si/system-PSM1", "jhu-dVRK/system-MTML", "jhu-daVinci/system-ECM"])
def test_a_lost_reply_is_tolerated_by_every_robot(system: str) -> None:
    harness = rig_of(system)
    robot = harness.io.robots[0].name
    harness.bring_up(robot)
    for _ in range(20):
        harness.link.lose = 1
        harness.cycle()
        assert not harness.record.valid and harness.record.age_ns > 0
        harness.cycle()
        assert harness.record.valid
    assert harness.errors() == [] and harness.record.powered[0] and harness.record.pid_enabled[0]


@pytest.mark.parametrize("system", ["jhu-dVRK/system-PSM1", "jhu-daVinci-Si/system-PSM1"])
def test_a_board_that_all_others_depend_on_returns_from_power_up_and_is_set_up_as_at_the_start(system: str) -> None:
    harness = rig_of(system)
    for name, *values in (("power_on",), ("bias_encoders", 300)):
        assert harness.do(name, "PSM1", *values).outcome == "done"
    hub, faults = harness.robots.board_ids[0], BoardFaults(harness.world, harness.plant)
    counts = registers.watchdog_counts(harness.io.watchdog_s)
    on_hub = harness.robots.board_row[: harness.robots.axes] == 0
    faults.take_away(hub, True, harness.io.name)
    harness.run(0.1)
    faults.take_away(hub, False, harness.io.name)
    harness.port.write_quadlet(hub, registers.WATCHDOG, counts + 1)  # as after power-up: another one than the file's
    harness.run(0.1)
    assert [code for code, _ in harness.errors()] == ["bad-reads"]
    assert harness.port.read_quadlet(hub, registers.WATCHDOG) == counts
    assert not harness.record.biased[0] and not harness.record.encoder_set[on_hub].any()
    assert harness.record.encoder_set[~on_hub].all(), "the other boards have kept their power, and what was set"
    harness.bring_up("PSM1")
    truth = harness.world.position[harness.world.wiring.robots["PSM1"]]
    assert np.abs(truth - harness.record.position).max() < 0.02
