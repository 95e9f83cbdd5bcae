"""What hatch does beside packing when it makes a wheel: the compiled kernel goes into it, where there is a compiler."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelHook(BuildHookInterface[Any]):
    """Editable installations have theirs in the Python environment: tools/venv.sh."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and name the wheel after this platform; without a compiler it is for all."""
        if version != "standard":
            return
        sys.path.insert(0, self.root)
        from procs.kernel.build import BuildError, build
        from procs.kernel.sources import IN_WHEELS

        made = Path(self.directory) / IN_WHEELS.name
        try:
            build(made)
        except (BuildError, OSError) as error:
            self.app.display_warning(f"without the compiled kernel: {error}")
            return
        build_data["infer_tag"] = True
        build_data["pure_python"] = False
        build_data["force_include"][str(made)] = str(IN_WHEELS.relative_to(self.root))
