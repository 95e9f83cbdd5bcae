"""Clocks of processes under test that jump: a preloaded library (shifted_clocks.c); the machine's stay as they are."""

from __future__ import annotations

import os
import struct
import subprocess
from pathlib import Path


class ShiftedClocks:
    """The clocks of all processes that begin with `environment`."""

    def __init__(self, folder: Path) -> None:
        self._file, library = folder / "clocks", folder / "clocks.so"
        self.jump()
        subprocess.run([os.environ.get("CC", "cc"), "-O2", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-o",
                        library, Path(__file__).with_suffix(".c"), "-ldl", "-pthread"], check=True)
        self.environment = {"LD_PRELOAD": str(library), "SHIFTED_CLOCKS": str(self._file)}

    def jump(self, boottime_s: float = 0.0, local_s: float = 0.0) -> None:
        """From now on they are that much ahead of the machine's."""
        with self._file.open("r+b" if self._file.exists() else "wb") as file:
            file.write(struct.pack("<qq", round(boottime_s * 1e9), round(local_s * 1e9)))
