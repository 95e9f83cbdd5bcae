"""One running system, and how to come to its arms."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from trocar.procs.crtk.names import none_such
from trocar.procs.machine.end_signals import ctrl_c_in_a_line
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client import bring_up as arms
from trocar.tools.client.consoles import Operated
from trocar.tools.client.instance import Instance
from trocar.tools.client.shared import SharedWays
from trocar.tools.client.sounds import Sounds
from trocar.tools.inspect.processes import ProcessStatus, statuses
from trocar.tools.inspect.watch import arm_names, document_of
from trocar.tools.output.errors import NotThere, PlaceTaken, Problem
from trocar.tools.systems.find import is_up

TRY_AGAIN_S = 0.05

T = TypeVar("T")
Found = TypeVar("Found", bound=Instance | Operated)


class System(Sounds):
    """One running system; a context manager. Made by `system`."""

    def __init__(self, name: str) -> None:
        """`name` must be up."""
        super().__init__(SharedWays(name))

    def arms(self) -> list[str]:
        """Names of its arms."""
        return arm_names(self.name)

    def power_on(self, timeout: float = 10.0) -> None:
        """Enable every arm, and the setup joints; Problem says which are not and why."""
        arms.power_on(self.name, (), timeout)

    def home(self, timeout: float = 60.0) -> None:
        """Home every arm, enabling those that are not."""
        arms.home(self.name, (), timeout)

    def power_off(self, timeout: float = 10.0) -> None:
        """Disable every arm."""
        arms.power_off(self.name, (), timeout)

    def status(self) -> list[ProcessStatus]:
        """Every process: state, rate, missed deadlines, restarts, problem."""
        return statuses(self.name)


def attached(kind: str, make: Callable[[str, str], Found], system: str, name: str) -> Found:
    """The instance `name`, made by `make(system, name)`; Problem or SegmentError when it is not connected (yet).

    NotThere where the system is up and has none of this name.
    """
    known = [row.name for row in document_of(system).processes if row.kind == kind]
    if name not in known:
        raise (NotThere if is_up(system) else Problem)(none_such(kind, name, known))
    found = make(system, name)
    if found.connected():
        return found
    found.close()
    raise Problem(f"{name} does not show its state; is it running?")


def connected(attach: Callable[[], T], timeout: float, what: str) -> T:
    """What `attach` gives, once it does; TimeoutError with the last problem after `timeout` s; NotThere, PlaceTaken."""
    ctrl_c_in_a_line()
    end = monotonic_ns() + round(timeout * 1e9)
    while True:
        try:
            return attach()
        except (NotThere, PlaceTaken):
            raise
        except (Problem, SegmentError) as error:
            if monotonic_ns() >= end:
                raise TimeoutError(f"{what} is not connected after {timeout:g} s: {error}") from None
            pause(TRY_AGAIN_S)
