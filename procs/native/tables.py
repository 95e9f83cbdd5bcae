"""All structs of the native library, and the constants that both sides know."""

from typing import Final

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.native import pace_fields, progress
from trocar.procs.native.arm_fields import ARM
from trocar.procs.native.boards_fields import BOARDS
from trocar.procs.native.bus_fields import HUB, WRITE
from trocar.procs.native.exchange_fields import EXCHANGE, NOTHING, UNREADABLE
from trocar.procs.native.fields import CStruct
from trocar.procs.native.governor_fields import GOVERNOR
from trocar.procs.native.io_fields import IO
from trocar.procs.native.pace_fields import PACE
from trocar.procs.native.track_fields import TRACK

STRUCTS: Final[tuple[CStruct, ...]] = (IO, TRACK, HUB, WRITE, EXCHANGE, *BOARDS, *ARM, GOVERNOR, PACE)

CONSTANTS: Final = {
    "BAD": progress.BAD,
    "BLOCK_RESPONSE": wire.BLOCK_RESPONSE,
    "CHECKED": progress.CHECKED,
    "CONTROLLED": progress.CONTROLLED,
    "CONTROL_AMP_MASK_SHIFT": registers.CONTROL_AMP_MASK_SHIFT,
    "CONTROL_AMP_SHIFT": registers.CONTROL_AMP_SHIFT,
    "CURRENT_EXCESS": registers.CURRENT_EXCESS,
    "DAC_BOARD_SHIFT": registers.DAC_BOARD_SHIFT,
    "DAC_KEPT": registers.DAC_VALID | registers.DAC_COLLECT | registers.DAC_VALUE_MASK,
    "DECODED": progress.DECODED,
    "DIRECTION": registers.VELOCITY_DIRECTION,
    "ENCODED": progress.ENCODED,
    "HOST_ID": wire.HOST_ID,
    "INPUTS_AT": blocks.DIGITAL_INPUT,
    "INPUT_MOTOR_SUPPLY": registers.INPUT_MOTOR_SUPPLY,
    "KINDS": blocks.KINDS,
    "MIDDLE": 0.5 * registers.DAC_VALUE_MASK,
    "MIDRANGE": registers.ENCODER_MIDRANGE,
    "MIN_QUARTER": registers.MIN_QUARTER,
    "NONE": progress.NONE,
    "NOTHING": NOTHING,
    "OVERFLOWED": registers.VELOCITY_OVERFLOW,
    "POSITION_MASK": registers.ENCODER_MASK,
    "QUERY": registers.QUERY,
    "READY": progress.READY,
    "RELAY": registers.STATUS_RELAY,
    "SAME_EDGE": registers.SAME_EDGE,
    "SCALARS": blocks.SCALARS,
    "SENT": progress.SENT,
    "SLOWEST_S": registers.SLOWEST_S,
    "SLOWEST_SQUARE": 1e-30,
    "STAMP_AT": blocks.TIMESTAMP,
    "STATUS_AT": blocks.STATUS,
    "TICKS": registers.VELOCITY_TICKS_MASK,
    "UNREADABLE": UNREADABLE,
    "VALUE_MASK": registers.DAC_VALUE_MASK,
    **{f"WORD_{name}": getattr(pace_fields, name) for name in
       ("DEADLINE", "START", "WANTED", "STEP", "CYCLES", "MISSED", "OVERRUNS", "KEPT", "LOOK")},
}
