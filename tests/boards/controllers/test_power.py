"""Watchdog, motor power, amplifiers and the current check, on a stepped clock."""

from __future__ import annotations

import numpy as np

from tests.boards.harness import MS, ON, Desk, board
from tests.cases import cases
from trocar.procs.boards.controllers import power
from trocar.procs.boards.controllers.models import models_of
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire


def two(watchdog: int = 0) -> Desk:
    """Two boards, ids 0 and 1."""
    return Desk(board(board_id=0), board(board_id=1), watchdog=watchdog)


def powered() -> Desk:
    """With amplifiers on."""
    desk = two()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.write(reg.STATUS, reg.CONTROL_AMPS_ON)
    desk.tick += 60 * MS
    return desk


@cases("address", [reg.DAC | 0x10, reg.DIGITAL_OUTPUT, reg.HARDWARE_ID, 0x0F, 0x5E, 0x9000])
def test_any_register_write_refreshes_the_watchdog(address: int) -> None:
    desk = two(watchdog=4)
    for _ in range(5):
        desk.tick += 1000
        desk.write(address, 0)
        desk.write(address, 0, node=1)
    assert not desk.read() & reg.STATUS_WATCHDOG
    desk.tick += 1025
    assert desk.read() & reg.STATUS_WATCHDOG


def test_blocks_and_queries_refresh_and_reads_do_not() -> None:
    desk = two(watchdog=4)
    desk.tick += 1000
    desk.block(0x106, 0, 0, 0, 0, 0)  # board 1 only
    desk.tick += 500
    assert desk.read() & reg.STATUS_WATCHDOG
    assert not desk.read(node=1) & reg.STATUS_WATCHDOG
    desk = two(watchdog=4)
    for _ in range(5):
        desk.tick += 1000
        desk.write(reg.QUERY, 1 << 16 | 1, node=wire.BROADCAST)
    assert not (desk.read() | desk.read(node=1)) & reg.STATUS_WATCHDOG


def test_the_expiry_tick_does_not_depend_on_polling() -> None:
    ticks = []
    for looks in (1, 7, 1000):
        desk = powered()
        desk.write(reg.WATCHDOG, 0x1680)
        for _ in range(looks):
            desk.tick += 200 * MS // looks
            desk.bus.step(desk.tick)
        ticks.append((int(desk.power.watchdog_tick[0]), int(desk.power.cut_tick[0])))
    assert len(set(ticks)) == 1


def test_clearing_by_power_does_not_bring_amplifiers_back() -> None:
    desk = powered()
    desk.write(reg.WATCHDOG, 2)
    desk.tick += 2000
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert desk.read() & 0x0080000F == 0
    desk.write(reg.WATCHDOG, 0)
    desk.write(0x21, ON)
    assert desk.read() & 0x0F00 == 0x0200  # supply and hold-off were over long ago


# -- power and amplifiers ----------------------------------------------------------------------------------------------


def test_enables_in_command_words_touch_only_masked_axes() -> None:
    desk = two()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.block(0x006, 0xB0008100, 0x90008100, 0x30009999, 0x80008100, 0)
    assert [bool(desk.motor(k) & reg.MOTOR_STATUS_AMP_REQUESTED) for k in range(4)] == [True, False, True, False]
    assert [desk.motor(k) & 0xFFFF for k in range(4)] == [0x8100, 0x8100, 0x8000, 0x8100]
    desk.block(0x006, 0xA0008100, 0x80008100, 0x00008100, 0x80008100, 0)
    assert [bool(desk.motor(k) & reg.MOTOR_STATUS_AMP_REQUESTED) for k in range(4)] == [False, False, True, False]


def test_same_enables_every_cycle_still_recover_from_a_trip() -> None:
    desk = powered()
    desk.write(reg.WATCHDOG, 0x1680)
    for gap_ms in (1, 1, 100):
        desk.tick += gap_ms * MS
        desk.block(0x006, *[0xB0008000] * 4, 0)
    assert int(desk.power.watchdog_tick[0]) > 0
    assert desk.read() & 0x00800F00 == 0x0F00
    desk.tick += 100 * MS
    assert desk.read() & 0x00800F00 == 0x00800000


