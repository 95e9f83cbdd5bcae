"""dRA1: digital amplifiers behind interlocks, and the arm's electronics."""

from __future__ import annotations

import numpy as np
import pytest

from tests.boards.harness import COLLECT, MASK, MS, ON, VALID, Desk, board
from tests.cases import cases
from trocar.procs.boards.controllers import digital, power
from trocar.procs.boards.controllers.espm import SUPPLY_BITS
from trocar.procs.boards.devices.dallas import instrument_memory
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

BASE = 0xA300_0007  # 10 axes, board 3, ESPM there in all respects, encoders not preloaded
PRELOADED = 8
POWERED = 0x000C_0000
REQUESTED, PIN = reg.MOTOR_STATUS_AMP_REQUESTED, reg.MOTOR_STATUS_AMP_ON


def _desk(firmware: int = 9, *, preload: bool = True, serial: str = "p292409.cal", tardy: bool = True) -> Desk:
    desk = Desk(board(firmware, "dRA1", serial=serial, quirks=Quirks(late_deviation=tardy)))
    if preload:
        desk.write(reg.axis_register(0, reg.ENCODER_PRELOAD), 0x80_0000)
        desk.tick += MS
    return desk


def _on(firmware: int = 9, *, tardy: bool = True) -> Desk:
    desk = _desk(firmware, tardy=tardy)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += power.SUPPLY_RAMP
    desk.group(*[ON | VALID | 0x8000] * 10, 0)
    assert desk.on() == [True] * 10
    return desk


def _deviate(desk: Desk, axis: int, bits: int, ms: int) -> None:
    """The measured current of an axis is off by so much for so long."""
    desk.lines.adc[0, axis] = int(desk.lines.dac[0, axis]) + bits
    desk.hold(ms)


# -- power and interlocks ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", [8, 9])
def test_status_tells_of_the_arm_and_not_of_amplifiers(firmware: int) -> None:
    desk = _desk(firmware, preload=False)
    assert desk.read() == BASE
    desk.write(reg.axis_register(2, reg.ENCODER_PRELOAD), 0x80_0000)
    desk.tick += digital.PRELOAD_TICKS
    assert desk.read() == BASE | PRELOADED
    assert _on(firmware).read() == BASE | PRELOADED | POWERED
    assert _desk(serial="e438610.cal").read() == BASE | PRELOADED | reg.STATUS_ECM


def test_an_enable_waits_for_supply_and_preload_and_no_longer() -> None:
    desk = _desk(preload=False)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.dac(4, ON)
    assert desk.motor(4) & (REQUESTED | PIN) == REQUESTED
    desk.tick += power.SUPPLY_RAMP
    assert desk.motor(4) & (REQUESTED | PIN) == REQUESTED
    desk.write(reg.axis_register(0, reg.ENCODER_PRELOAD), 0x80_0000)
    desk.tick += digital.PRELOAD_TICKS
    assert desk.motor(4) & (REQUESTED | PIN) == REQUESTED | PIN, "there is no hold-off"
    assert desk.motor(3) & (REQUESTED | PIN) == 0


def test_a_broken_interlock_cuts_and_it_takes_another_enable() -> None:
    desk = _on()
    desk.power.lose_supply(0, True, desk.tick)
    assert (desk.on(), desk.requests()) == ([False] * 10, [True] * 10)
    desk.power.lose_supply(0, False, desk.tick)
    desk.tick += power.SUPPLY_RAMP
    assert desk.on() == [False] * 10
    desk.group(*[ON, VALID | 0x8000] * 5, 0)
    assert desk.on() == [True, False] * 5


def test_enables_need_power_and_stay_requested_without_it_until_the_next_word() -> None:
    desk = _desk()
    desk.dac(0, ON)
    assert desk.requests()[0] is False
    desk = _on()
    desk.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    assert (desk.on(), desk.requests()) == ([False] * 10, [True] * 10)
    desk.dac(0, VALID)
    assert desk.requests() == [False, *[True] * 9]
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON | 0x0F0F)
    desk.tick += 60 * MS
    assert desk.on() == [False] * 10, "neither power nor axis bits of a control word bring them back"


