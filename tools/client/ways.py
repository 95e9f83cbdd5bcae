"""The two ways to an instance, whichever machine it runs on: what it shows, and what it is asked.

Nothing here, and nothing that `import trocar` needs elsewhere, imports shared memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import ArrayLike

from trocar.procs.node.requests import Answer
from trocar.tools.client.values import JointState, Stamped


class Shown(Protocol):
    """The record of one moment."""

    @property
    def state(self) -> str:
        """The operating state."""

    @property
    def homed(self) -> bool:
        """Homed, and powered."""

    @property
    def busy(self) -> bool:
        """A move or transition is under way."""

    @property
    def stamp_ns(self) -> int:
        """When it was written, on the clock of its machine."""

    def text(self, field: str) -> str:
        """A text field."""

    def number(self, field: str) -> float:
        """A field that is one number."""


class RecordWay(Protocol):
    """All that an instance shows."""

    def look(self) -> Shown:
        """The newest record; TimeoutError when it is too old."""

    def is_fresh(self) -> bool:
        """Whether there is a new one."""

    def stamp_ns(self) -> int:
        """The robot's time, as the newest record shows it, however old; 0: there is none."""

    def part(self, view: str, name: str) -> Stamped:
        """A part of a view; TimeoutError when it is too old, not valid now, or not computed in time."""

    def pose(self, view: str) -> Stamped:
        """The pose (4, 4) that a view shows."""

    def joint_state(self, view: str) -> tuple[JointState, int]:
        """What a view shows of joints."""

    def joint_names(self, view: str) -> list[str]:
        """Names of the joints of a view."""

    def reported(self, event: str) -> bool:
        """The flag that an event of this name told last; False when there was none."""

    def parts(self) -> list[str]:
        """Names of the setup arms that it shows."""

    def close(self) -> None:
        """Look no more."""


class CommandWay(Protocol):
    """All that an instance can be asked."""

    instance: str

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The rows of its table, as its mailbox lists them."""

    def ask(self, command: str, values: ArrayLike = (), text: str = "", timeout: float = 2.0) -> Answer:
        """Send and make sure that it was accepted: Refused carries the reason. Returns the first answer."""

    def settled(self, command: str, values: ArrayLike = (), text: str = "", timeout: float = 60.0) -> Answer:
        """Send and wait for the end: refused, done or failed; Problem when it does not come in time."""

    def replies_to(self, number: int) -> Any:
        """Answers to one command, that came and were not asked for yet."""

    def close(self) -> None:
        """Ask no more."""


class RowWay(Protocol):
    """The state record of any instance, as plain values."""

    def row(self) -> Mapping[str, Any]:
        """The newest one; TimeoutError when it is too old."""

    def stamp_ns(self) -> int:
        """The robot's time, as the newest record shows it, however old; 0: there is none."""

    def close(self) -> None:
        """Look no more."""


class EventWay(Protocol):
    """What one instance reports now and then."""

    def names(self) -> list[str]:
        """Events that there are."""

    def follow(self, event: str) -> None:
        """Take in each event of this name, one of `names`, from now on."""

    def leave(self, event: str) -> None:
        """No more."""

    def taken(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Those that came since the last call, with their names, in order."""

    def close(self) -> None:
        """Take in no more."""


class Ways(Protocol):
    """Both ways to any instance of one system."""

    name: str
    is_simulated: bool
    """Its time is."""

    def record(self, name: str) -> RecordWay:
        """What an instance shows; Problem or SegmentError when it is not there (yet)."""

    def remote(self, name: str) -> CommandWay:
        """What it is asked; the same."""

    def rows(self, name: str) -> RowWay:
        """The state record of an instance that is no arm; the same."""

    def events(self, name: str) -> EventWay:
        """What an instance reports; nothing is followed yet."""

    def type_of(self, name: str) -> str:
        """The type of an arm; "": it is none."""

    def bring(self, name: str, goal: str, timeout: float) -> None:
        """Enable, home or disable an instance and wait for it; Problem says why it is not so."""

    def statistics(self, name: str) -> dict[str, dict[str, float]]:
        """Figures of the period and the work of its loop."""

    def gripper_zero(self, name: str) -> float:
        """Angle (rad) above which a master's gripper is open."""


def ways_of(system: str | Ways) -> Ways:
    """Those of this machine for a system's name: loaded where they are used, as elsewhere there is no shared memory."""
    if not isinstance(system, str):
        return system
    from trocar.tools.client.shared import SharedWays

    return SharedWays(system)
