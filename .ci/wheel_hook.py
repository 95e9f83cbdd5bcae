"""What hatch does beside packing when it makes a wheel: the native library goes into it, where there is a compiler."""

from __future__ import annotations

import importlib
import platform
import re
import sys
from pathlib import Path
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PROCESSORS: Final = {62: "x86_64", 183: "aarch64"}  # e_machine of ELF; CC may be a cross compiler


class NativeHook(BuildHookInterface[Any]):
    """Editable installations have theirs in the Python environment: tools/venv.sh."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and name the wheel after the C library that it needs; without a compiler it is for all platforms."""
        if version != "standard":
            return
        sys.path.insert(0, self.root)
        package = importlib.import_module("trocar")
        package.__path__.append(self.root)  # a source distribution has the folders, and no links to them
        native = importlib.import_module("trocar.procs.native.build")
        made = Path(self.directory) / importlib.import_module("trocar.procs.native.sources").IN_WHEELS.name
        try:
            native.build(made)
        except (native.BuildError, OSError) as error:
            self.app.display_warning(f"without the native library: {error}")
            return
        build_data["tag"] = f"py3-none-{platform_tag(made)}"
        build_data["pure_python"] = False
        build_data["force_include"][str(made)] = f"trocar/procs/native/{made.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what has been compiled: it is in the wheel."""
        for made in build_data["force_include"]:
            Path(made).unlink()


def platform_tag(library: Path) -> str:
    """As PEP 600 has it: any Linux on this processor whose glibc has the newest symbol that the library asks for."""
    elf = library.read_bytes()
    found = [(int(major), int(minor)) for major, minor in re.findall(rb"GLIBC_(\d+)\.(\d+)", elf)]
    major, minor = max(found)
    processor = PROCESSORS.get(int.from_bytes(elf[18:20], "little"), platform.machine())
    return f"manylinux_{major}_{max(minor, 17)}_{processor}"
