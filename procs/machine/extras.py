"""THE TABLE of packages that only some installations have, and the sentence for one that is missing.

`pip install trocar` installs what a robot, its verbs and its recordings need; pyproject.toml lists the extras.
"""

from __future__ import annotations

import platform
import shlex
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final


@dataclass(frozen=True, slots=True)
class ExtraPackage:
    """A package that we import, the extra that installs it, and its usual purpose in words.

    `before`: the first Python without a package in PyPI; None: there is one for all. `machines`: processors with a
    package; empty: all.
    """

    module: str
    package: str
    extra: str
    purpose: str
    before: tuple[int, int] | None = None
    machines: tuple[str, ...] = ()


PACKAGES: Final = {row.module: row for row in (
    ExtraPackage("cyclonedds", "cyclonedds", "ros", "ROS", (3, 14), ("x86_64",)),
    ExtraPackage("starlette", "starlette", "gui", "the web console"),
    ExtraPackage("ruckig", "ruckig", "jerk", "a jerk limit", machines=("x86_64",)),
    ExtraPackage("foxglove", "foxglove-sdk", "foxglove", "the Foxglove server"),
    ExtraPackage("gymnasium", "gymnasium", "rl", "an environment for learning"),
    ExtraPackage("OpenGL", "PyOpenGL", "rl", "a picture of an environment"),
    ExtraPackage("ray", "ray", "ray", "a rollout on Ray"),
    ExtraPackage("matplotlib", "matplotlib", "plot", "a PNG"),
    ExtraPackage("pyarrow", "pyarrow", "parquet", "Parquet"),
    ExtraPackage("evdev", "evdev", "gamepad", "a gamepad"),
    ExtraPackage("bleak", "bleak", "bluetooth", "a board on Bluetooth"),
    ExtraPackage("iceoryx2", "iceoryx2", "bench", "the comparison with iceoryx2"),
    ExtraPackage("zmq", "pyzmq", "bench", "the comparison with ZeroMQ"),
)}


def missing(module: str, purpose: str = "") -> str:
    """What `purpose` needs, and the remedy, if this module of the table is not installed; empty if it is."""
    if _is_there(module):
        return ""
    row, machine = PACKAGES[module], platform.machine()
    needs = f"{purpose or row.purpose} needs {row.package}"
    if row.machines and machine not in row.machines:
        return f"{needs}, which has no package for {machine}: use a computer with {' or '.join(row.machines)}"
    if row.before is not None and sys.version_info >= row.before:
        major, minor = row.before
        return (f"{needs}, which has no package for Python {sys.version_info[0]}.{sys.version_info[1]}: "
                f"use python{major}.{minor - 1}")
    return f"{needs}: {shlex.quote(sys.executable)} -m pip install 'trocar[{row.extra}]'"


def missing_in(error: ModuleNotFoundError, purpose: str = "") -> str:
    """The same for the module that this error names; empty if it is not in the table."""
    name = (error.name or "").partition(".")[0]
    return missing(name, purpose) if name in PACKAGES else ""


def _is_there(module: str) -> bool:
    if sys.modules.get(module) is not None:
        return True
    try:
        return find_spec(module) is not None
    except ImportError:
        return False
