"""What happens to boards and robots is seen by the host."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.boards.rails import MS, START, Rails, real_time, two_buses, write
from tests.fpga import board_side
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.emulation import Emulation
from trocar.procs.document.system import Controller
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg


def _world() -> tuple[Emulation, BoardFaults]:
    rails = Rails(7)
    world = Emulation(two_buses(), rails, START)
    return world, BoardFaults(world, rails)  # type: ignore[arg-type]  # a plant as far as it goes


def test_buttons_have_their_released_level_until_pressed() -> None:
    world, board_faults = _world()

    def level(node: int, bit: int) -> int:
        return int(real_time(world, 0, node, START + 1)[blocks.DIGITAL_INPUT]) >> bit & 1

    assert (level(0, 4), level(1, 0), level(0, 5)) == (1, 0, 1)
    board_faults.press("clutch", True)
    board_faults.press("limit", True)
    assert (level(0, 4), level(1, 0)) == (0, 1)
    board_faults.press("clutch", False)
    assert level(0, 4) == 1
    with pytest.raises(KeyError, match="clutch, limit"):
        board_faults.press("camera", True)


def test_faults_reach_the_robot_they_are_meant_for() -> None:
    world, board_faults = _world()
    write(world, 0, wire.BROADCAST, reg.STATUS, 0x000C0F0F, START + 500)
    write(world, 1, wire.BROADCAST, reg.STATUS, 0x000C0F0F, START + 500)
    for bus in (0, 1):
        for node in (0, 1)[: 2 - bus]:
            write(world, bus, node, reg.WATCHDOG, 0, START + 600)
    world.advance(START + 70 * MS)
    now = START + 70 * MS + 1
    board_faults.fail_amplifier("PSM1", 4, True)  # board 3, axis 2
    assert real_time(world, 0, 1, now)[blocks.STATUS] & 0xF00 == 0xB00
    board_faults.lose_supply("PSM1", True)
    assert [int(real_time(world, 0, node, now)[blocks.STATUS]) & 0x8F00 for node in (0, 1)] == [0x8000, 0x8000]
    assert real_time(world, 1, 0, now)[blocks.STATUS] & 0x8F00 == 0x0F00
    before = int(real_time(world, 1, 0, now)[blocks.POSITION][1])
    board_faults.jump_encoder("ECM", 1, 250)
    assert int(real_time(world, 1, 0, now)[blocks.POSITION][1]) - before == 250
    with pytest.raises(KeyError, match="allowed: 0 to 1"):
        board_faults.jump_encoder("ECM", 2, 1)


def test_an_emergency_stop_takes_the_supply_and_not_the_boards() -> None:
    world, board_faults = _world()
    for node in (0, 1):
        write(world, 0, node, reg.STATUS, 0x000F0F0F, START + 500)
        write(world, 0, node, reg.WATCHDOG, 0, START + 600)
    world.advance(START + 70 * MS)

    def status(at: int) -> list[int]:
        return [int(real_time(world, 0, node, START + at * MS)[blocks.STATUS]) & 0x000F_8F00 for node in (0, 1)]

    assert status(71) == [0x000F_0F00] * 2
    board_faults.stop(True)
    assert status(72) == [0x0005_0000] * 2  # supply and relay feedback are gone, what was commanded is not
    board_faults.lose_supply("PSM1", True)
    board_faults.stop(False)
    assert status(80) == [0x0007_8000] * 2  # the supply stays away for another reason
    board_faults.stop(True)
    board_faults.lose_supply("PSM1", False)
    board_faults.stop(False)
    assert status(99) == [0x0007_0000] * 2  # it ramps up
    assert status(101) == [0x000F_0000] * 2
    assert status(141) == [0x000F_0F00] * 2  # amplifiers were only held off


def test_what_was_not_lost_does_not_ramp_up_again() -> None:
    world, board_faults = _world()
    write(world, 0, 0, reg.STATUS, 0x000C0000, START + 500)
    world.advance(START + 25 * MS)
    board_faults.lose_supply("PSM1", False)
    assert real_time(world, 0, 0, START + 26 * MS)[blocks.STATUS] & reg.STATUS_MV_GOOD


def _query(world: Emulation, sequence: int, ids: tuple[int, ...], now: int) -> list[int]:
    """Headers that a broadcast query of bus 0 collects, 0 for what is missing."""
    write(world, 0, wire.BROADCAST, reg.QUERY, sequence << 16 | sum(1 << board for board in ids), now)
    reply = world.answer(0, wire.block_read(0, reg.HUB, (33 * len(ids) + 1) * 4, 1, 1), now + 1000)
    response = board_side.decode_response(reply or b"")
    assert isinstance(response, board_side.WireResponse)
    return [int(quad) for quad in np.frombuffer(response.data, ">u4")[:-1:33]]


def test_a_board_is_away_until_it_is_back_as_new() -> None:
    world, board_faults = _world()
    write(world, 0, 0, reg.WATCHDOG, 0x1234, START + 500)
    board_faults.take_away(9, True, "IO1")  # node 0, the hub: the whole bus is silent
    assert world.answer(0, wire.quadlet_read(0, reg.STATUS, 1, 2), START + 1000) is None
    board_faults.take_away(9, True, "IO1")
    board_faults.take_away(9, False, "IO1")
    generation = world.buses[0].generation
    board_faults.take_away(9, False, "IO1")  # it is back already
    assert world.buses[0].generation == generation == 3
    reply = board_side.decode_response(world.answer(0, wire.quadlet_read(0, reg.WATCHDOG, 1, 3), START + 2000) or b"")
    assert isinstance(reply, board_side.WireResponse)
    assert reply.value == reg.WATCHDOG_POWER_UP


def test_a_bus_reset_drops_requests_of_the_old_generation() -> None:
    world, board_faults = _world()
    board_faults.reset_bus("IO1")
    request = wire.quadlet_read(0, reg.STATUS, 1, 1)
    replies = [board_side.decode_response(world.answer(bus, request, START + 1000) or b"") for bus in (0, 1)]
    assert [type(reply) for reply in replies] == [board_side.Dropped, board_side.WireResponse]
    assert [reply.trailer.generation for reply in replies] == [2, 1]
    board_faults.reset_bus()
    assert [bus.generation for bus in world.buses] == [3, 2]


def test_a_hub_block_is_missing_as_often_as_asked() -> None:
    world, board_faults = _world()
    board_faults.withhold(9, 2, "IO1")
    seen = [_query(world, k, (3, 9), START + k * MS) for k in (1, 2, 3)]
    assert [[bool(head) for head in heads] for heads in seen] == [[True, False], [True, False], [True, True]]


def test_a_sequence_is_wrong_as_often_as_asked() -> None:
    world, board_faults = _world()
    board_faults.spoil_sequence(3, 1, "IO1")
    seen = [_query(world, k, (3, 9), START + k * MS) for k in (1, 2)]
    right = [[head >> 15 & 0x1FF == sequence << 1 for head in heads] for sequence, heads in enumerate(seen, 1)]
    assert right == [[False, True], [True, True]]


def test_temperatures_are_shown_in_half_degrees() -> None:
    world, board_faults = _world()
    board_faults.heat(9, 66.5, 31.0, "IO2")
    assert real_time(world, 1, 0, START + 1000)[blocks.TEMPERATURE] & 0xFFFF == 133 << 8 | 62
    with pytest.raises(ValueError, match=r"128 °C; allowed: 0 to 127\.5"):
        board_faults.heat(9, 30.0, 128.0, "IO2")


def test_a_dra1_cannot_be_heated() -> None:
    system = two_buses()
    assert system.emulation is not None
    first, second = system.emulation.buses
    buses = (first, replace(second, controllers=(Controller(9, "dRA1", 8, "V3"),)))
    rails = Rails(7)
    world = Emulation(replace(system, emulation=replace(system.emulation, buses=buses)), rails, START)
    with pytest.raises(ValueError, match="board 9: a dRA1 has no temperature sensors"):
        BoardFaults(world, rails).heat(9, 30.0, 31.0, "IO2")  # type: ignore[arg-type]  # a plant as far as it goes


def test_too_much_measured_current_trips_the_check_of_the_board() -> None:
    world, board_faults = _world()
    world.advance(START + 5 * MS)
    before = real_time(world, 0, 1, START + 5 * MS)[blocks.ADC]
    board_faults.shift_current("PSM1", 4, -0.5)  # board 3 (node 1), axis 2
    world.advance(START + 7 * MS)
    after = real_time(world, 0, 1, START + 7 * MS)
    assert (after[blocks.ADC] - before).tolist() == [0, 0, pytest.approx(-0.5 * 5242.88, abs=1), 0]
    assert not after[blocks.STATUS] & 0xF0
    world.advance(START + 60 * MS)
    assert real_time(world, 0, 1, START + 60 * MS)[blocks.STATUS] & 0xF0 == 0x40
    board_faults.shift_current("PSM1", 4, 0.0)
    world.advance(START + 62 * MS)
    assert (real_time(world, 0, 1, START + 62 * MS)[blocks.ADC] == before).all()


def test_a_potentiometer_drifts_until_it_is_put_right() -> None:
    world, board_faults = _world()

    def volts(at: int) -> float:
        world.advance(START + at * MS)
        return float(real_time(world, 0, 0, START + at * MS)[blocks.ADC][3] >> 16) * 6.866455e-5

    before = volts(5)
    board_faults.drift("PSM1", 2, 2.0)  # board 9 (node 0), axis 3
    assert volts(105) - before == pytest.approx(0.2, abs=2e-4)
    board_faults.drift("PSM1", 2, 0.0)
    assert volts(200) - before == pytest.approx(0.2, abs=2e-4)
    board_faults.drift("PSM1", 2, 0.0, 0.0)
    assert volts(210) == before


def test_wrong_names_are_answered_with_what_there_is() -> None:
    world, board_faults = _world()
    wrong: list[tuple[Callable[[], None], str]] = [
        (lambda: board_faults.take_away(3, True), "board 3: specify its bus; there are IO1, IO2"),
        (lambda: board_faults.withhold(4, 1, "IO1"), "board 4: not on the bus of IO1; there are 3, 9"),
        (lambda: board_faults.reset_bus("IO3"), "IO3: no such bus; there are IO1, IO2"),
        (lambda: board_faults.drift("PSM1", 5, 1.0), "PSM1: axis 5; allowed: 0 to 4"),
        (lambda: board_faults.lose_supply("", True), "no name: no such robot; there are PSM1, ECM")]
    for act, reason in wrong:
        with pytest.raises(KeyError, match=reason):
            act()
    slot = world.wiring.slots[1]
    world.wiring.pot_volts.scale[slot] = world.wiring.counts.scale[slot] = 0.0
    with pytest.raises(ValueError, match="PSM1: axis 1 has no potentiometer"):
        board_faults.drift("PSM1", 1, 1.0)
    with pytest.raises(ValueError, match="PSM1: axis 1 has no encoder"):
        board_faults.jump_encoder("PSM1", 1, 1)


def test_what_is_done_to_a_robot_must_fit_it() -> None:
    _, board_faults = _world()
    for robot, values, reason in (("PSM1", [1.0, 2.0], "2 efforts; allowed: 5 from -100 to 100"),
                                  ("ECM", [1.0, float("nan")], "2 efforts; allowed: 2"),
                                  ("ECM", [1.0, -101.0], "2 efforts; allowed: 2"),
                                  ("MTML", [1.0], "no such robot; there are PSM1, ECM")):
        with pytest.raises((KeyError, ValueError), match=reason):
            board_faults.push(robot, np.array(values))
    with pytest.raises(ValueError, match="2 positions; allowed: 2 from -10 to 10"):
        board_faults.place("ECM", np.array([0.0, float("inf")]))
