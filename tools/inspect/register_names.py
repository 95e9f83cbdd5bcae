"""Registers by name, and the meanings of their bits: for people without the manual at hand."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from trocar.procs.fpga import blocks, registers
from trocar.procs.fpga.velocity import FirmwareVelocity
from trocar.tools.inspect.bus_client import FoundBoard
from trocar.tools.output.errors import Misuse

LARGEST_ADDRESS: Final = 0xFFFF
OF_THE_BOARD: Final = (
    "STATUS", "PHY_REQUEST", "PHY_RESPONSE", "WATCHDOG", "HARDWARE_ID", "TEMPERATURE", "DIGITAL_OUTPUT", "FIRMWARE",
    "PROM_COMMAND", "PROM_RESULT", "DIGITAL_INPUT", "IP_ADDRESS", "ETHERNET", "DALLAS", "IO_EXPANDER",
    "GIT_DESCRIPTION", "HUB", "QUERY", "FPGA_PROM", "QLA_PROM_COMMAND", "QLA_PROM_STATUS", "QLA_PROM_RESULT",
    "QLA_PROM_BUFFER", "DALLAS_MEMORY", "DATA_BUFFER", "DATA_BUFFER_STATUS", "WAVEFORM")
OF_AN_AXIS: Final = (
    "ADC", "DAC", "ENCODER_PRELOAD", "ENCODER", "PERIOD", "QUARTER_1", "PWM", "QUARTER_5", "RUNNING", "MOTOR_CONFIG",
    "MOTOR_STATUS")
OF_A_MOTOR: Final = ("ADC", "DAC", "PWM", "MOTOR_CONFIG", "MOTOR_STATUS")  # the others are of every encoder
BOARD_REGISTERS: Final[dict[str, int]] = {name: getattr(registers, name) for name in OF_THE_BOARD}
AXIS_REGISTERS: Final[dict[str, int]] = {name: getattr(registers, name) for name in OF_AN_AXIS}
_BOARD_NAMES: Final = {address: name for name, address in BOARD_REGISTERS.items()}
_AXIS_NAMES: Final = {offset: name for name, offset in AXIS_REGISTERS.items()}

Flag = tuple[int, str, str]  # bit, its meaning set, and clear; an empty text is not shown

_ALWAYS: Final[tuple[Flag, ...]] = (
    (registers.STATUS_WATCHDOG, "watchdog tripped", "watchdog fine"),
    (registers.STATUS_POWER, "motor power on", "motor power off"),
    (registers.STATUS_RELAY, "relay closed", "relay open"),
)
_SUPPLY: Final = ("motor supply good", "motor supply not good")
_STATUS: Final[dict[str, tuple[Flag, ...]]] = {
    "QLA1": (
        (registers.STATUS_MV_GOOD, *_SUPPLY),
        (registers.STATUS_RELAY_FEEDBACK, "relay feedback closed", "relay feedback open"),
        (registers.STATUS_MV_FAULT, "motor supply fault", ""),
        (registers.STATUS_SAFETY_VOLTAGE, "voltage on the safety line", ""),
        (registers.STATUS_IO_EXPANDER, "I/O expander", ""),
        (registers.STATUS_QUAD_DAC, "quad DAC", ""),
        (registers.STATUS_DOUT_CONFIGURED, "", "digital outputs not detected"),
        (registers.STATUS_DOUT_BIDIRECTIONAL, "bidirectional outputs", ""),
    ),
    "DQLA": tuple(
        (bit << qla, f"{'second' if qla else 'first'} QLA: {text}" if text else "",
         f"{'second' if qla else 'first'} QLA: {other}" if other else "")
        for qla in (0, 1) for bit, text, other in (
            (registers.STATUS_DQLA_MV_GOOD, *_SUPPLY),
            (registers.STATUS_DQLA_SAFETY_VOLTAGE, "voltage on the safety line", ""),
            (registers.STATUS_DQLA_EXPANDER, "I/O expander", ""),
            (registers.STATUS_DQLA_QUAD_DAC, "quad DAC", ""),
            (registers.STATUS_DQLA_DOUT_CONFIGURED, "", "digital outputs not detected"),
            (registers.STATUS_DQLA_DOUT_BIDIRECTIONAL, "bidirectional outputs", ""))),
    "dRA1": (
        (registers.STATUS_MV_GOOD, *_SUPPLY),
        (registers.STATUS_RELAY_FEEDBACK, "relay feedback closed", "relay feedback open"),
        (registers.STATUS_ECM, "ECM", ""),
        (registers.STATUS_PRELOADED, "encoders preloaded", "encoders not preloaded"),
        (registers.STATUS_ESPM, "arm electronics answer", "arm electronics silent"),
        (registers.STATUS_ESPM_REACHES_ARM, "", "arm not reached"),
        (registers.STATUS_ESPM_SUPPLY, "", "arm electronics without supply"),
    ),
}


def address_name(address: int) -> str:
    """Name of a register, `ENCODER:2` for one of axis 2; its number if it has no name."""
    channel, offset = address >> 4, address & 0xF
    if address in _BOARD_NAMES:
        return _BOARD_NAMES[address]
    if 1 <= channel <= 0xF and offset in _AXIS_NAMES:
        return f"{_AXIS_NAMES[offset]}:{channel}"
    return f"0x{address:04X}"


def addresses(text: str, board: FoundBoard | None, count: int = 1) -> list[int]:
    """The registers given by a person: a name, NAME:AXIS, or a number; a bare axis register means that of every axis.

    `board` None: all boards, and a bare axis register is Misuse, which names the allowed ones.
    """
    name, colon, axis_text = text.upper().partition(":")
    if name in AXIS_REGISTERS:
        motors, encoders = blocks.AXES_OF.get(board.hardware, blocks.AXES_OF["QLA1"]) if board else (10, 10)
        axes = motors if name in OF_A_MOTOR else encoders
        if not colon and board is not None and count == 1:
            return [registers.axis_register(axis, AXIS_REGISTERS[name]) for axis in range(axes)]
        if not axis_text.isdecimal() or not 1 <= int(axis_text) <= axes:
            raise Misuse(f"register {text}: which axis? allowed: {name}:1 to {name}:{axes}")
        first = registers.axis_register(int(axis_text) - 1, AXIS_REGISTERS[name])
    elif name in BOARD_REGISTERS and not colon:
        first = BOARD_REGISTERS[name]
    else:
        first = _numbered(text, name)
    if first + count - 1 > LARGEST_ADDRESS:
        raise Misuse(f"{count} registers from 0x{first:04X}: allowed up to 0x{LARGEST_ADDRESS:04X}")
    return list(range(first, first + count))


def _numbered(text: str, name: str) -> int:
    known = [*BOARD_REGISTERS, *AXIS_REGISTERS]
    try:
        value = int(text, 0)
    except ValueError:
        near = difflib.get_close_matches(name, known, 4, 0.4) or known
        raise Misuse(f"no register {text}; allowed: a number, or {', '.join(near)}"
                     f"{' …' if near is not known else ''} (axis registers as ENCODER:2)") from None
    if not 0 <= value <= LARGEST_ADDRESS:
        raise Misuse(f"register {text}: allowed 0 to 0x{LARGEST_ADDRESS:04X}")
    return value


def flags(table: Sequence[Flag], value: int) -> list[str]:
    """The texts of the meaningful bits."""
    return [text for bit, on, off in table if (text := on if value & bit else off)]


def _axes(bits: int) -> str:
    return " ".join(str(axis + 1) for axis in range(16) if bits >> axis & 1)


def status_words(value: int, hardware: str, firmware: int) -> list[str]:
    """Meaning of a status quadlet."""
    reported = [f"board {registers.board_of(value)}"]
    reported += flags(_ALWAYS, value) + flags(_STATUS.get(hardware, ()), value)
    if hardware == "QLA1":
        amplifiers = {"amplifiers on": value >> registers.STATUS_AMP_ON_SHIFT & 0xF,
                      "cut for their current": value >> registers.STATUS_SAFETY_SHIFT & 0xF,
                      "amplifiers requested": value & 0xF if firmware == 7 else 0}
        reported += [f"{text}: {_axes(bits)}" for text, bits in amplifiers.items() if bits]
    return reported


def control_words(value: int) -> str:
    """Effect of writing this to the status register; bits without their mask bit have none."""
    pairs = ((registers.CONTROL_RELAY_MASK, 1 << 16, "relay closed", "relay open"),
             (registers.CONTROL_POWER_MASK, 1 << 18, "motor power on", "motor power off"))
    reported = [on if value & bit else off for mask, bit, on, off in pairs if value & mask]
    masked = value >> registers.CONTROL_AMP_MASK_SHIFT & 0xF
    for text, bits in (("on", masked & value), ("off", masked & ~value)):
        reported += [f"amplifiers {text}: {_axes(bits)}"] if bits else []
    if value & registers.CONTROL_REBOOT == registers.CONTROL_REBOOT:
        reported.append("reboot of the FPGA")
    reported += flags(((registers.CONTROL_DOUT_TEST, "digital outputs detected again", ""),
                       (registers.CONTROL_EXPANDER_TEST, "I/O expander detected again", "")), value)
    return ", ".join(reported) or "no mask bit is set: changes nothing"


def celsius(word: int, hardware: str) -> list[float | None]:
    """Temperatures of the amplifiers by pairs, °C; None for an invalid one."""
    shifts = {"QLA1": (8, 0), "DQLA": (8, 0, 24, 16)}.get(hardware, ())
    raw = [word >> shift & 0xFF for shift in shifts]
    return [None if x == registers.TEMPERATURE_INVALID else x * registers.TEMPERATURE_C_PER_BIT for x in raw]


def counts(word: int) -> int:
    """Encoder counts, 0 at mid-range."""
    return (word & registers.ENCODER_MASK) - registers.ENCODER_ZERO


def amperes(bits: int) -> float:
    """Motor current of a QLA, A."""
    return ((bits & 0xFFFF) - registers.CURRENT_ZERO) / registers.CURRENT_BITS_PER_A


def velocities(words: Sequence[Sequence[int]], hardware: str) -> list[float]:
    """Counts/s now, as io estimates them: from the running, period, quarter 5 and quarter 1 words of every axis."""
    clock = registers.ESPM_CLOCK_HZ if hardware == "dRA1" else registers.CLOCK_HZ
    estimator = FirmwareVelocity(len(words[0]), float(clock))
    estimator.words[...] = words
    return [float(speed) for speed in np.array(estimator.update())]


def amplifier(status: int, word: int, axis: int, hardware: str, firmware: int) -> str:
    """State of an amplifier, axis from 0, from the status quadlet and its motor status word."""
    if hardware == "QLA1" and firmware == 7:
        on, asked = status >> registers.STATUS_AMP_ON_SHIFT + axis & 1, status >> axis & 1
        cut, fault = status >> registers.STATUS_SAFETY_SHIFT + axis & 1, int(asked and not on)
    else:
        on, asked = word & registers.MOTOR_STATUS_AMP_ON, word & registers.MOTOR_STATUS_AMP_REQUESTED
        cut, fault = word & registers.MOTOR_STATUS_SAFETY, word & registers.MOTOR_STATUS_AMP_FAULT
        if hardware == "dRA1":
            cut, fault = 0, word >> registers.MOTOR_STATUS_FAULT_SHIFT & 0xF
    if cut:
        return "cut (current)"
    if fault:
        return f"fault {fault}" if hardware == "dRA1" else "fault"
    return "on" if on else "requested" if asked else "off"


def limit_inputs(word: int, hardware: str, axis: int) -> str:
    """Limit and home inputs of an axis, as levels: `-`, `+`, `h` for a high pin, `.` for a low one."""
    if hardware not in ("QLA1", "DQLA") or axis >= 2 * registers.AXES:
        return ""
    word >>= registers.INPUT_FAR_SHIFT if axis >= registers.AXES else 0
    shifts = ((registers.INPUT_NEGATIVE_LIMIT_SHIFT, "-"), (registers.INPUT_POSITIVE_LIMIT_SHIFT, "+"),
              (registers.INPUT_HOME_SHIFT, "h"))
    return "".join(mark if word >> shift + axis % registers.AXES & 1 else "." for shift, mark in shifts)


def input_words(word: int, hardware: str) -> str:
    """Content of a digital input quadlet besides the axes' own inputs."""
    if hardware not in ("QLA1", "DQLA"):
        return f"bits high: {' '.join(str(bit) for bit in range(32) if word >> bit & 1) or 'none'}"
    outputs = [~word >> registers.INPUT_DOUT_SHIFT & 0xF]
    reported = []
    if hardware == "DQLA":
        outputs.append(~word >> registers.INPUT_DOUT_FAR_SHIFT & 0xF)
    else:
        reported = flags(((registers.INPUT_ENCODER_SUPPLY_FAULT, "encoder supply fault", ""),
                          (registers.INPUT_WAVEFORM_ACTIVE, "waveform table plays", "")), word)
    high = _axes(sum(bits << 4 * k for k, bits in enumerate(outputs)))
    return ", ".join([*reported, f"output pins high: {high or 'none'}"])


