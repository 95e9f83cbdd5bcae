"""Registers of the FPGA1394 + QLA controllers: addresses, bits, units (firmware Rev 7, 8, 9).

Numbers only, and the one-line functions that read a field out of a quadlet. Quadlets are plain ints here; the same
shifts and masks work on uint32 arrays.
"""

from __future__ import annotations

import ipaddress
import math
from typing import Final

AXES: Final = 4  # of a QLA1
OWN_ADDRESS: Final = 9  # from this firmware on a board adds its id to the address assigned to it

# -- clock and units ---------------------------------------------------------------------------------------------------
CLOCK_HZ: Final = 49_152_000
TICK_S: Final = 1.0 / CLOCK_HZ
ESPM_CLOCK_HZ: Final = 80_000_000  # of encoder periods measured in an Si arm (dRA1)
WATCHDOG_TICKS: Final = 256  # one count of the watchdog period
WATCHDOG_UNIT_S: Final = WATCHDOG_TICKS / CLOCK_HZ
WATCHDOG_POWER_UP: Final = 0x1680  # 30 ms
CURRENT_BITS_PER_A: Final = 65536 / 12.5  # commanded and measured alike
CURRENT_ZERO: Final = 0x8000
CURRENT_EXCESS: Final = 0x0900  # by which a measured current may exceed the commanded one
POT_V_PER_BIT: Final = 4.5 / 65536
DIGITAL_POT_MASK: Final = 0xFFF  # of a dRA1: 12 bits
TEMPERATURE_C_PER_BIT: Final = 0.5
TEMPERATURE_INVALID: Final = 0xFF

# -- regions of the address space --------------------------------------------------------------------------------------
REAL_TIME: Final = 0x0000  # block transfers at 0 are the real-time blocks
HUB: Final = 0x1000
QUERY: Final = 0x1800  # sequence << 16 | board mask
FPGA_PROM: Final = 0x2000
QLA_PROM_COMMAND: Final = 0x3000
QLA_PROM_STATUS: Final = 0x3001
QLA_PROM_RESULT: Final = 0x3002
QLA_PROM_BUFFER: Final = 0x3100
DALLAS_MEMORY: Final = 0x6000
DATA_BUFFER: Final = 0x7000
DATA_BUFFER_STATUS: Final = 0x7800
WAVEFORM: Final = 0x8000

# -- board registers (channel 0) ---------------------------------------------------------------------------------------
STATUS: Final = 0x00  # written: control
PHY_REQUEST: Final = 0x01
PHY_RESPONSE: Final = 0x02
WATCHDOG: Final = 0x03
HARDWARE_ID: Final = 0x04
TEMPERATURE: Final = 0x05
DIGITAL_OUTPUT: Final = 0x06
FIRMWARE: Final = 0x07
PROM_COMMAND: Final = 0x08
PROM_RESULT: Final = 0x09
DIGITAL_INPUT: Final = 0x0A
IP_ADDRESS: Final = 0x0B
ETHERNET: Final = 0x0C
DALLAS: Final = 0x0D
IO_EXPANDER: Final = 0x0E
GIT_DESCRIPTION: Final = 0x0F

# -- registers of the electronics in an Si arm, behind a dRA1 ----------------------------------------------------------
ARM_FLASH_COMMAND: Final = 0xA002
ARM_FLASH_WORD: Final = 0xA031
ARM_FLASH_READ: Final = 1 << 24
ARM_FLASH_ENABLE: Final = 1 << 28

# -- axis registers: axis_register(axis, offset) -----------------------------------------------------------------------
ADC: Final = 0x0  # 31:16 potentiometer, 15:0 motor current
DAC: Final = 0x1
ENCODER_PRELOAD: Final = 0x4
ENCODER: Final = 0x5
PERIOD: Final = 0x6
QUARTER_1: Final = 0x7
PWM: Final = 0x8
QUARTER_5: Final = 0x9
RUNNING: Final = 0xA
MOTOR_CONFIG: Final = 0xB
MOTOR_STATUS: Final = 0xC

