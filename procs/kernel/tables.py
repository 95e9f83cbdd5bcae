"""All structs of the kernel, and the constants that both sides know."""

from typing import Final

from procs.fpga import conversion, registers, velocity
from procs.kernel.fields import CStruct
from procs.kernel.io_fields import IO
from procs.kernel.track_fields import TRACK

STRUCTS: Final[tuple[CStruct, ...]] = (IO, TRACK)

CONSTANTS: Final = {
    "ACCELERATION_THRESHOLD": velocity.ACCELERATION_THRESHOLD,
    "DIRECTION": registers.VELOCITY_DIRECTION,
    "MIDRANGE": conversion.ENCODER_MIDRANGE,
    "OVERFLOWED": registers.VELOCITY_OVERFLOW,
    "RELAY": registers.STATUS_RELAY,
    "SAME_EDGE": velocity.SAME_EDGE,
    "SLOWEST_S": velocity.SLOWEST_S,
    "TICKS": registers.VELOCITY_TICKS_MASK,
}
