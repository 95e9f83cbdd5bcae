"""The ways to instances on this machine: shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trocar.procs.crtk.views import open_topic
from trocar.shm.memory.segment import SegmentError
from trocar.tools.client import bring_up as arms
from trocar.tools.client.bring_up import DISABLED, ENABLED, HOMED
from trocar.tools.client.closed import closed
from trocar.tools.client.record import InstanceRecord
from trocar.tools.client.remote import Remote
from trocar.tools.client.reported import SharedEvents
from trocar.tools.client.values import FRESH_S
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.watch import arm_document, arm_type
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import is_simulated


class SharedRows:
    """The state record of any instance, as plain values."""

    def __init__(self, system: str, name: str) -> None:
        """Attach; Unknown, a SegmentError, when there is none."""
        self._topic, self._name = open_topic(system, f"{name}/state"), name

    def row(self) -> Mapping[str, Any]:
        """The newest one; TimeoutError when it is too old."""
        if not self._topic.newest() or self._topic.age_s > FRESH_S:
            raise TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")
        return self._topic.as_dict()

    def stamp_ns(self) -> int:
        """The robot's time, as the newest record shows it, however old; 0: there is none."""
        return self._topic.stamp_ns if self._topic.newest() else 0

    def close(self) -> None:
        """Unmap."""
        self._topic.close()
        self._topic = closed(self._name)


class SharedWays:
    """Both ways to any instance of one system."""

    def __init__(self, system: str) -> None:
        """`system` must be up."""
        self.name, self.is_simulated = system, is_simulated(system)

    def record(self, name: str) -> InstanceRecord:
        """What an instance shows; Problem or SegmentError when it is not there (yet)."""
        return InstanceRecord(self.name, name)

    def remote(self, name: str) -> Remote:
        """What it is asked; the same."""
        return Remote(self.name, name)

    def rows(self, name: str) -> SharedRows:
        """The state record of an instance that is no arm; the same."""
        return SharedRows(self.name, name)

    def events(self, name: str) -> SharedEvents:
        """What an instance reports."""
        return SharedEvents(self.name, name)

    def type_of(self, name: str) -> str:
        """The type of an arm; "": it is none."""
        return arm_type(self.name, name)

    def bring(self, name: str, goal: str, timeout: float) -> None:
        """Enable, home or disable an instance and wait for it; Problem says why it is not so."""
        try:
            {ENABLED: arms.power_on, HOMED: arms.home, DISABLED: arms.power_off}[goal](self.name, [name], timeout)
        except SegmentError as error:  # the system has gone, or others have all places
            raise Problem(str(error)) from None

    def statistics(self, name: str) -> dict[str, dict[str, float]]:
        """Figures of the period and the work of its loop."""
        return next((process.statistics for process in statuses(self.name) if process.name == name), {})

    def gripper_zero(self, name: str) -> float:
        """Angle (rad) above which a master's gripper is open."""
        return arm_document(self.name, name).gripper_zero