def _limits(word: int, board: FoundBoard) -> str:
    axes = range(blocks.AXES_OF.get(board.hardware, (4, 4))[0])
    inputs = [f"{axis + 1}:{marks}" for axis in axes if (marks := limit_inputs(word, board.hardware, axis))]
    return ", ".join(filter(None, [input_words(word, board.hardware), " ".join(inputs)]))


def _celsius(word: int, board: FoundBoard) -> str:
    return " ".join("–" if t is None else f"{t:g} °C" for t in celsius(word, board.hardware))


def watchdog_text(word: int) -> str:
    """The period in ms."""
    period = word & 0xFFFF
    return f"{period * registers.WATCHDOG_UNIT_S * 1e3:.4g} ms" if period else "off"


def _git(word: int, board: FoundBoard) -> str:
    if board.firmware < 8:
        return ""
    return f"commit {word >> 4:07x}{', changed' if word & 8 else ''}" if word else "a release"


_BOARD: Final[dict[int, Callable[[int, FoundBoard], str]]] = {
    registers.STATUS: lambda value, board: ", ".join(status_words(value, board.hardware, board.firmware)),
    registers.WATCHDOG: lambda value, board: watchdog_text(value),
    registers.HARDWARE_ID: lambda value, board: registers.hardware_name(value),
    registers.TEMPERATURE: _celsius,
    registers.DIGITAL_OUTPUT: lambda value, board: f"output pins low: {_axes(value & 0xF) or 'none'}",
    registers.FIRMWARE: lambda value, board: f"Rev {value}",
    registers.DIGITAL_INPUT: _limits,
    registers.IP_ADDRESS: lambda value, board: registers.ip_text(value),
    registers.ETHERNET: lambda value, board: f"FPGA V{registers.fpga_of(value)}",
    registers.GIT_DESCRIPTION: _git,
}


