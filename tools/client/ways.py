"""Access to an instance, on any machine: its records, commands to it, and its events.

Each has one class for this machine (shared.py) and one with the same methods for another machine (distant.py).

This module, and all modules that `import trocar` needs on other machines, do not import shared memory.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.tools.client.values import FRESH_S, JointState, Stamped

if TYPE_CHECKING:
    from trocar.procs.crtk.views import OpenTopic
    from trocar.tools.client.distant import DistantEvents, DistantRecord, DistantRemote, DistantView, DistantWays
    from trocar.tools.client.remote import Remote
    from trocar.tools.client.shared import SharedEvents, SharedRecord, SharedWays

RecordWay: TypeAlias = "SharedRecord | DistantRecord"
CommandWay: TypeAlias = "Remote | DistantRemote"
EventWay: TypeAlias = "SharedEvents | DistantEvents"
Ways: TypeAlias = "SharedWays | DistantWays"


@dataclass(frozen=True, slots=True)
class ShownState:
    """A state record as last read: `value` returns a field as a plain value."""

    value: Callable[[str], Any]
    stamp_ns: int
    """When it was written, on the clock of its machine."""

    @property
    def state(self) -> str:
        """The operating state."""
        return self.text("state")

    @property
    def homed(self) -> bool:
        """Whether the arm is homed and powered."""
        return bool(self.value("is_homed"))

    @property
    def busy(self) -> bool:
        """Whether a move or transition is in progress."""
        return bool(self.value("is_busy"))

    def text(self, field: str) -> str:
        """A text field."""
        return str(self.value(field))

    def number(self, field: str) -> float:
        """A field that is one number."""
        value = self.value(field)
        return math.nan if value is None else float(value)


class InstanceRecord(ABC):
    """The records of one instance; every read looks for the newest record."""

    def __init__(self, name: str) -> None:
        self._name = name

    @abstractmethod
    def look(self) -> ShownState:
        """The newest state record; TimeoutError if it is too old."""

    @abstractmethod
    def view(self, name: str) -> OpenTopic | DistantView:
        """A view of the newest record; TimeoutError if it is too old, not valid now, or not computed in time.

        Values computed on demand are subscribed from the first call until `close`.
        """

    def part(self, view: str, name: str) -> Stamped:
        """A part of a view."""
        source = self.view(view)
        return source.part(name), source.stamp_ns

    def pose(self, view: str) -> Stamped:
        """The pose (4, 4) that a view shows."""
        pose, stamp_ns = self.part(view, "pose")
        return matrix_from_pose(pose), stamp_ns

    def joint_state(self, view: str) -> tuple[JointState, int]:
        """Joint values of a view."""
        source = self.view(view)
        return JointState(*(source.part(name) for name in JointState._fields)), source.stamp_ns

    def joint_names(self, view: str) -> list[str]:
        """Names of the joints of a view."""
        return self.view(view).labels()

    def _too_old(self) -> TimeoutError:
        return TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")

    def _invalid(self, view: str) -> TimeoutError:
        return TimeoutError(f"{self._name}/{view} is not valid now (is the arm powered and homed?)")
