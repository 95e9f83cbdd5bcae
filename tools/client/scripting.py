"""What `import trocar` gives scripts: arms, setup joints and systems by name, and places for programs of one's own."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TypeVar

from procs.arm_types import ARM_TYPES, class_of
from procs.user_process import OwnProcess as Process
from tools.client.arm import Arm
from tools.client.impedance import Gains, Impedance
from tools.client.joints import Joints
from tools.client.kinds import Ecm, Gripper, Jaw, Mtm, Psm
from tools.client.moves import MoveHandle
from tools.client.provider import Handler, Provider, taken
from tools.client.record import JointState
from tools.client.setup import SetupArm, Suj
from tools.client.system import System, attached, connected
from tools.errors import Clipped, Problem, Refused
from tools.inspect.watch import arm_document
from tools.systems import chosen_system
from tools.version import VERSION as __version__

__all__ = [
    "Arm",
    "Clipped",
    "Ecm",
    "Gains",
    "Gripper",
    "Handler",
    "Impedance",
    "Jaw",
    "JointState",
    "Joints",
    "MoveHandle",
    "Mtm",
    "Problem",
    "Process",
    "Provider",
    "Psm",
    "Refused",
    "SetupArm",
    "Suj",
    "System",
    "__version__",
    "arm",
    "ecm",
    "mtm",
    "provide",
    "psm",
    "suj",
    "system",
]

A = TypeVar("A", bound=Arm)


def arm(name: str, system: str | None = None, timeout: float = 5.0) -> Arm:
    """The arm `name`, a Psm, Ecm or Mtm, once it is connected; TimeoutError after `timeout` s.

    `system`: default the one of the environment variable TROCAR_SYSTEM, else the only one up.
    """
    return connected(lambda: attached("arm", _made, _chosen(system), name), timeout, name)


def psm(name: str, system: str | None = None, timeout: float = 5.0) -> Psm:
    """The same; Problem when it is no PSM."""
    return _of(Psm, arm(name, system, timeout))


def ecm(name: str = "ECM", system: str | None = None, timeout: float = 5.0) -> Ecm:
    """The same; Problem when it is no ECM."""
    return _of(Ecm, arm(name, system, timeout))


def mtm(name: str, system: str | None = None, timeout: float = 5.0) -> Mtm:
    """The same; Problem when it is no MTM."""
    return _of(Mtm, arm(name, system, timeout))


def suj(name: str = "SUJ", system: str | None = None, timeout: float = 5.0) -> Suj:
    """The setup joints `name`, once they are connected; TimeoutError after `timeout` s."""
    return connected(lambda: attached("suj", Suj, _chosen(system), name), timeout, name)


def provide(name: str | Process, system: str | None = None, timeout: float = 5.0, *, rate: float = 200.0,
            commands: Mapping[str, Handler] | None = None, program: str = "") -> Provider:
    """Be the arm `name` of a _GENERIC type, or the buttons of a console, in a running system; see Provider.

    A process that the system file declares by this name is given instead of it, in its `setup`.

    `rate`: records a second that `tick` keeps to. `commands`: what it carries out, by name. `program`: its name.
    TimeoutError after `timeout` s when there is no such place or another program has it.
    """
    if isinstance(name, Process):
        return Provider(name, commands, program)
    return connected(lambda: taken(_chosen(system), name, rate, commands, program), timeout, name)


def system(name: str | None = None, timeout: float = 5.0) -> System:
    """A running system, default as of `arm`; TimeoutError when there is none within `timeout` s."""
    return connected(lambda: System(_chosen(name)), timeout, name or "a system")


def _chosen(system: str | None) -> str:
    return chosen_system(system or os.environ.get("TROCAR_SYSTEM"))


def _made(system: str, name: str) -> Arm:
    return class_of(ARM_TYPES[arm_document(system, name).type].client, Arm)(system, name)


def _of(kind: type[A], found: Arm) -> A:
    if isinstance(found, kind):
        return found
    found.close()
    raise Problem(f"{found.name} is no {kind.__name__.upper()}, it is a {type(found).__name__.upper()}")
