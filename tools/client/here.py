"""What needs the robot's own machine: its systems by name, arms by shared memory, places for programs of one's own."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TypeVar

from trocar.procs.tables.arm_types import ARM_TYPES, class_of
from trocar.procs.user.process import UserNode
from trocar.tools.client.arm import Arm
from trocar.tools.client.consoles import Operated
from trocar.tools.client.provider import Handler as Handler
from trocar.tools.client.provider import Provider as Provider
from trocar.tools.client.provider import taken
from trocar.tools.client.setup import Suj
from trocar.tools.client.system import System as System
from trocar.tools.client.system import attached, connected
from trocar.tools.inspect.watch import arm_document
from trocar.tools.systems.find import chosen_system

Process = UserNode
Q = TypeVar("Q", bound=Operated)


def arm_here(name: str, system: str | None, timeout: float) -> Arm:
    """The arm `name`, once it is connected; TimeoutError after `timeout` s."""
    return connected(lambda: attached("arm", _made, _chosen(system), name), timeout, name)


def suj_here(name: str, system: str | None, timeout: float) -> Suj:
    """The setup joints `name`; the same."""
    return connected(lambda: attached("suj", Suj, _chosen(system), name), timeout, name)


def operated_here(made: type[Q], kind: str, name: str, system: str | None, timeout: float) -> Q:
    """A console or a teleoperation; the same."""
    return connected(lambda: attached(kind, made, _chosen(system), name), timeout, name)


def provide(name: str | UserNode, system: str | None = None, timeout: float = 5.0, *, rate: float = 200.0,
            commands: Mapping[str, Handler] | None = None, program: str = "") -> Provider:
    """Be the arm `name` of a _GENERIC type, or the buttons of a console, in a running system; see Provider.

    A process that the system file declares by this name is given instead of it, in its `setup`.

    `rate`: records a second that `tick` keeps to. `commands`: what it carries out, by name. `program`: its name.
    TimeoutError after `timeout` s when there is no such place; Problem at once when another program has it.
    """
    if isinstance(name, UserNode):
        return Provider(name, commands, program)
    return connected(lambda: taken(_chosen(system), name, rate, commands, program), timeout, name)


def system_here(name: str | None = None, timeout: float = 5.0) -> System:
    """A running system, default as of `arm`; TimeoutError when there is none within `timeout` s."""
    return connected(lambda: System(_chosen(name)), timeout, name or "a system")


def _chosen(system: str | None) -> str:
    return chosen_system(system or os.environ.get("TROCAR_SYSTEM"))


def _made(system: str, name: str) -> Arm:
    return class_of(ARM_TYPES[arm_document(system, name).type].client, Arm)(system, name)