def test_hold_off_begins_anew_when_the_supply_comes_back() -> None:
    desk = powered()
    desk.power.lose_supply(0, True, desk.tick)
    assert desk.read() & 0x000C8F00 == 0x00048000
    desk.tick += MS
    desk.power.lose_supply(0, False, desk.tick)
    desk.tick += power.SUPPLY_RAMP
    assert desk.read() & 0x000C8F00 == 0x000C0000
    desk.tick += power.AMP_HOLD
    assert desk.read() & 0x000C8F00 == 0x000C0F00


def test_failed_amplifier_is_reported_and_stays_enabled() -> None:
    desk = powered()
    desk.power.fail_amplifier(0, 2, True, desk.tick)
    assert desk.read() & 0x0F00 == 0x0B00
    assert desk.motor(2) & 0x3003_0000 == reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_FAULT


def test_relay_closes_after_its_travel_and_ignores_the_watchdog() -> None:
    desk = two()
    desk.bus.answer(bytes.fromhex("0000ffff8c00ffd000000000000000030000d57aebf2"), 0)  # F.8
    for node in (0, 1):
        assert desk.read(node=node) & 0x00030000 == reg.STATUS_RELAY
    desk.write(reg.WATCHDOG, 2)
    desk.tick += power.RELAY_TRAVEL
    assert desk.read() & 0x00830000 == 0x00830000
    desk.write(reg.STATUS, reg.CONTROL_RELAY_OFF)
    desk.tick += power.RELAY_FALL
    assert desk.read() & 0x00030000 == 0


# -- current check -----------------------------------------------------------------------------------------------------


@cases(("asked", "measured", "trips"), [
    (0x9000, 0x9900, False), (0x9000, 0x9901, True), (0x7000, 0x9900, True), (0x7000, 0x98FF, False),
    (0x8000, 0x8902, True), (0x8000, 0x8300, False), (0x9000, 0x66FE, True), (0x9000, 0x6700, False),
    (0xF6FF, 0xFFFF, False), (0x0900, 0xFFFF, False), (0xF000, 0xF901, True), (0x0000, 0x0000, False),
])
def test_current_law_ignores_sign_small_and_full_scale(asked: int, measured: int, trips: bool) -> None:
    desk = powered()
    desk.write(0x11, 0x80000000 | asked)
    desk.lines.adc[0, 0] = measured
    desk.hold(60)
    assert bool(desk.read() & 0x10) == trips


def test_a_pause_starts_the_50_ms_again() -> None:
    desk = powered()
    for _ in range(4):
        desk.lines.adc[0, 1] = 0xB000
        desk.hold(45)
        desk.lines.adc[0, 1] = 0x8000
        desk.hold(2)
    assert desk.read() & 0xF0 == 0


def test_enabling_clears_a_current_trip_of_that_axis() -> None:
    desk = powered()
    desk.lines.adc[0, 0] = 0xB000
    desk.lines.adc[0, 1] = 0xB000
    desk.hold(60)
    assert desk.read() & 0xF0 == 0x30
    desk.lines.adc[0, 0] = 0x8000
    desk.lines.adc[0, 1] = 0x8000
    desk.hold(1)
    desk.write(0x11, ON)
    assert desk.read() & 0x0FF0 == 0x0D20
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert desk.read() & 0xF0 == 0


def test_a_board_may_be_told_not_to_check() -> None:
    desk = powered()
    desk.write(reg.axis_register(0, reg.MOTOR_CONFIG), 1 << 31)
    desk.lines.adc[0, 0] = 0xB000
    desk.hold(80)
    assert desk.read() & 0xF0 == 0


def test_switching_off_what_is_off_is_not_heeded_and_anything_else_is() -> None:
    model = power.BoardPower(models_of((Controller(6), Controller(7))), np.zeros((2, 4), dtype=bool))
    off = np.full(2, reg.CONTROL_POWER_OFF | reg.CONTROL_AMPS_OFF, dtype=np.uint32)
    assert not model.heeds(off)
    assert not model.heeds(np.zeros(2, dtype=np.uint32))
    for word in (reg.CONTROL_POWER_ON, reg.CONTROL_RELAY_ON, reg.CONTROL_RELAY_OFF, reg.CONTROL_AMPS_ON):
        assert model.heeds(np.array([0, word], dtype=np.uint32))
    model.control(np.array([reg.CONTROL_POWER_ON, 0], dtype=np.uint32), 1000)
    assert model.heeds(off)