# -- hardware and firmware ---------------------------------------------------------------------------------------------
QLA1: Final = 0x514C4131
DQLA: Final = 0x44514C41
DRA1: Final = 0x64524131
HARDWARE_IDS: Final = {QLA1: "QLA1", DQLA: "DQLA", DRA1: "dRA1", 0x42434647: "BCFG", 0x54455354: "TEST"}

# -- status register, read ---------------------------------------------------------------------------------------------
STATUS_AXES_SHIFT: Final = 28
STATUS_BOARD_SHIFT: Final = 24
STATUS_WATCHDOG: Final = 1 << 23
STATUS_QUAD_DAC: Final = 1 << 22  # Rev 8 on
STATUS_DOUT_CONFIGURED: Final = 1 << 21
STATUS_DOUT_BIDIRECTIONAL: Final = 1 << 20
STATUS_MV_GOOD: Final = 1 << 19
STATUS_POWER: Final = 1 << 18
STATUS_RELAY_FEEDBACK: Final = 1 << 17
STATUS_RELAY: Final = 1 << 16
STATUS_MV_FAULT: Final = 1 << 15
STATUS_SAFETY_VOLTAGE: Final = 1 << 14  # Rev 8 on, QLA >= 1.5
STATUS_IO_EXPANDER: Final = 1 << 12  # Rev 8 on, QLA >= 1.5
STATUS_AMP_ON_SHIFT: Final = 8  # one bit an axis: the amplifier is really on
STATUS_SAFETY_SHIFT: Final = 4  # one bit an axis: cut because measured and commanded current differed
# of a DQLA: a bit for each of its QLAs, the second one's above the first one's
STATUS_DQLA_QUAD_DAC: Final = 1 << 21
STATUS_DQLA_MV_GOOD: Final = 1 << 14
STATUS_DQLA_CONFIGURED: Final = 1 << 12  # the DQLA's own I/O expanders
STATUS_DQLA_DOUT_CONFIGURED: Final = 1 << 10
STATUS_DQLA_DOUT_BIDIRECTIONAL: Final = 1 << 8
STATUS_DQLA_SAFETY_VOLTAGE: Final = 1 << 6
STATUS_DQLA_MOTOR_SUPPLY: Final = 1 << 4  # comparator
STATUS_DQLA_WAVEFORM_ACTIVE: Final = 1 << 3
STATUS_DQLA_EXPANDER: Final = 1 << 0
# of a dRA1
STATUS_ECM: Final = 1 << 22
STATUS_PRELOADED: Final = 1 << 3  # encoders were preloaded since the start of the ESPM
STATUS_ESPM_SUPPLY: Final = 1 << 2
STATUS_ESPM_REACHES_ARM: Final = 1 << 1
STATUS_ESPM: Final = 1 << 0

# -- control (status register, written): a value bit counts only with its mask bit -------------------------------------
CONTROL_AMP_SHIFT: Final = 0
CONTROL_AMP_MASK_SHIFT: Final = 8
CONTROL_RELAY_ON: Final = 0x0003_0000
CONTROL_RELAY_OFF: Final = 0x0002_0000
CONTROL_POWER_ON: Final = 0x000C_0000
CONTROL_POWER_OFF: Final = 0x0008_0000
CONTROL_AMPS_ON: Final = 0x0000_0F0F
CONTROL_AMPS_OFF: Final = 0x0000_0F00
CONTROL_REBOOT: Final = 0x0030_0000
CONTROL_RELAY_MASK: Final = 1 << 17
CONTROL_POWER_MASK: Final = 1 << 19
CONTROL_DOUT_TEST: Final = 1 << 24  # determine the hardware of the digital outputs again
CONTROL_EXPANDER_TEST: Final = 1 << 23  # Rev 8 on: whether there is an I/O expander
CONTROL_REAL_TIME_BITS: Final = 0x000F_FFFF  # Rev 7 and 8 use only these from a real-time block

