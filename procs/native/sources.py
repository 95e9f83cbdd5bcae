"""Sources of the native library: its C files, the structs of all tables, and a hash of all."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Final

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.native import arm_fields, bus_fields, follow_fields, io_fields, pace_fields
from trocar.procs.native.arm_fields import ARM
from trocar.procs.native.boards_fields import BOARDS
from trocar.procs.native.bus_fields import EXCHANGE, HUB, WRITE
from trocar.procs.native.fields import CStruct
from trocar.procs.native.follow_fields import FOLLOW
from trocar.procs.native.io_fields import IO, KINEMATIC, TRACK
from trocar.procs.native.pace_fields import PACE
from trocar.procs.native.walls_fields import MOVED, WALLS
from trocar.shm.mailbox import mailbox_map, received

STRUCTS: Final[tuple[CStruct, ...]] = (IO, KINEMATIC, TRACK, HUB, WRITE, EXCHANGE, *BOARDS, *ARM, WALLS, MOVED,
                                        FOLLOW, PACE)


def _named(module: ModuleType, names: str, prefix: str = "") -> dict[str, int | float]:
    return {prefix + name: getattr(module, name) for name in names.split()}


CONSTANTS: Final = {
    **_named(io_fields, "MISSED STATUS LIMIT TRACKING NOT_FINITE CONTROLLED SENT"),
    **_named(arm_fields, "FRESH POWER VALID CHANGED FAULTY"),
    **_named(bus_fields, "NOTHING UNREADABLE"),
    **_named(wire, "BLOCK_RESPONSE HOST_ID"),
    **_named(blocks, "KINDS SCALARS"),
    **_named(registers, "CONTROL_AMP_MASK_SHIFT CONTROL_AMP_SHIFT CURRENT_EXCESS DAC_BOARD_SHIFT INPUT_MOTOR_SUPPLY "
                        "MIN_QUARTER QUERY SAME_EDGE SLOWEST_S"),
    **_named(pace_fields, "DEADLINE START WANTED STEP CYCLES MISSED OVERRUNS KEPT LOOK", "WORD_"),
    **_named(follow_fields, "COUNT KNOWN ANSWERED LAST STAMP SEEN ROTATION_LOCKED TRANSLATION_LOCKED LINEAR ANGULAR "
                            "CARRIED JAWS HAS_GRIPPER CATCHING_UP DONE_TO", "FOLLOW_"),
    **_named(follow_fields, "ROOM_M ROOM_RAD SCALE FACTOR OFFSET LOWER BEGUN GHOST RATE SLOW_RATE", "NUMBER_"),
    **_named(follow_fields, "GOALS"),
    **_named(mailbox_map, "COMMANDS_DEPTH REPLIES_DEPTH REPLY_START VALUES_IN_RAW"),
    "DAC_KEPT": registers.DAC_VALID | registers.DAC_COLLECT | registers.DAC_VALUE_MASK,
    "DONE": received.DONE,
    "DIRECTION": registers.VELOCITY_DIRECTION,
    "INPUTS_AT": blocks.DIGITAL_INPUT,
    "MIDDLE": 0.5 * registers.DAC_VALUE_MASK,
    "MIDRANGE": registers.ENCODER_MIDRANGE,
    "OVERFLOWED": registers.VELOCITY_OVERFLOW,
    "POSITION_MASK": registers.ENCODER_MASK,
    "RELAY": registers.STATUS_RELAY,
    "SLOWEST_SQUARE": 1e-30,
    "STAMP_AT": blocks.TIMESTAMP,
    "STATUS_AT": blocks.STATUS,
    "TICKS": registers.VELOCITY_TICKS_MASK,
    "VALUE_MASK": registers.DAC_VALUE_MASK,
}
"""Constants shared by C and Python."""

FOLDER: Final = Path(__file__).parent
FLAGS: Final = ("-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-Wall", "-Wextra")
IN_WHEELS: Final = FOLDER / "native.so"


def header() -> str:
    """fields.h: the constants, the structs of all tables, and their sizes."""
    sizes = ", ".join(f"sizeof({table.name})" for table in STRUCTS)
    constants = "".join(f"#define {name} {value!r}\n" for name, value in CONSTANTS.items())
    parts = ["#pragma once\n#include <stdint.h>\n", constants, *(table.declarations for table in STRUCTS),
             f"#define NATIVE_SIZES {sizes}\n"]
    return "\n".join(parts)


def files() -> list[Path]:
    """The compiled files and those they include."""
    return sorted(path for path in FOLDER.iterdir() if path.suffix in (".c", ".h"))


def source_hash() -> int:
    """Hash of everything that determines the library except the compiler: 63 bits, not 0."""
    parts = [header().encode(), " ".join(FLAGS).encode()]
    parts += [part for path in files() for part in (path.name.encode(), path.read_bytes())]
    return int.from_bytes(hashlib.sha256(b"\0".join(parts)).digest()[:8], "little") >> 1 | 1


def library_path() -> Path:
    """File of the library of this source in the Python environment, once it is built."""
    return Path(sys.prefix) / "lib" / "trocar" / f"native-{source_hash():016x}.so"
