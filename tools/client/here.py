"""Functions that need the robot's own machine: systems by name, arms by shared memory, places for user programs."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeVar

from trocar.procs.crtk.names import none_such
from trocar.procs.document.process import processes_of
from trocar.procs.machine.end_signals import ctrl_c_in_a_line
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.deadline import seconds
from trocar.tools.client.instance import InstanceHandle
from trocar.tools.client.shared import SharedWays
from trocar.tools.client.ways import Ways
from trocar.tools.client.whole import WholeSystem
from trocar.tools.inspect.watch import arm_names
from trocar.tools.output.errors import NotThere, PlaceTaken, Problem
from trocar.tools.systems.find import chosen_system, is_up

if TYPE_CHECKING:
    from trocar.tools.inspect.processes import ProcessStatus

TRY_AGAIN_S: Final = 0.05
A = TypeVar("A", bound=InstanceHandle)
T = TypeVar("T")


class System(WholeSystem):
    """One running system; a context manager. Made by `system`."""

    def __init__(self, name: str) -> None:
        """`name` must be up."""
        super().__init__(SharedWays(name))

    def arms(self) -> list[str]:
        """Names of its arms."""
        return arm_names(self.name)

    def _bring(self, goal: str, timeout: float) -> None:
        bring_all(self.name, (), goal, timeout)

    def status(self) -> list[ProcessStatus]:
        """Every process: state, rate, missed deadlines, restarts, problem."""
        from trocar.tools.inspect.processes import statuses  # a fifth of the time that `import trocar` takes

        return statuses(self.name)


def found_here(kind: str, make: Callable[[Ways, str], A], name: str, system: str | None, timeout: float) -> A:
    """The instance `name` of this kind, once it is connected; TimeoutError after `timeout` s."""
    return connected(lambda: _attached(kind, make, asked_for(system), name), timeout, name)


def system_here(name: str | None = None, timeout: float = 5.0) -> System:
    """A running system, default as in `arm`; TimeoutError if there is none within `timeout` s."""
    return connected(lambda: System(asked_for(name)), timeout, name or "a system")


def asked_for(system: str | None) -> str:
    """The selected system: `system` if given, else by the environment or the only one up; Problem as there."""
    return chosen_system(system or os.environ.get("TROCAR_SYSTEM"))


def _attached(kind: str, make: Callable[[Ways, str], A], system: str, name: str) -> A:
    """Problem or SegmentError when it is not connected (yet); NotThere where the system is up and has none of the name.
    """
    try:
        known = [row.name for row in processes_of(directory.document(system)) if row.kind == kind]
    except ValueError as error:
        raise Problem(f"system {system}: {error}") from None
    if name not in known:
        raise (NotThere if is_up(system) else Problem)(none_such(kind, name, known))
    found = make(SharedWays(system), name)
    if found.connected():
        return found
    found.close()
    raise Problem(f"{name} does not show its state; is it running?")


def connected(attach: Callable[[], T], timeout: float, what: str) -> T:
    """The result of `attach`, once it succeeds; TimeoutError (last problem) after `timeout` s; NotThere, PlaceTaken."""
    ctrl_c_in_a_line()
    end = monotonic_ns() + round(seconds(timeout) * 1e9)
    while True:
        try:
            return attach()
        except (NotThere, PlaceTaken):
            raise
        except (Problem, SegmentError) as error:
            if monotonic_ns() >= end:
                raise TimeoutError(f"{what} is not connected after {timeout:g} s: {error}") from None
            pause(TRY_AGAIN_S)
