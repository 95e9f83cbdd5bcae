"""Trocar for scripts: arms and systems by name, with CRTK's words.

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
and wrenches six numbers, linear then angular. Waits have timeouts in seconds. What the robot refuses raises `Refused`
with its reason; what cannot be had, or is not valid now, `TimeoutError`; what is no pose or no number, `ValueError`.
A script that is ended with Ctrl-C says so in one line, without a traceback.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType, TracebackType

from tools.client.scripting import *  # noqa: F403
from tools.client.scripting import __all__ as __all__


def _ended(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What nobody caught: Ctrl-C in one line, everything else as before."""
    if issubclass(kind, KeyboardInterrupt):
        sys.stderr.write("ended by Ctrl-C\n")
    else:
        _usual(kind, error, trace)


_usual, sys.excepthook = sys.excepthook, _ended


def __getattr__(name: str) -> ModuleType:
    """`trocar.rl`, environments for Gymnasium: loaded when it is asked for, as most scripts do without."""
    if name != "rl":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return importlib.import_module("procs.rl.door")
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        raise ModuleNotFoundError("trocar.rl needs gymnasium: pip install 'trocar[rl]'", name=error.name) from None


if "gymnasium" in sys.modules:  # so that gymnasium.make("trocar:trocar/PsmReach-v0") finds its names; else `rl` does
    importlib.import_module("procs.rl.registration")
