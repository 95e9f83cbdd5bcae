"""Trocar for scripts: arms and systems by name, with CRTK method names.

    import trocar

    with trocar.arm("PSM1") as psm:
        psm.home(60)
        psm.move_jp([0, 0, 0.12, 0, 0, 0]).wait()
        position, stamp_ns = psm.measured_jp()
        pose, _ = psm.measured_cp()
        pose[2, 3] -= 0.01
        psm.move_cp(pose).wait()
        psm.jaw.open().wait()

Each read returns (value, stamp): the stamp is monotonic nanoseconds. Joints are rad and m, poses 4×4 matrices, twists
and wrenches six numbers, linear then angular. Waits have timeouts in seconds. Refused commands raise `Refused`
with the reason, missing or currently invalid data `TimeoutError`, and malformed poses or numbers `ValueError`.
Ctrl-C ends a script with a one-line message instead of a traceback.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trocar.tools.client.scripting import *  # noqa: F403
    from trocar.tools.client.scripting import __all__ as __all__


def __getattr__(name: str) -> object:
    """What scripts use is loaded when they first name it, so that `import trocar.shm…` loads nothing else."""
    if name == "rl":
        return _environments()
    if name.startswith("__") and name not in ("__all__", "__version__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("trocar.tools.client.scripting"), name)


def _environments() -> object:
    """`trocar.rl`, environments for Gymnasium, which most scripts do without."""
    try:
        return importlib.import_module("trocar.procs.rl.door")
    except ModuleNotFoundError as error:
        from trocar.procs.machine.extras import missing_in

        if sentence := missing_in(error, "trocar.rl"):
            raise ModuleNotFoundError(sentence, name=error.name) from None
        raise


if "gymnasium" in sys.modules:  # so that gymnasium.make("trocar:trocar/PsmReach-v0") finds its names; else `rl` does
    importlib.import_module("trocar.procs.rl.registration")