def test_the_watchdog_cuts_and_leaves_the_requests() -> None:
    desk = _on()
    desk.dac(0, VALID | 0x8100)
    desk.write(reg.WATCHDOG, 2)
    desk.tick += 1000
    assert desk.read() == BASE | PRELOADED | POWERED | reg.STATUS_WATCHDOG
    assert (desk.on(), desk.requests()) == ([False] * 10, [True] * 10)
    desk.write(reg.WATCHDOG, 0)
    desk.write(reg.STATUS, 0x0101)
    assert desk.read() & reg.STATUS_WATCHDOG
    desk.dac(9, ON)
    assert not desk.read() & reg.STATUS_WATCHDOG
    assert desk.on() == [False] * 9 + [True]


def test_interlocks_may_be_bypassed() -> None:
    desk = _desk(preload=False)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += power.SUPPLY_RAMP
    desk.dac(0, ON)
    assert desk.on()[0] is False
    desk.write(0xB100, 0x10)
    assert desk.on()[0] is True
    desk.write(0xB100, 0)
    assert desk.on()[0] is False


def test_an_arm_without_supply_is_missed_after_two_looks_and_forgets_that_it_was_preloaded() -> None:
    desk = _on()
    desk.write(0xB102, 0)
    off = desk.tick
    assert desk.read() & 0xF == 0b1011
    desk.tick = (off // (1 << 19) + 2) * (1 << 19) - 1
    assert desk.on()[0] is True
    desk.tick += 1
    assert desk.read() & 0xF == 0b1010
    assert desk.on()[0] is False
    desk.write(0xB102, 1)
    desk.tick += digital.ESPM_START
    assert desk.read() & 0xF == 0b0111
    desk.write(reg.axis_register(0, reg.ENCODER_PRELOAD), 0x80_0000)
    desk.tick += MS
    assert desk.read() & 0xF == 0b1111


def test_a_reboot_takes_preload_bypass_and_faults_with_it() -> None:
    desk = _on()
    desk.write(0xB100, 0x1F)
    desk.bus.take_away(0, True)
    desk.bus.take_away(0, False)
    desk.write(reg.WATCHDOG, 0)
    assert desk.read() == BASE
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.dac(0, ON)
    desk.tick += 60 * MS
    assert desk.on()[0] is False


# -- commands ----------------------------------------------------------------------------------------------------------


def test_an_amplifier_takes_commands_only_while_it_is_on_and_forgets_them_when_it_goes() -> None:
    desk = _desk()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += power.SUPPLY_RAMP
    desk.dac(0, VALID | 0x9000)
    assert desk.axis(0, reg.DAC) == 0x8000
    desk.dac(0, ON | VALID | 0x9000)
    assert (desk.axis(0, reg.DAC), desk.on()[0]) == (0x8000, True), "not even that of the enabling word"
    for _ in range(3):
        desk.group(ON | VALID | 0x9000, *[0] * 9, 0)
    assert desk.axis(0, reg.DAC) == int(desk.lines.dac[0, 0]) == 0x9000
    desk.dac(0, MASK)
    assert desk.axis(0, reg.DAC) == int(desk.lines.dac[0, 0]) == 0x8000
    desk.group(ON, *[0] * 9, 0)
    assert desk.axis(0, reg.DAC) == 0x8000


def test_motor_status_shows_mode_and_duty_cycle() -> None:
    desk = _on()
    assert desk.motor(0) == REQUESTED | PIN
    desk.dac(0, VALID | 0x8000 + 4800)  # 1 A through 5 Ω of 48 V
    duty = round(5 / 48 * 1023)
    assert desk.motor(0) == REQUESTED | PIN | duty << 5
    desk.dac(4, VALID | 0x8000 - 16000)
    assert desk.motor(4) == REQUESTED | PIN | (-duty & 0x7FF) << 5
    assert desk.read(0x905A) == 0x1_0000_0000 - duty
    desk.dac(4, MASK)
    assert desk.motor(4) == 0


@pytest.mark.parametrize(("ratio", "amperes"), [(0.1, 0.96), (-0.1, -0.96), (0.2, 1.92), (-1.0, -2.048), (1.0, 2.048)])
def test_in_voltage_mode_a_duty_cycle_is_commanded(ratio: float, amperes: float) -> None:
    desk = _on()
    duty = int(ratio * 1023) & 0x7FF  # as the original library makes it
    desk.dac(4, VALID | 1 << 24 | duty << 13)
    assert desk.motor(4) == REQUESTED | PIN | 1 << 24 | duty << 5
    assert (int(desk.lines.dac[0, 4]) - 0x8000) / 16000 == pytest.approx(amperes, abs=0.006)
    assert desk.axis(4, reg.DAC) == 0x8000
    desk.dac(4, VALID | 5 << 24 | 0x9000)
    assert desk.motor(4) == REQUESTED | PIN | 5 << 24
    assert int(desk.lines.dac[0, 4]) == 0x8000, "other modes drive nothing"
    desk.dac(4, VALID | 0x9000)
    assert int(desk.lines.dac[0, 4]) == 0x9000


# -- faults ------------------------------------------------------------------------------------------------------------


@cases(("axis", "bits", "counts"), [
    (0, 0x200, False), (0, 0x201, True), (1, -0x201, True), (2, 0x800, False), (2, 0x801, True), (9, -0x801, True)])
def test_the_deviation_counts_down_and_is_looked_at_only_when_the_amplifier_goes_off(axis: int, bits: int,
                                                                                     counts: bool) -> None:
    desk = _on()
    _deviate(desk, axis, bits, 70)
    assert desk.motor(axis) & 0x000F_0000 == 0
    assert desk.on()[axis] is True, "as real ones: too much for 70 ms and still on"
    desk.dac(axis, MASK)
    assert desk.motor(axis) >> 16 & 0xF == (2 if counts else 0)
    desk.lines.adc[0, axis] = 0x8000
    desk.hold(1)
    desk.dac(axis, ON)
    assert desk.motor(axis) & 0x300F_0000 == REQUESTED | PIN, "an enable forgives"


def test_the_word_that_enables_is_taken_when_it_comes_again() -> None:
    desk = _on()
    desk.group(*[MASK | VALID | 0x8000] * 10, 0)
    word = ON | VALID | 0x9000
    for _ in range(2):
        desk.group(*[word] * 10, 0)
    assert int(desk.lines.dac[0, 4]) == 0x9000
    desk.group(*[VALID | 0x9100] * 10, 0)
    desk.group(*[VALID | 0x9200] * 10, 0)
    assert int(desk.lines.dac[0, 4]) == 0x9200


@pytest.mark.parametrize(("word", "code"), [(VALID | 0x8000, 2), (ON | VALID | 0x8000, 0)])
def test_a_host_that_repeats_its_enables_forgives_with_each_of_them(word: int, code: int) -> None:
    desk = _on()
    for _ in range(80):
        _deviate(desk, 4, 0x1000, 1)
        desk.group(*[word] * 10, 0)
    desk.dac(4, MASK)
    assert desk.motor(4) >> 16 & 0xF == code


def test_enables_that_come_again_without_anything_to_forgive_change_nothing() -> None:
    desk = _on()
    desk.group(*[ON | VALID | 0x8000] * 10, 0)
    changes = desk.power.changes
    desk.group(*[ON | VALID | 0x8123] * 10, 0)
    assert (desk.power.changes, desk.lines.dac[0].tolist()) == (changes, [0x8123] * 10)


def test_without_the_quirk_the_deviation_cuts_the_amplifier_when_it_is_counted_down() -> None:
    desk = _on(tardy=False)
    desk.lines.adc[0, 4] = 0x9000
    desk.bus.step(desk.tick)
    desk.bus.firmware.motors.check_currents(desk.tick)
    empty = desk.tick + 4095 * 2048 // 3
    desk.tick = empty - 700  # a cycle of the current loop
    assert desk.on()[4] is True
    desk.tick = empty + 700
    assert desk.on()[4] is False and desk.on()[5] is True
    assert desk.motor(4) >> 16 & 0xF == 2
    desk.lines.adc[0, 4] = 0x8000
    desk.hold(1)
    desk.dac(4, ON)
    assert desk.motor(4) & 0x300F_0000 == REQUESTED | PIN, "an enable forgives"


def test_the_deviation_takes_4095_cycles_of_13_9_us_and_comes_back_as_slowly() -> None:
    cycles = 2048 / 3  # ticks
    for ticks, code in ((4090 * cycles, 0), (4100 * cycles, 2)):
        desk = _on()
        desk.lines.adc[0, 0] = 0x9000
        desk.bus.firmware.motors.check_currents(desk.tick)
        desk.tick += int(ticks)
        desk.dac(0, MASK)
        assert desk.motor(0) >> 16 & 0xF == code
    desk = _on()
    for _ in range(20):
        _deviate(desk, 0, 0x1000, 40)
        _deviate(desk, 0, 0, 41)
    _deviate(desk, 0, 0x1000, 55)
    desk.dac(0, MASK)
    assert desk.motor(0) >> 16 & 0xF == 0


def test_a_converter_at_its_end_cuts_until_an_enable_or_power_command_forgives() -> None:
    desk = _on()
    for axis, bits in ((3, 0), (5, 0xFFFF)):
        desk.lines.adc[0, axis] = bits
    desk.hold(1)
    assert [axis for axis, on in enumerate(desk.on()) if not on] == [3, 5]
    assert desk.motor(3) == REQUESTED | 1 << 16
    assert desk.read(0x904B) == 1
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    assert desk.motor(3) == REQUESTED, "forgiven, but it takes an enable"
    desk.dac(3, ON)
    assert desk.motor(3) == REQUESTED | PIN
    desk.hold(1)
    assert desk.motor(3) == REQUESTED | 1 << 16, "and is found out again"


@pytest.mark.parametrize(("axis", "other", "lines"), [(7, 8, 0x3EF), (9, 0, 0x3F7), (1, 4, 0x3FB), (3, 6, 0x3FE)])
def test_two_amplifiers_share_a_bridge_and_its_fault_line(axis: int, other: int, lines: int) -> None:
    desk = _on()
    desk.power.fail_amplifier(0, axis, True, desk.tick)
    assert sorted(k for k, on in enumerate(desk.on()) if not on) == sorted((axis, other))
    assert desk.motor(other) == REQUESTED | 3 << 16
    assert desk.read(0xB004) == lines
    desk.dac(axis, ON)
    assert desk.motor(axis) == REQUESTED | 3 << 16, "as long as it lasts"
    desk.power.fail_amplifier(0, axis, False, desk.tick)
    desk.dac(axis, ON)
    assert (desk.on()[axis], desk.on()[other]) == (True, False)


def test_the_check_of_a_qla_is_none_of_its() -> None:
    desk = _on()
    desk.dac(0, VALID | 0x8100)
    _deviate(desk, 0, 0x1000, 80)
    assert desk.on() == [True] * 10


# -- samples and registers ---------------------------------------------------------------------------------------------


def test_its_real_time_block_has_10_motors_and_7_encoders() -> None:
    desk = _on()
    desk.lines.adc[0] = 0x1ABC_8000
    desk.lines.inputs[0] = 0x0001_2345
    quads = desk.real_time()
    assert len(quads) == 59
    assert quads[2:4] == [0x0001_2345, 0x0400_0000], "no temperatures; the collection's state"
    assert quads[4:14] == [0x0ABC_8000] * 7 + [0xCCCC_8000] * 3, "pots of 12 bits, none for brakes"
    assert quads[14:21] == [0x80_0000] * 7, "no lines beside the counts"
    assert quads[21:28] == [reg.PERIOD_POWER_UP] * 7
    assert quads[49:] == [REQUESTED | PIN] * 10
    assert desk.read(0xB021) == desk.read(reg.DIGITAL_INPUT) == quads[2]
    assert desk.read(0xB020) == quads[3]


def test_periods_are_measured_by_a_clock_of_80_mhz() -> None:
    desk = Desk(board(9), board(9, "dRA1", 4))
    rate, axes = 0.001, 2 * desk.bus.firmware.width  # counts a tick
    desk.bus.encoders.follow(0, 49_152, np.outer((0.0, rate, 0.0), np.ones(axes)))
    desk.tick = 40_000
    plain, far = (desk.axis(0, reg.PERIOD, node) & reg.VELOCITY_TICKS_MASK for node in (0, 1))
    assert far == pytest.approx(plain * 80 / 49.152, abs=2)
    assert 4 / (far / 80e6) == pytest.approx(rate * reg.CLOCK_HZ, rel=0.01)


@cases(("address", "value"), [
    (0x06, 0), (0x0D, 0), (0x0E, 0), (0x6000, 0), (0x8000, 0), (0x18, 0xCCCC), (0x1B, 0xCCCC), (0x12, 0xCCCC),
    (0xA5, 0), (0x9010, 0), (0x9011, 2000), (0x9012, 200), (0x9013, 1000), (0x9014, 1000), (0x9015, 0), (0x9016, 0),
    (0x9019, 0xCCCC_CCCC), (0x9001, 0), (0x90B1, 0), (0xB000, 0), (0xB002, 0), (0xB003, 0xCCCC), (0xB004, 0x3FF),
    (0xB010, 2), (0xB012, 0xFFFF_FFFF), (0xB013, 0xFF), (0xBFFF, 0x100), (0xA010, 1), (0xA008, 2), (0x05, 0),
])
def test_registers_read_as_the_real_firmware_has_them(address: int, value: int) -> None:
    assert _desk().read(address) == value


def test_current_loops_can_be_tuned_within_their_bits() -> None:
    desk = _desk()
    for offset, bits in ((1, 18), (2, 18), (3, 16), (4, 16), (5, 18), (6, 18)):
        desk.write(0x9040 | offset, 0xFFFF_FFFF)
        assert desk.read(0x9040 | offset) == (1 << bits) - 1
    assert desk.read(0x9051) == 2000
    desk.write(0x9040, 3)
    assert desk.read(0x9040) == 0, "the mode comes with command words alone"


def test_the_motor_supply_is_48_v_once_it_is_good() -> None:
    desk = _on()
    assert desk.read(0xB002) == SUPPLY_BITS


def test_the_arms_serial_number_is_read_word_by_word_as_the_original_library_does() -> None:
    desk = _desk()
    text = b""
    for place in range(16):
        for enable in (0, 1):
            desk.write(0xA002, enable << 28 | 1 << 24 | place)
        text += (desk.read(0xA031) & 0xFFFF).to_bytes(2, "little")
    assert text.rstrip(b"\0") == b"p292409.cal"


def test_an_instrument_shows_model_and_version() -> None:
    desk = _desk()
    desk.bus.boards[0].dallas.insert(instrument_memory("Large Needle Driver", 0x00_0667_58, 9), desk.tick)
    assert desk.read(0xB012).to_bytes(4, "little") == bytes.fromhex("00066758")
    assert desk.read(0xB013) == 9
    assert desk.read(0xA018) == desk.read(0xB012)


def test_data_collection_shows_in_its_fourth_quadlet() -> None:
    desk = _on()
    desk.dac(8, VALID | COLLECT | 0x8000)
    assert desk.read(reg.DATA_BUFFER_STATUS) >> 10 == 0x20 | 9
    assert desk.real_time()[3] >> 26 == 0x20 | 9
