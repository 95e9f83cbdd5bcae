"""Robots of real sites on emulated boards: powered, biased, held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procs.config import load_system
from procs.fpga import lookup
from procs.io.bus.port import PortError
from procs.io.start import prepare
from tests import stock
from tests.io.boards_harness import Rig


def rig_of(name: str) -> Rig:
    loaded = load_system(stock.find(f"dvrk-site/{name}.json"), search=[stock.find("dvrk-share")], boards="emulated")
    assert loaded.errors == () and loaded.system is not None, loaded.errors
    return Rig(loaded.system)


@pytest.mark.parametrize(("system", "robot"), [
    ("jhu-dVRK/system-PSM1", "PSM1"),
    pytest.param("jhu-daVinci-Si/system-PSM1", "PSM1", marks=pytest.mark.slow),
    pytest.param("jhu-daVinci-Si/system-ECM", "ECM", marks=pytest.mark.slow),
    pytest.param("jhu-daVinci/system-ECM", "ECM", marks=pytest.mark.slow), ("jhu-dVRK/system-MTML", "MTML"),
])
def test_a_robot_of_a_real_site_is_powered_biased_and_held(system: str, robot: str) -> None:
    rig = rig_of(system)
    rig.bring_up(robot)
    place, axes = rig.robots.names.index(robot), rig.robots.slices[rig.robots.names.index(robot)]
    if rig.io.robots[place].brakes:
        assert not rig.record.brakes_released[place]
        assert rig.do("brake_release", robot).outcome == "done"
        rig.run(2.2)
        assert rig.record.brakes_released[place]
    start = rig.record.setpoint_position[axes].copy()
    rig.run(1.0)
    assert rig.errors() == []
    assert rig.record.powered[place] and rig.record.amps_on[place] and rig.record.pid_enabled[place]
    np.testing.assert_array_equal(rig.record.setpoint_position[axes], start)
    assert np.abs(rig.record.position_error[axes]).max() < 0.1
    truth = rig.world.position[rig.world.wiring.robots[robot]]
    assert np.abs(truth - rig.record.position[axes]).max() < 0.02


def test_potentiometers_of_an_si_arm_agree_with_its_encoders() -> None:
    rig = rig_of("jhu-daVinci-Si/system-PSM1")
    rig.bring_up("PSM1")
    rig.run(0.2)
    # two steps of a table; encoders were set from the same potentiometers
    assert np.abs(rig.record.pot_position - rig.record.position).max() < 0.01
    truth = rig.world.position[rig.world.wiring.robots["PSM1"]]
    assert np.abs(rig.record.pot_position - truth).max() < 0.01


def test_a_reading_without_a_position_cuts_power_and_opens_the_relays_each_time_it_is_met() -> None:
    rig = rig_of("jhu-daVinci-Si/system-PSM1")
    rig.bring_up("PSM1")
    tables = rig.world.wiring.tables
    table = lookup.unpack(rig.io.robots[0].lookup, 7)
    nowhere = int(np.flatnonzero(np.isnan(table[2]))[0])
    honest = tables.readings

    def broken(position: np.ndarray) -> np.ndarray:
        found = honest(position)
        found[2] = nowhere
        return found

    tables.readings = broken  # type: ignore[method-assign]
    rig.run(0.1)
    assert ("pot-missing", "PSM1") in rig.errors()
    (event,) = [event for event in rig.events if event.code == "pot-missing"]
    assert event.axis == 2
    assert not rig.record.power_wanted[0] and not rig.record.relay[0]
    rig.events.clear()
    assert rig.do("power_on", "PSM1").outcome == "failed"
    assert ("pot-missing", "PSM1") in rig.errors()
    tables.readings = honest  # type: ignore[method-assign]
    rig.run(0.1)
    rig.bring_up("PSM1")


def test_a_file_for_another_si_arm_is_refused_before_anything_is_powered() -> None:
    loaded = load_system(stock.find("dvrk-site/jhu-daVinci-Si/system-PSM1.json"), search=[stock.find("dvrk-share")],
                         boards="emulated")
    assert loaded.system is not None and loaded.system.emulation is not None
    whole = loaded.system.emulated()
    other = replace(whole.ios[0], robots=(replace(whole.ios[0].robots[0], serial="334809"),))
    emulation = replace(loaded.system.emulation, ios=(other,))
    with pytest.raises(PortError, match=r"the arm on board 6 is p292409\.cal.*334809 is p334809\.cal"):
        Rig(replace(loaded.system, emulation=emulation))


def test_preloaded_encoders_of_an_si_arm_survive_a_restart_of_io() -> None:
    rig = rig_of("jhu-daVinci-Si/system-PSM1")
    assert not rig.preset.any()
    rig.bring_up("PSM1")
    rig.run(0.1)
    before = rig.record.encoder_bits.copy()
    assert prepare(rig.robots, rig.port).all()
    rig.port.read_all()
    after = rig.port.blocks[0, rig.port.columns.position][:7].astype(np.int64) - 0x800000
    assert np.abs(after - before).max() < 50


@pytest.mark.parametrize("system", ["jhu-daVinci-Si/system-PSM1", "jhu-dVRK/system-MTML", "jhu-daVinci/system-ECM"])
def test_a_lost_reply_is_tolerated_by_every_robot(system: str) -> None:
    rig = rig_of(system)
    robot = rig.io.robots[0].name
    rig.bring_up(robot)
    for _ in range(20):
        rig.link.lose = 1
        rig.cycle()
        assert not rig.record.valid and rig.record.age_ns > 0
        rig.cycle()
        assert rig.record.valid
    assert rig.errors() == [] and rig.record.powered[0] and rig.record.pid_enabled[0]
