"""Contents of `import trocar` for scripts: arms, setup joints and systems by name, and places for user programs.

On a machine without our shared memory (Windows, macOS) it has only arms and setup joints `at` another machine.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, overload

from trocar.procs.crtk.names import none_such
from trocar.procs.machine.end_signals import ctrl_c_in_a_line
from trocar.procs.machine.version import VERSION as __version__
from trocar.procs.tables.arm_types import ARM_TYPES, class_of
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.arm import Arm
from trocar.tools.client.connection import BridgeConnection
from trocar.tools.client.consoles import ConsoleHandle, TeleopHandle
from trocar.tools.client.distant import DistantWays
from trocar.tools.client.instance import InstanceHandle
from trocar.tools.client.kinds import Ecm, Gripper, Jaw, Mtm, Psm, SetupArm, Suj
from trocar.tools.client.moves import MoveHandle
from trocar.tools.client.parts import Joints
from trocar.tools.client.values import Gains, Impedance, JointState
from trocar.tools.client.ways import Ways
from trocar.tools.client.whole import DistantSystem
from trocar.tools.output.errors import Clipped, Disconnected, NotThere, Problem, Refused


class OnlyHere:
    """Placeholder for functions that need the robot's own machine; their use raises Problem."""

    def __init__(self, *given: Any, **named: Any) -> None:
        """Problem names the alternative."""
        raise Problem('this needs the robot\'s own machine (Linux); from here: '
                      'trocar.arm(NAME, at="HOST:PORT")')


if TYPE_CHECKING:
    import ssl

    from trocar.tools.client.aio import Aio
    from trocar.tools.client.provider import Handler, Process, Provider, provide

if TYPE_CHECKING or sys.platform == "linux":
    from trocar.tools.client.here import System, found_here, system_here
else:
    System = found_here = system_here = OnlyHere

__all__ = [
    "Arm", "Clipped", "ConsoleHandle", "Disconnected", "Ecm", "Gains", "Gripper", "Handler", "Impedance", "Jaw",
    "JointState", "Joints", "MoveHandle", "Mtm", "Problem", "Process", "Provider", "Psm", "Refused", "SetupArm",
    "Suj", "System", "TeleopHandle", "__version__", "aio", "arm", "console", "ecm", "mtm", "provide", "psm", "suj",
    "system", "teleop",
]

A = TypeVar("A", bound=Arm)
F = TypeVar("F", bound=InstanceHandle)
T = TypeVar("T")
Where: TypeAlias = "tuple[str, str | Path, ssl.SSLContext | None]"
"""`at`, `token` and `tls` as `arm` takes them."""
TRY_AGAIN_S = 0.2
PLACES = ("Handler", "Process", "Provider", "provide")


def __getattr__(name: str) -> object:
    """Places for user programs, which most scripts do without: the code of processes takes as long to load as ours."""
    if name not in PLACES:
        raise AttributeError(f"module 'trocar' has no attribute {name!r}")
    if sys.platform != "linux":
        return OnlyHere
    return getattr(importlib.import_module("trocar.tools.client.provider"), name)


def arm(name: str, system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
        tls: ssl.SSLContext | None = None) -> Arm:
    """Connect to the arm `name` and return a Psm, Ecm or Mtm; TimeoutError after `timeout` s.

    If the system is up, an unknown name raises Problem immediately.

    `system`: default: environment variable TROCAR_SYSTEM, else the one running. `at`: HOST:PORT of the socket bridge of
    a system on another machine, with its `token` (or the Path of a file that contains it); `tls`: e.g. the result of
    ssl.create_default_context().
    """
    return _found("arm", _arm, name, system, timeout, (at, token, tls))


def psm(name: str, system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
        tls: ssl.SSLContext | None = None) -> Psm:
    """Like `arm`; Problem if it is not a PSM."""
    return _of(Psm, arm(name, system, timeout, at=at, token=token, tls=tls))