# -- digital inputs (register 0x0A and quad 2 of a real-time block); nibbles hold axis 1 in their lowest bit -----------
INPUT_ENCODER_SUPPLY_FAULT: Final = 1 << 31
INPUT_WAVEFORM_ACTIVE: Final = 1 << 29
INPUT_MOTOR_SUPPLY: Final = 1 << 28  # Rev 8 on, QLA >= 1.5
INPUT_ENCODER_A_SHIFT: Final = 24
INPUT_ENCODER_B_SHIFT: Final = 20
INPUT_ENCODER_INDEX_SHIFT: Final = 16
INPUT_DOUT_SHIFT: Final = 12  # register polarity: 1 is a low pin
INPUT_FAR_SHIFT: Final = 16  # limits and home of the second QLA of a DQLA are in 27:16
INPUT_DOUT_FAR_SHIFT: Final = 28
INPUT_NEGATIVE_LIMIT_SHIFT: Final = 8
INPUT_POSITIVE_LIMIT_SHIFT: Final = 4
INPUT_HOME_SHIFT: Final = 0

# -- motor command (DAC) word ------------------------------------------------------------------------------------------
DAC_VALID: Final = 1 << 31
DAC_COLLECT: Final = 1 << 30
DAC_AMP_MASK: Final = 1 << 29  # Rev 8 on
DAC_AMP_ENABLE: Final = 1 << 28  # Rev 8 on
DAC_BOARD_SHIFT: Final = 24  # Rev 7 block write: board id
DAC_VALUE_MASK: Final = 0xFFFF
DAC_READ_REV_7: Final = 0x0030_0000  # in a value read back, after one was written
MODE_CURRENT: Final = 0
MODE_VOLTAGE: Final = 1

# -- motor configuration and status (Rev 8 on) -------------------------------------------------------------------------
MOTOR_CONFIG_POWER_UP: Final = 0x0178_0418
MOTOR_CONFIG_NO_SAFETY_CHECK: Final = 1 << 31
MOTOR_CONFIG_FOLLOWER_ON: Final = 1 << 30  # the follower amplifier is never disabled
MOTOR_CONFIG_VOLTAGE: Final = 1 << 25  # read: there is a voltage mode; written: set the delay
MOTOR_CONFIG_CURRENT: Final = 1 << 24  # read: always; written: set the current limit
MOTOR_CONFIG_DELAY_SHIFT: Final = 16  # eight bits of MOTOR_CONFIG_DELAY_TICKS each
MOTOR_CONFIG_DELAY_TICKS: Final = 1024
MOTOR_CONFIG_LIMIT_MASK: Final = 0x7FFF
MOTOR_STATUS_AMP_ON_SHIFT: Final = 29
MOTOR_STATUS_AMP_ON: Final = 1 << MOTOR_STATUS_AMP_ON_SHIFT
MOTOR_STATUS_AMP_REQUESTED: Final = 1 << 28
MOTOR_STATUS_MODE_SHIFT: Final = 24
MOTOR_STATUS_CURRENT_CONTROL: Final = 1 << 20
MOTOR_STATUS_SAFETY_SHIFT: Final = 17
MOTOR_STATUS_SAFETY: Final = 1 << MOTOR_STATUS_SAFETY_SHIFT
MOTOR_STATUS_AMP_FAULT: Final = 1 << 16
MOTOR_STATUS_FAULT_SHIFT: Final = 16  # dRA1: a code of four bits

# -- encoder -----------------------------------------------------------------------------------------------------------
ENCODER_ZERO: Final = 0x80_0000
ENCODER_MASK: Final = 0xFF_FFFF
ENCODER_MIDRANGE: Final = 0x80_0000
ENCODER_OVERFLOW: Final = 1 << 24
ENCODER_PIN_A: Final = 1 << 28  # pin levels: Rev 8 on
ENCODER_PIN_B: Final = 1 << 29
ENCODER_PIN_INDEX: Final = 1 << 30

