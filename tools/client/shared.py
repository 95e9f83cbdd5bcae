"""Records and events of instances on this machine, and commands to them: shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trocar.procs.crtk.demand import OnDemand, wait_until_computed
from trocar.procs.crtk.topics import EVENT, TopicEntry, catalogue
from trocar.procs.crtk.views import OpenTopic, open_topic
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.shm.memory.segment import SegmentError
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.remote import Remote
from trocar.tools.client.values import FRESH_S, Array, JointState, Stamped
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.watch import Watch, arm_document, arm_type
from trocar.tools.output.errors import Problem, closed
from trocar.tools.systems.find import is_simulated


class InstanceRecord:
    """All that one arm, or set of setup joints, shows; every read looks for the newest record."""

    def __init__(self, system: str, instance: str) -> None:
        """Attach; SegmentError if there is no such record."""
        self.watch = Watch(system, instance)
        self._system, self._name = system, instance
        self._demand = OnDemand(system, instance)
        self._events: dict[str, OpenTopic] = {}  # opened on first use
        try:
            entries = [entry for entry in catalogue(system) if entry.instance == instance]
            self._views = {entry.name: OpenTopic(system, entry, self.watch.reader) for entry in entries if entry.view}
            self._flags = {entry.name: entry for entry in entries if entry.kind == EVENT}
        except BaseException:
            self.watch.close()
            raise

    def look(self) -> Watch:
        """The newest record; TimeoutError if it is too old."""
        if not self.is_fresh():
            raise TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")
        return self.watch

    def is_fresh(self) -> bool:
        """Whether there is a new one."""
        return self.watch.look() and self.watch.age_s < FRESH_S

    def stamp_ns(self) -> int:
        """The robot's time in the newest record, of any age; 0: there is none."""
        return self.watch.stamp_ns if self.watch.look() else 0

    def part(self, view: str, name: str) -> Stamped:
        """A part of a view; TimeoutError if it is too old, not valid now, or not computed in time.

        Values computed on demand are subscribed from the first call until `close`.
        """
        source = self._newest(view)
        value: Array = source.part(name)
        return value, source.stamp_ns

    def pose(self, view: str) -> Stamped:
        """The pose (4, 4) that a view shows."""
        pose, stamp_ns = self.part(view, "pose")
        return matrix_from_pose(pose), stamp_ns

    def joint_state(self, view: str) -> tuple[JointState, int]:
        """Joint values of a view."""
        source = self._newest(view)
        parts: list[Any] = [source.part(name) for name in JointState._fields]
        return JointState(*parts), source.stamp_ns

    def joint_names(self, view: str) -> list[str]:
        """Names of the joints of a view."""
        return self._newest(view).labels()

    def reported(self, event: str) -> bool:
        """The last flag of an event of this name; False if there was none."""
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
        """Unmap, and end all subscriptions."""
        self._demand.close()
        self.watch.close()
        self.watch = closed(self._name)
        for event in self._events.values():
            event.close()


class SharedRows:
    """The state record of any instance, as plain values."""

    def __init__(self, system: str, name: str) -> None:
        """Attach; Unknown, a SegmentError, if there is none."""
        self._topic, self._name = open_topic(system, f"{name}/state"), name

    def row(self) -> Mapping[str, Any]:
        """The newest record; TimeoutError if it is too old."""
        if not self._topic.newest() or self._topic.age_s > FRESH_S:
            raise TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")
        return self._topic.as_dict()

    def is_fresh(self) -> bool:
        """Whether there is a new one."""
        try:
            self.row()
        except (TimeoutError, Problem):
            return False
        return True

    def stamp_ns(self) -> int:
        """The robot's time in the newest record, of any age; 0: there is none."""
        return self._topic.stamp_ns if self._topic.newest() else 0

    def close(self) -> None:
        """Unmap."""
        self._topic.close()
        self._topic = closed(self._name)


class SharedEvents:
    """The events of one instance that a script follows."""

    def __init__(self, system: str, name: str) -> None:
        """No events opened yet."""
        self._system, self._name = system, name
        self._open: dict[str, OpenTopic] = {}

    def _entries(self) -> dict[str, TopicEntry]:
        return {entry.event: entry for entry in catalogue(self._system)
                if entry.instance == self._name and entry.kind == EVENT}

    def names(self) -> list[str]:
        """Events that there are."""
        return list(self._entries())

    def follow(self, event: str) -> None:
        """Take in each event of this name, one of `names`, from now on."""
        if event not in self._open:
            self._open[event] = OpenTopic(self._system, self._entries()[event])

    def leave(self, event: str) -> None:
        """End the subscription."""
        if event in self._open:
            self._open.pop(event).close()

    def taken(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Those since the last call, with their names, in order; `lost`: number of missed ones before an event."""
        found: list[tuple[str, Mapping[str, Any]]] = []
        for event, topic in self._open.items():
            lost = topic.lost
            while topic.next():
                found.append((event, topic.as_dict() | ({"lost": topic.lost - lost} if topic.lost > lost else {})))
                lost = topic.lost
        return sorted(found, key=lambda row: int(row[1]["sequence"]))

    def close(self) -> None:
        """Unmap."""
        for topic in self._open.values():
            topic.close()
        self._open.clear()


class SharedWays:
    """Both ways to any instance of one system."""

    def __init__(self, system: str) -> None:
        """`system` must be up."""
        self.name, self.is_simulated = system, is_simulated(system)

    def record(self, name: str) -> InstanceRecord:
        """Records of an instance; Problem or SegmentError if it is not there (yet)."""
        return InstanceRecord(self.name, name)

    def remote(self, name: str) -> Remote:
        """Commands to it; the same errors."""
        return Remote(self.name, name)

    def rows(self, name: str) -> SharedRows:
        """The state record of an instance that is not an arm; the same errors."""
        return SharedRows(self.name, name)

    def events(self, name: str) -> SharedEvents:
        """Events of an instance."""
        return SharedEvents(self.name, name)

    def type_of(self, name: str) -> str:
        """The type of an arm; "": not an arm."""
        return arm_type(self.name, name)

    def bring(self, name: str, goal: str, timeout: float) -> None:
        """Enable, home or disable an instance and wait for it; Problem gives the reason for a failure."""
        try:
            bring_all(self.name, [name], goal, timeout)
        except SegmentError as error:  # the system has gone, or others have all places
            raise Problem(str(error)) from None

    def statistics(self, name: str) -> dict[str, dict[str, float]]:
        """Figures of the period and the work of its loop."""
        return next((process.statistics for process in statuses(self.name) if process.name == name), {})

    def gripper_zero(self, name: str) -> float:
        """Angle (rad) above which a master's gripper is open."""
        return arm_document(self.name, name).gripper_zero