def _adc(value: int, board: FoundBoard) -> str:
    if board.hardware == "dRA1":
        return f"pot {value >> 16 & registers.DIGITAL_POT_MASK}, current {value & 0xFFFF}"
    return f"pot {(value >> 16) * registers.POT_V_PER_BIT:.4f} V, current {amperes(value):+.4f} A"


def _speed(value: int, board: FoundBoard) -> str:
    stopped = value & (registers.VELOCITY_OVERFLOW | registers.PERIOD_DIRECTION_CHANGED)
    clock = registers.ESPM_CLOCK_HZ if board.hardware == "dRA1" else registers.CLOCK_HZ
    ticks = max(1, value & registers.VELOCITY_TICKS_MASK)
    sign = 1 if value & registers.VELOCITY_DIRECTION else -1
    return "0 counts/s" if stopped else f"{sign * 4 * clock / ticks:+.1f} counts/s"


def _config(value: int, board: FoundBoard) -> str:
    delay_s = (value >> registers.MOTOR_CONFIG_DELAY_SHIFT & 0xFF) * registers.MOTOR_CONFIG_DELAY_TICKS
    reported = [f"current limit {(value & registers.MOTOR_CONFIG_LIMIT_MASK) / registers.CURRENT_BITS_PER_A:.3f} A",
                f"delay {delay_s / registers.CLOCK_HZ * 1e3:.2f} ms"]
    return ", ".join(reported + flags(((registers.MOTOR_CONFIG_NO_SAFETY_CHECK, "no current check", ""),
                                       (registers.MOTOR_CONFIG_VOLTAGE, "has voltage mode", "")), value))


