"""All structs of the kernel, and the constants that both sides know."""

from typing import Final

from procs.fpga import conversion, registers, velocity
from procs.kernel.arm_fields import ARM
from procs.kernel.boards_fields import BOARDS
from procs.kernel.fields import CStruct
from procs.kernel.io_fields import IO
from procs.kernel.track_fields import TRACK

STRUCTS: Final[tuple[CStruct, ...]] = (IO, TRACK, *BOARDS, *ARM)

CONSTANTS: Final = {
    "ACCELERATION_THRESHOLD": velocity.ACCELERATION_THRESHOLD,
    "DIRECTION": registers.VELOCITY_DIRECTION,
    "MIDRANGE": conversion.ENCODER_MIDRANGE,
    "OVERFLOWED": registers.VELOCITY_OVERFLOW,
    "POSITION_MASK": registers.ENCODER_MASK,
    "RELAY": registers.STATUS_RELAY,
    "SAME_EDGE": velocity.SAME_EDGE,
    "SLOWEST_S": velocity.SLOWEST_S,
    "SLOWEST_SQUARE": 1e-30,
    "TICKS": registers.VELOCITY_TICKS_MASK,
}
