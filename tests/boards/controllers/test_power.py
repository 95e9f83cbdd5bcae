"""Watchdog, motor power, amplifiers and the current check, on a stepped clock."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.procs.boards.controllers import bus as wired
from trocar.procs.boards.controllers import power
from trocar.procs.boards.controllers.models import models_of
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

MS = 49152
ENABLE_1 = 0x3000_0000  # motor command word: mask and enable, not valid


class Bus:
    """Two boards, ids 0 and 1, and the tick of the next datagram."""

    def __init__(self, *, watchdog: int | None = 0) -> None:
        self.bus = wired.EmulatedBus((Controller(0), Controller(1)))
        self.tick = 0
        if watchdog is not None:
            for node in (0, 1):
                self.write(reg.WATCHDOG, watchdog, node)

    def write(self, address: int, value: int, node: int = 0) -> None:
        self.bus.answer(wire.quadlet_write(node, address, value, 1, self.bus.generation), self.tick)

    def block(self, *quads: int) -> None:
        data = np.array(quads, dtype=">u4").tobytes()
        self.bus.answer(wire.block_write(wire.BROADCAST, 0, data, 1, self.bus.generation), self.tick)

    def read(self, address: int = reg.STATUS, node: int = 0) -> int:
        reply = wire.decode_response(
            self.bus.answer(wire.quadlet_read(node, address, 1, self.bus.generation), self.tick) or b"")
        assert isinstance(reply, wire.WireResponse)
        return reply.value

    def motor(self, axis: int = 0) -> int:
        return self.read(reg.axis_register(axis, reg.MOTOR_STATUS))

    def power_on(self) -> None:
        self.write(reg.STATUS, reg.CONTROL_POWER_ON)
        self.write(reg.STATUS, reg.CONTROL_AMPS_ON)
        self.tick += 60 * MS

    def measure(self, axis: int, bits: int) -> None:
        self.bus.lines.adc[0, axis] = bits


# -- watchdog ----------------------------------------------------------------------------------------------------------


def test_watchdog_has_fired_before_anybody_writes() -> None:
    bus = Bus(watchdog=None)
    bus.tick = 31 * MS
    assert bus.read(node=1) == 0x41B00000
    assert int(bus.bus.power.watchdog_tick[1]) == 0x1680 * 256 + 1


def test_period_2_fires_after_513_ticks() -> None:
    bus = Bus()
    bus.tick = 1000
    bus.write(reg.WATCHDOG, 2)
    bus.tick = 1000 + 512
    assert not bus.read() & reg.STATUS_WATCHDOG
    bus.tick = 1000 + 513
    assert bus.read() & reg.STATUS_WATCHDOG
    assert not bus.read(node=1) & reg.STATUS_WATCHDOG


@pytest.mark.parametrize("address", [reg.DAC | 0x10, reg.DIGITAL_OUTPUT, reg.HARDWARE_ID, 0x0F, 0x5E, 0x9000])
def test_any_register_write_refreshes_the_watchdog(address: int) -> None:
    bus = Bus(watchdog=4)
    for _ in range(5):
        bus.tick += 1000
        bus.write(address, 0)
        bus.write(address, 0, node=1)
    assert not bus.read() & reg.STATUS_WATCHDOG
    bus.tick += 1025
    assert bus.read() & reg.STATUS_WATCHDOG


def test_blocks_and_queries_refresh_and_reads_do_not() -> None:
    bus = Bus(watchdog=4)
    bus.tick += 1000
    bus.block(0x106, 0, 0, 0, 0, 0)  # board 1 only
    bus.tick += 500
    assert bus.read() & reg.STATUS_WATCHDOG
    assert not bus.read(node=1) & reg.STATUS_WATCHDOG
    bus = Bus(watchdog=4)
    for _ in range(5):
        bus.tick += 1000
        bus.write(reg.QUERY, 1 << 16 | 1, node=wire.BROADCAST)
    assert not (bus.read() | bus.read(node=1)) & reg.STATUS_WATCHDOG


def test_watchdog_cuts_amplifiers_and_nothing_else() -> None:
    bus = Bus()
    bus.power_on()
    bus.write(reg.STATUS, reg.CONTROL_RELAY_ON)
    bus.write(0x11, 0x80009000)
    bus.write(reg.WATCHDOG, 0x1680)
    fired = bus.tick + 0x1680 * 256 + 1
    bus.tick += 29 * MS
    assert bus.read() & 0x008F0F0F == 0x000F0F0F
    bus.tick += 100 * MS
    assert bus.read() & 0x008F0F0F == 0x008F0000
    assert not bus.motor() & (reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_ON)
    assert bus.read(0x11) == 0x9000
    assert int(bus.bus.power.watchdog_tick[0]) == fired == int(bus.bus.power.cut_tick[0])


def test_the_expiry_tick_does_not_depend_on_polling() -> None:
    ticks = []
    for looks in (1, 7, 1000):
        bus = Bus()
        bus.power_on()
        bus.write(reg.WATCHDOG, 0x1680)
        for _ in range(looks):
            bus.tick += 200 * MS // looks
            bus.bus.step(bus.tick)
        ticks.append((int(bus.bus.power.watchdog_tick[0]), int(bus.bus.power.cut_tick[0])))
    assert len(set(ticks)) == 1


def test_ordinary_writes_leave_the_watchdog_flag() -> None:
    bus = Bus(watchdog=2)
    bus.tick += 2000
    bus.write(reg.DIGITAL_OUTPUT, 0)
    bus.write(reg.STATUS, reg.CONTROL_RELAY_ON)
    bus.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    bus.write(reg.STATUS, reg.CONTROL_AMPS_OFF)
    assert bus.read() & reg.STATUS_WATCHDOG


@pytest.mark.parametrize(("address", "value"), [(0, reg.CONTROL_POWER_ON), (0, 0x0101), (0x21, ENABLE_1)])
def test_power_and_enable_commands_clear_the_watchdog_flag(address: int, value: int) -> None:
    bus = Bus(watchdog=2)
    bus.tick += 2000
    bus.write(address, value)
    assert not bus.read() & reg.STATUS_WATCHDOG


def test_clearing_by_power_does_not_bring_amplifiers_back() -> None:
    bus = Bus()
    bus.power_on()
    bus.write(reg.WATCHDOG, 2)
    bus.tick += 2000
    bus.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert bus.read() & 0x0080000F == 0
    bus.write(reg.WATCHDOG, 0)
    bus.write(0x21, ENABLE_1)
    assert bus.read() & 0x0F00 == 0x0200  # supply and hold-off were over long ago


# -- power and amplifiers ----------------------------------------------------------------------------------------------


def test_power_sequence_takes_the_ramp_and_the_hold_off() -> None:
    bus = Bus()
    bus.write(reg.STATUS, 0x000C0000)
    assert bus.read() & 0x000C0F0F == 0x00040000
    bus.tick += power.SUPPLY_RAMP
    assert bus.read() & 0x000C0F0F == 0x000C0000
    bus.write(reg.STATUS, 0x00000F0F)
    assert bus.motor() & 0x3003_0000 == reg.MOTOR_STATUS_AMP_REQUESTED, "held off is not a fault"
    bus.tick += 7680 * 256 - 1
    assert bus.read() & 0x0F0F == 0
    bus.tick += 1
    assert bus.read() & 0x000C0F0F == 0x000C0F0F
    assert bus.motor() & 0x3003_0000 == reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_ON


def test_one_control_word_turns_power_and_amplifiers_on_and_off() -> None:
    bus = Bus()
    bus.write(reg.STATUS, 0x000C0F0F)
    assert bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED
    bus.tick += 60 * MS
    assert bus.read() & 0x000C0F0F == 0x000C0F0F
    bus.write(reg.STATUS, 0x00080000)
    assert bus.read() & 0x000C0F0F == 0
    assert not bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED
    assert int(bus.bus.power.cut_tick[0]) == bus.tick


def test_amplifiers_cannot_be_enabled_without_power() -> None:
    bus = Bus()
    bus.write(0x11, ENABLE_1)
    bus.write(reg.STATUS, 0x0F0F)
    assert not bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED
    bus.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert not bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED


def test_in_one_block_enables_come_before_power() -> None:
    bus = Bus()
    bus.block(0x006, *[0xB0008000] * 4, 0x000C0000)
    assert bus.read() & reg.STATUS_POWER
    assert not bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED
    bus.block(0x006, *[0xB0008000] * 4, 0)
    assert bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED


def test_enables_in_command_words_touch_only_masked_axes() -> None:
    bus = Bus()
    bus.write(reg.STATUS, reg.CONTROL_POWER_ON)
    bus.block(0x006, 0xB0008100, 0x90008100, 0x30009999, 0x80008100, 0)
    assert [bool(bus.motor(k) & reg.MOTOR_STATUS_AMP_REQUESTED) for k in range(4)] == [True, False, True, False]
    assert [bus.motor(k) & 0xFFFF for k in range(4)] == [0x8100, 0x8100, 0x8000, 0x8100]
    bus.block(0x006, 0xA0008100, 0x80008100, 0x00008100, 0x80008100, 0)
    assert [bool(bus.motor(k) & reg.MOTOR_STATUS_AMP_REQUESTED) for k in range(4)] == [False, False, True, False]


def test_same_enables_every_cycle_still_recover_from_a_trip() -> None:
    bus = Bus()
    bus.power_on()
    bus.write(reg.WATCHDOG, 0x1680)
    for gap_ms in (1, 1, 100):
        bus.tick += gap_ms * MS
        bus.block(0x006, *[0xB0008000] * 4, 0)
    assert int(bus.bus.power.watchdog_tick[0]) > 0
    assert bus.read() & 0x00800F00 == 0x0F00
    bus.tick += 100 * MS
    assert bus.read() & 0x00800F00 == 0x00800000


def test_hold_off_begins_anew_when_the_supply_comes_back() -> None:
    bus = Bus()
    bus.power_on()
    bus.bus.power.lose_supply(0, True, bus.tick)
    assert bus.read() & 0x000C8F00 == 0x00048000
    bus.tick += MS
    bus.bus.power.lose_supply(0, False, bus.tick)
    bus.tick += power.SUPPLY_RAMP
    assert bus.read() & 0x000C8F00 == 0x000C0000
    bus.tick += power.AMP_HOLD
    assert bus.read() & 0x000C8F00 == 0x000C0F00


def test_failed_amplifier_is_reported_and_stays_enabled() -> None:
    bus = Bus()
    bus.power_on()
    bus.bus.power.fail_amplifier(0, 2, True, bus.tick)
    assert bus.read() & 0x0F00 == 0x0B00
    assert bus.motor(2) & 0x3003_0000 == reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_FAULT


def test_relay_closes_after_its_travel_and_ignores_the_watchdog() -> None:
    bus = Bus()
    bus.bus.answer(bytes.fromhex("0000ffff8c00ffd000000000000000030000d57aebf2"), 0)  # F.8
    for node in (0, 1):
        assert bus.read(node=node) & 0x00030000 == reg.STATUS_RELAY
    bus.write(reg.WATCHDOG, 2)
    bus.tick += power.RELAY_TRAVEL
    assert bus.read() & 0x00830000 == 0x00830000
    bus.write(reg.STATUS, reg.CONTROL_RELAY_OFF)
    bus.tick += power.RELAY_FALL
    assert bus.read() & 0x00030000 == 0


# -- current check -----------------------------------------------------------------------------------------------------


def _held(bus: Bus, ms: int) -> None:
    for _ in range(ms):
        bus.bus.step(bus.tick)
        bus.bus.firmware.motors.check_currents(bus.tick)
        bus.tick += MS


def test_too_much_current_trips_after_50_ms() -> None:
    bus = Bus()
    bus.power_on()
    bus.write(0x11, 0x80009000)
    bus.measure(0, 0xA000)
    first = bus.tick
    _held(bus, 40)
    bus.tick = first + 2_457_600 - 1
    assert bus.read() & 0xF0 == 0
    bus.tick += 1
    assert bus.read() & 0x0FF0 == 0x0E10
    assert bus.motor() & reg.MOTOR_STATUS_SAFETY
    assert not bus.motor() & reg.MOTOR_STATUS_AMP_REQUESTED


@pytest.mark.parametrize(("asked", "measured", "trips"), [
    (0x9000, 0x9900, False), (0x9000, 0x9901, True), (0x7000, 0x9900, True), (0x7000, 0x98FF, False),
    (0x8000, 0x8902, True), (0x8000, 0x8300, False), (0x9000, 0x66FE, True), (0x9000, 0x6700, False),
    (0xF6FF, 0xFFFF, False), (0x0900, 0xFFFF, False), (0xF000, 0xF901, True), (0x0000, 0x0000, False),
])
def test_current_law_ignores_sign_small_and_full_scale(asked: int, measured: int, trips: bool) -> None:
    bus = Bus()
    bus.power_on()
    bus.write(0x11, 0x80000000 | asked)
    bus.measure(0, measured)
    _held(bus, 60)
    assert bool(bus.read() & 0x10) == trips


def test_a_pause_starts_the_50_ms_again() -> None:
    bus = Bus()
    bus.power_on()
    for _ in range(4):
        bus.measure(1, 0xB000)
        _held(bus, 45)
        bus.measure(1, 0x8000)
        _held(bus, 2)
    assert bus.read() & 0xF0 == 0


def test_enabling_clears_a_current_trip_of_that_axis() -> None:
    bus = Bus()
    bus.power_on()
    bus.measure(0, 0xB000)
    bus.measure(1, 0xB000)
    _held(bus, 60)
    assert bus.read() & 0xF0 == 0x30
    bus.measure(0, 0x8000)
    bus.measure(1, 0x8000)
    _held(bus, 1)
    bus.write(0x11, ENABLE_1)
    assert bus.read() & 0x0FF0 == 0x0D20
    bus.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert bus.read() & 0xF0 == 0


def test_a_board_may_be_told_not_to_check() -> None:
    bus = Bus()
    bus.power_on()
    bus.write(reg.axis_register(0, reg.MOTOR_CONFIG), 1 << 31)
    bus.measure(0, 0xB000)
    _held(bus, 80)
    assert bus.read() & 0xF0 == 0


def test_switching_off_what_is_off_is_not_heeded_and_anything_else_is() -> None:
    model = power.BoardPower(models_of((Controller(6), Controller(7))), np.zeros((2, 4), dtype=bool))
    off = np.full(2, reg.CONTROL_POWER_OFF | reg.CONTROL_AMPS_OFF, dtype=np.uint32)
    assert not model.heeds(off)
    assert not model.heeds(np.zeros(2, dtype=np.uint32))
    for word in (reg.CONTROL_POWER_ON, reg.CONTROL_RELAY_ON, reg.CONTROL_RELAY_OFF, reg.CONTROL_AMPS_ON):
        assert model.heeds(np.array([0, word], dtype=np.uint32))
    model.control(np.array([reg.CONTROL_POWER_ON, 0], dtype=np.uint32), 1000)
    assert model.heeds(off)
