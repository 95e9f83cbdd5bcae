"""What the native library is made of: its C files, the structs of all tables, and a hash of it all."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import Final

from trocar.procs.native.tables import CONSTANTS, STRUCTS

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
    """What is compiled, and what it includes."""
    return sorted(path for path in FOLDER.iterdir() if path.suffix in (".c", ".h"))


def source_hash() -> int:
    """Of all that makes the library what it is but for the compiler: 63 bits, not 0."""
    parts = [header().encode(), " ".join(FLAGS).encode()]
    parts += [part for path in files() for part in (path.name.encode(), path.read_bytes())]
    return int.from_bytes(hashlib.sha256(b"\0".join(parts)).digest()[:8], "little") >> 1 | 1


def library_path() -> Path:
    """Where the library of this source is, once it is made: in the Python environment."""
    return Path(sys.prefix) / "lib" / "trocar" / f"native-{source_hash():016x}.so"