# -- velocity words ----------------------------------------------------------------------------------------------------
VELOCITY_OVERFLOW: Final = 1 << 31
VELOCITY_DIRECTION: Final = 1 << 30  # 1: A leads B, counting up
VELOCITY_TICKS_MASK: Final = 0x3FF_FFFF
PERIOD_DIRECTION_CHANGED: Final = 1 << 29
PERIOD_EDGE_ERROR: Final = 1 << 28
PERIOD_PARTIAL: Final = 1 << 27
QUARTER_EDGE_SHIFT: Final = 26  # four bits: A up, B up, A down, B down
SAME_EDGE: Final = VELOCITY_DIRECTION | 0xF << QUARTER_EDGE_SHIFT  # bits that make two of them comparable
SLOWEST_S: Final = 1.0  # after this time without a count, the velocity from counts is zero
MIN_QUARTER: Final = 2000.0  # ticks of the newest quarter period; with fewer, time is too coarse for accelerations
EDGE_A_UP: Final = 8
EDGE_B_UP: Final = 4
EDGE_A_DOWN: Final = 2
EDGE_B_DOWN: Final = 1
PERIOD_POWER_UP: Final = 0xCBFF_FFFF
QUARTER_POWER_UP: Final = 0x43FF_FFFF
RUNNING_POWER_UP: Final = 0x83FF_FFFF

# -- FireWire bus ------------------------------------------------------------------------------------------------------
PHY_WRITE: Final = 1 << 12
PHY_REGISTER_SHIFT: Final = 8
GAP_DEFAULT: Final = 63
# Smallest safe gap count for a bus of as many nodes as the index (IEEE 1394a).
GAP_COUNTS: Final = (63, 5, 7, 8, 10, 13, 16, 18, 21, 24, 26, 29, 32, 35, 37, 40, 43)


def axis_register(axis: int, offset: int) -> int:
    """Address of a register of axis 0-3 (the wire counts channels from 1)."""
    return (axis + 1) << 4 | offset


def board_of(status: int) -> int:
    """Board id (rotary switch, 0-15) in a status quadlet."""
    return status >> STATUS_BOARD_SHIFT & 0xF


def axes_of(status: int) -> int:
    """Number of axes in a status quadlet; 4 on a QLA1."""
    return status >> STATUS_AXES_SHIFT & 0xF


def fpga_of(ethernet_status: int) -> int:
    """FPGA board generation 1, 2 or 3 from the Ethernet status register."""
    if ethernet_status >> 31:
        return 2
    return 3 if ethernet_status >> 30 else 1


def hardware_name(hardware_id: int) -> str:
    """Name of a hardware id; an unknown one as hexadecimal."""
    return HARDWARE_IDS.get(hardware_id, f"0x{hardware_id:08X}")


def watchdog_counts(seconds: float) -> int:
    """Watchdog period register for a time in s: rounded down, at least one count; 0 s switches the watchdog off.

    Raises ValueError if the 16-bit register cannot hold it (341 ms and more) or the time is not a number.
    """
    if not 0.0 <= seconds < 0x10000 * WATCHDOG_UNIT_S:
        raise ValueError(f"watchdog of {seconds} s; allowed: 0 (off) to {0xFFFF * WATCHDOG_UNIT_S:.3f} s")
    if seconds == 0.0:
        return 0
    # Half a millionth of a count: 30 ms is a whole number of counts and must not lose one to rounding.
    return max(1, math.floor(seconds / WATCHDOG_UNIT_S + 5e-7))


def ip_quadlet(address: str) -> int:
    """Value of the IP address register: the last octet is the most significant byte."""
    return int.from_bytes(ipaddress.IPv4Address(address).packed, "little")


def ip_text(quadlet: int) -> str:
    """Dotted text of an IP address register value."""
    return str(ipaddress.IPv4Address(quadlet.to_bytes(4, "little")))


def arm_memory(robot: str, serial: str) -> str:
    """Identification in the memory of an Si arm: robot PSM1 with serial number 123456 is p123456.cal."""
    return f"{robot[:1].lower()}{serial}.cal"


def gap_count(nodes: int) -> int:
    """Gap count for a FireWire bus of `nodes` nodes; the safe 63 beyond the table."""
    return GAP_COUNTS[nodes] if 0 <= nodes < len(GAP_COUNTS) else GAP_DEFAULT
