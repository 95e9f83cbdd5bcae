"""What the registers of controllers say, in words."""

from __future__ import annotations

import pytest

from trocar.procs.fpga import registers
from trocar.tools.inspect import register_names, samples
from trocar.tools.inspect.bus_client import FoundBoard, serial_of
from trocar.tools.output.errors import Misuse, Problem

QLA, DQLA, DRA = (FoundBoard(2, 0, hardware, 8, 2, 0, True) for hardware in ("QLA1", "DQLA", "dRA1"))


def test_every_register_has_one_name() -> None:
    for name, address in register_names.BOARD_REGISTERS.items():
        assert register_names.address_name(address) == name
    for name in register_names.AXIS_REGISTERS:
        (address,) = register_names.addresses(f"{name}:2", DQLA)
        assert register_names.address_name(address) == f"{name}:2"


def test_controllers_have_their_own_number_of_axes() -> None:
    assert len(register_names.addresses("ENCODER", DRA)) == 7
    assert len(register_names.addresses("DAC", DRA)) == 10
    with pytest.raises(Misuse, match="ENCODER:1 to ENCODER:4"):
        register_names.addresses("ENCODER:5", QLA)


def test_status_is_told_by_name() -> None:
    words = register_names.status_words(0x428F_0F00 | registers.STATUS_SAFETY_VOLTAGE, "QLA1", 8)
    assert words[:2] == ["board 2", "watchdog tripped"]
    assert {"relay closed", "motor supply good", "motor power on", "amplifiers on: 1 2 3 4"} <= set(
        register_names.status_words(0x420F_0F00, "QLA1", 8))
    assert "voltage on the safety line" in words


def test_dqla_tells_its_two_halves_apart() -> None:
    words = register_names.status_words(registers.STATUS_DQLA_MV_GOOD << 1, "DQLA", 8)
    assert "first QLA: motor supply not good" in words and "second QLA: motor supply good" in words


def test_writing_the_status_register_is_told_as_control() -> None:
    reported = register_names.written_meaning(registers.STATUS, 0x000C_0303, QLA)
    assert reported == "motor power on, amplifiers on: 1 2"
    assert register_names.written_meaning(registers.STATUS, registers.CONTROL_POWER_OFF, QLA) == "motor power off"
    assert register_names.written_meaning(registers.STATUS, 1, QLA).startswith("no mask bit is set")
    assert "reboot" in register_names.written_meaning(registers.STATUS, registers.CONTROL_REBOOT, QLA)


@pytest.mark.parametrize(("name", "value", "reported"), [
    ("ENCODER:1", 0x0080_0064, "+100 counts"),
    ("ENCODER:1", 0x017F_FFFF, "-1 counts, overflow"),
    ("ADC:1", 0x8000_8000, "pot 2.2500 V, current +0.0000 A"),
    ("DAC:1", 0x9000, "+0.7812 A"),
    ("TEMPERATURE", 0x3CFF, "30 °C –"),
    ("WATCHDOG", 0, "off"),
    ("IP_ADDRESS", 0x6400_FEA9, "169.254.0.100"),
    ("ETHERNET", 0x4000_0000, "FPGA V3"),
    ("GIT_DESCRIPTION", 0, "a release"),
    ("PERIOD:1", registers.VELOCITY_DIRECTION | 4 * 49152, "+1000.0 counts/s"),
    ("PERIOD:1", registers.PERIOD_POWER_UP, "0 counts/s"),
    ("MOTOR_CONFIG:1", registers.MOTOR_CONFIG_POWER_UP, "current limit 0.200 A, delay 2.50 ms"),
    ("MOTOR_STATUS:1", registers.MOTOR_STATUS_AMP_ON | 0x8000, "amplifier on, commanded 0x8000"),
    ("QUERY", 5, ""),
])
def test_known_registers_are_decoded(name: str, value: int, reported: str) -> None:
    (address,) = register_names.addresses(name, QLA)
    assert register_names.meaning(address, value, QLA) == reported


@pytest.mark.parametrize(("word", "reported"), [
    (0, "off"), (registers.MOTOR_STATUS_AMP_REQUESTED, "requested"), (registers.MOTOR_STATUS_AMP_ON, "on"),
    (registers.MOTOR_STATUS_SAFETY, "cut (current)"), (registers.MOTOR_STATUS_AMP_FAULT, "fault")])
def test_amplifiers_are_told_in_words(word: int, reported: str) -> None:
    assert register_names.amplifier(0, word, 0, "QLA1", 8) == reported


def test_rev_7_amplifiers_come_from_the_status() -> None:
    assert register_names.amplifier(0x0202, 0, 1, "QLA1", 7) == "on"
    assert register_names.amplifier(0x0002, 0, 1, "QLA1", 7) == "fault"
    assert register_names.amplifier(0x0020, 0, 1, "QLA1", 7) == "cut (current)"


def test_unknown_controllers_cannot_be_watched() -> None:
    with pytest.raises(Problem, match="cannot be watched; allowed: QLA1, DQLA, dRA1"):
        samples.layout(FoundBoard(0, 0, "BCFG", 9, 3, 0, True))


def test_sample_tells_velocity_and_overflow() -> None:
    words = [0] * samples.layout(QLA).read_quads
    words[1], words[9] = 0x4200_0000, 0x0180_0010  # status; position of axis 2
    words[13] = registers.VELOCITY_DIRECTION | 4 * 49152
    sample = samples.sample_of(QLA, words, 0x1680)
    second = sample.axes[1]
    assert (second.encoder_counts, second.overflow) == (16, True)
    assert second.velocity_counts_s == pytest.approx(1000.0)


@pytest.mark.parametrize(("data", "reported"), [
    (b"FPGA 1234-56\xff\xff", "1234-56"), (b"QLA 1234-56\0\xff", ""), (b"\xff" * 16, ""), (b"\0" * 16, "")])
def test_serial_numbers_end_where_text_ends(data: bytes, reported: str) -> None:
    assert serial_of(data, "FPGA") == reported
