"""What happens to boards and robots is seen by the host."""

from __future__ import annotations

import numpy as np
import pytest

from procs.boards.emulation import Emulation
from procs.boards.incidents import Incidents
from procs.lib import blocks, wire
from procs.lib import registers as reg
from tests.boards.rails import MS, START, Rails, real_time, two_buses, write


def _world() -> tuple[Emulation, Incidents]:
    rails = Rails(7)
    world = Emulation(two_buses(), rails, START)
    return world, Incidents(world, rails)  # type: ignore[arg-type]  # a plant as far as it goes


def test_buttons_have_their_released_level_until_pressed() -> None:
    world, incidents = _world()

    def level(node: int, bit: int) -> int:
        return int(real_time(world, 0, node, START + 1)[blocks.DIGITAL_INPUT]) >> bit & 1

    assert (level(0, 4), level(1, 0), level(0, 5)) == (0, 1, 1)
    incidents.press("clutch", True)
    incidents.press("limit", True)
    assert (level(0, 4), level(1, 0)) == (1, 0)
    incidents.press("clutch", False)
    assert level(0, 4) == 0
    with pytest.raises(KeyError, match="clutch, limit"):
        incidents.press("camera", True)


def test_faults_reach_the_robot_they_are_meant_for() -> None:
    world, incidents = _world()
    write(world, 0, wire.BROADCAST, reg.STATUS, 0x000C0F0F, START + 500)
    write(world, 1, wire.BROADCAST, reg.STATUS, 0x000C0F0F, START + 500)
    for bus in (0, 1):
        for node in (0, 1)[: 2 - bus]:
            write(world, bus, node, reg.WATCHDOG, 0, START + 600)
    world.advance(START + 70 * MS)
    now = START + 70 * MS + 1
    incidents.fail_amplifier("PSM1", 4, True)  # board 3, axis 2
    assert real_time(world, 0, 1, now)[blocks.STATUS] & 0xF00 == 0xB00
    incidents.lose_supply("PSM1", True)
    assert [int(real_time(world, 0, node, now)[blocks.STATUS]) & 0x8F00 for node in (0, 1)] == [0x8000, 0x8000]
    assert real_time(world, 1, 0, now)[blocks.STATUS] & 0x8F00 == 0x0F00
    before = int(real_time(world, 1, 0, now)[blocks.POSITION][1])
    incidents.jump_encoder("ECM", 1, 250)
    assert int(real_time(world, 1, 0, now)[blocks.POSITION][1]) - before == 250
    with pytest.raises(KeyError, match="allowed: 0 to 1"):
        incidents.jump_encoder("ECM", 2, 1)


def test_an_emergency_stop_takes_the_supply_and_not_the_boards() -> None:
    world, incidents = _world()
    for node in (0, 1):
        write(world, 0, node, reg.STATUS, 0x000F0F0F, START + 500)
        write(world, 0, node, reg.WATCHDOG, 0, START + 600)
    world.advance(START + 70 * MS)

    def status(at: int) -> list[int]:
        return [int(real_time(world, 0, node, START + at * MS)[blocks.STATUS]) & 0x000F_8F00 for node in (0, 1)]

    assert status(71) == [0x000F_0F00] * 2
    incidents.stop(True)
    assert status(72) == [0x0005_0000] * 2  # supply and relay feedback are gone, what was commanded is not
    incidents.lose_supply("PSM1", True)
    incidents.stop(False)
    assert status(80) == [0x0007_8000] * 2  # the supply stays away for another reason
    incidents.stop(True)
    incidents.lose_supply("PSM1", False)
    incidents.stop(False)
    assert status(99) == [0x0007_0000] * 2  # it ramps up
    assert status(101) == [0x000F_0000] * 2
    assert status(141) == [0x000F_0F00] * 2  # amplifiers were only held off


def test_what_was_not_lost_does_not_ramp_up_again() -> None:
    world, incidents = _world()
    write(world, 0, 0, reg.STATUS, 0x000C0000, START + 500)
    world.advance(START + 25 * MS)
    incidents.lose_supply("PSM1", False)
    assert real_time(world, 0, 0, START + 26 * MS)[blocks.STATUS] & reg.STATUS_MV_GOOD


def test_efforts_from_outside_must_fit_the_robot() -> None:
    _, incidents = _world()
    for robot, efforts, reason in (("PSM1", [1.0, 2.0], "2 efforts; allowed: 5 finite"),
                                   ("ECM", [1.0, float("nan")], "allowed: 2 finite"),
                                   ("MTML", [1.0], "no such robot; there are PSM1, ECM")):
        with pytest.raises((KeyError, ValueError), match=reason):
            incidents.push(robot, np.array(efforts))