_AXIS: Final[dict[int, Callable[[int, FoundBoard], str]]] = {
    registers.ADC: _adc,
    registers.DAC: lambda value, board: "" if board.hardware == "dRA1" else f"{amperes(value):+.4f} A",
    registers.ENCODER_PRELOAD: lambda value, board: f"{counts(value):+d} counts",
    registers.ENCODER: lambda value, board: (
        f"{counts(value):+d} counts"
        + (", overflow" if value & registers.ENCODER_OVERFLOW and board.hardware != "dRA1" else "")),
    registers.PERIOD: _speed,
    registers.MOTOR_CONFIG: lambda value, board: "" if board.firmware < 8 or board.hardware == "dRA1"
    else _config(value, board),
    registers.MOTOR_STATUS: lambda value, board: "" if board.firmware < 8
    else f"amplifier {amplifier(0, value, 0, board.hardware, board.firmware)}, commanded {value & 0xFFFF:#06x}",
}


def meaning(address: int, value: int, board: FoundBoard) -> str:
    """Meaning of a register's value; empty if there is none."""
    if address <= 0xF:
        found = _BOARD.get(address)
    else:
        found = _AXIS.get(address & 0xF) if address <= 0xFF else None
    return found(value, board) if found else ""


def written_meaning(address: int, value: int, board: FoundBoard) -> str:
    """Effect of writing a value, if it differs from the meaning of reading it."""
    if address == registers.STATUS:
        return control_words(value)
    return meaning(address, value, board)