def ecm(name: str = "ECM", system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
        tls: ssl.SSLContext | None = None) -> Ecm:
    """Like `arm`; Problem if it is not an ECM."""
    return _of(Ecm, arm(name, system, timeout, at=at, token=token, tls=tls))


def mtm(name: str, system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
        tls: ssl.SSLContext | None = None) -> Mtm:
    """Like `arm`; Problem if it is not an MTM."""
    return _of(Mtm, arm(name, system, timeout, at=at, token=token, tls=tls))


def suj(name: str = "SUJ", system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
        tls: ssl.SSLContext | None = None) -> Suj:
    """The setup joints `name`, once they are connected; TimeoutError after `timeout` s."""
    return _found("suj", Suj, name, system, timeout, (at, token, tls))


def console(name: str = "console", system: str | None = None, timeout: float = 5.0, *, at: str = "",
            token: str | Path = "", tls: ssl.SSLContext | None = None) -> ConsoleHandle:
    """The console `name`, once it is connected; TimeoutError after `timeout` s."""
    return _found("console", ConsoleHandle, name, system, timeout, (at, token, tls))


def teleop(name: str, system: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
           tls: ssl.SSLContext | None = None) -> TeleopHandle:
    """The teleoperation `name`, once it is connected; TimeoutError after `timeout` s."""
    return _found("teleop", TeleopHandle, name, system, timeout, (at, token, tls))


@overload
def system(name: str | None = None, timeout: float = 5.0) -> System: ...
@overload
def system(name: str | None = None, timeout: float = 5.0, *, at: str, token: str | Path = "",
           tls: ssl.SSLContext | None = None) -> DistantSystem: ...
def system(name: str | None = None, timeout: float = 5.0, *, at: str = "", token: str | Path = "",
           tls: ssl.SSLContext | None = None) -> System | DistantSystem:
    """A running system, default as in `arm`; TimeoutError if there is none within `timeout` s."""
    return system_here(name, timeout) if not at else _at((at, token, tls), timeout, DistantSystem)


def aio(make: Callable[..., Any], *given: Any, **named: Any) -> Aio:
    """`make(*given, **named)` with coroutine methods: `async with trocar.aio(trocar.psm, "PSM1") as psm`."""
    from trocar.tools.client.aio import Aio  # most scripts do without asyncio, and it takes a while

    return Aio(lambda: make(*given, **named))


def _arm(ways: Ways, name: str) -> Arm:
    kind = ways.type_of(name)
    if not kind:  # the system restarts, with another document
        raise Problem(none_such("arm", name, ()))
    return class_of(ARM_TYPES[kind].client, Arm)(ways, name)


def _found(kind: str, make: Callable[[Ways, str], F], name: str, system: str | None, timeout: float, where: Where) -> F:
    """An instance on this machine, or `at` another one."""
    if not where[0]:
        return found_here(kind, make, name, system, timeout)
    return _at(where, timeout, lambda ways: make(ways.checked(kind, name), name))


def _at(where: Where, timeout: float, made: Callable[[DistantWays], T]) -> T:
    """The result of `made` for a connection, tried until it succeeds."""
    import ssl  # of no use on the robot's own machine

    ctrl_c_in_a_line()
    at, token, tls = where
    end = monotonic_ns() + round(timeout * 1e9)
    while True:
        connection = None
        try:
            connection = BridgeConnection(at, token, tls, timeout)
            return made(DistantWays(connection))
        except (OSError, Problem) as error:  # a TimeoutError is an OSError
            if connection is not None:
                connection.close()
            if isinstance(error, NotThere):
                raise
            if monotonic_ns() >= end or isinstance(error, ssl.SSLError):
                raise TimeoutError(f"{at} is not connected after {timeout:g} s: {error}") from None
            pause(TRY_AGAIN_S)


def _of(kind: type[A], found: Arm) -> A:
    if isinstance(found, kind):
        return found
    found.close()
    raise Problem(f"{found.name} is not of type {kind.__name__.upper()}; its type is {type(found).__name__.upper()}")
