"""What an arm shows: its newest state record, and the CRTK views on it."""

from __future__ import annotations

from typing import Any

from trocar.procs.crtk.demand import OnDemand, wait_until_computed
from trocar.procs.crtk.topics import EVENT, catalogue
from trocar.procs.crtk.views import OpenTopic
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.shm.memory.segment import SegmentError
from trocar.tools.client.closed import closed
from trocar.tools.client.values import FRESH_S, Array, JointState, Stamped
from trocar.tools.inspect.watch import Watch
from trocar.tools.output.errors import Problem


class InstanceRecord:
    """All that one arm, or set of setup joints, shows; every read looks for the newest record."""

    def __init__(self, system: str, instance: str) -> None:
        """Attach; SegmentError when there is no such record."""
        self.watch = Watch(system, instance)
        self._system, self._name = system, instance
        self._demand = OnDemand(system, instance)
        self._events: dict[str, OpenTopic] = {}  # opened when asked for
        try:
            entries = [entry for entry in catalogue(system) if entry.instance == instance]
            self._views = {entry.name: OpenTopic(system, entry, self.watch.reader) for entry in entries if entry.view}
            self._flags = {entry.name: entry for entry in entries if entry.kind == EVENT}
        except BaseException:
            self.watch.close()
            raise

    def look(self) -> Watch:
        """The newest record; TimeoutError when it is too old."""
        if not self.is_fresh():
            raise TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")
        return self.watch

    def is_fresh(self) -> bool:
        """Whether there is a new one."""
        return self.watch.look() and self.watch.age_s < FRESH_S

    def stamp_ns(self) -> int:
        """The robot's time, as the newest record shows it, however old; 0: there is none."""
        return self.watch.stamp_ns if self.watch.look() else 0

    def part(self, view: str, name: str) -> Stamped:
        """A part of a view; TimeoutError when it is too old, not valid now, or not computed in time.

        What is computed on demand is wanted from the first call until `close`.
        """
        source = self._newest(view)
        value: Array = source.part(name)
        return value, source.stamp_ns

    def pose(self, view: str) -> Stamped:
        """The pose (4, 4) that a view shows."""
        pose, stamp_ns = self.part(view, "pose")
        return matrix_from_pose(pose), stamp_ns

    def joint_state(self, view: str) -> tuple[JointState, int]:
        """What a view shows of joints."""
        source = self._newest(view)
        parts: list[Any] = [source.part(name) for name in JointState._fields]
        return JointState(*parts), source.stamp_ns

    def joint_names(self, view: str) -> list[str]:
        """Names of the joints of a view."""
        return self._newest(view).labels()

    def reported(self, event: str) -> bool:
        """The flag that an event of this name told last; False when there was none."""
        source = self._events.get(event)
        if source is None:
            entry = self._flags.get(f"{self._name}/{event}")
            if entry is None:
                raise Problem(f"{self._name} does not report {event}")
            source = self._events[event] = OpenTopic(self._system, entry)
        return source.newest() and bool(source.part("value")[0])

    def parts(self) -> list[str]:
        """Names of the setup arms that it shows."""
        return list(self.watch.reader.info.get("setups", {}))

    def _newest(self, view: str) -> OpenTopic:
        source = self._views.get(f"{self._name}/{view}")
        if source is None:
            raise Problem(f"{self._name} does not show {view}")
        self.look()
        if not source.valid:
            raise TimeoutError(f"{source.entry.name} is not valid now (is the arm powered and homed?)")
        if source.groups:
            try:
                self._demand.want(source)
            except SegmentError as error:  # others have all places
                raise Problem(str(error)) from None
            if not wait_until_computed(source, FRESH_S):
                raise TimeoutError(f"{source.entry.name} was not computed within {FRESH_S:g} s")
        return source

    def close(self) -> None:
        """Unmap, and want nothing more."""
        self._demand.close()
        self.watch.close()
        self.watch = closed(self._name)
        for event in self._events.values():
            event.close()
