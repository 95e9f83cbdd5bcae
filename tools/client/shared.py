"""Records and events of instances on this machine, and commands to them: shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trocar.procs.crtk.demand import Wanted, wait_until_computed
from trocar.procs.crtk.topics import EVENT, TopicEntry, catalogue, find
from trocar.procs.crtk.views import OpenTopic
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.remote import Remote
from trocar.tools.client.values import FRESH_S
from trocar.tools.client.ways import InstanceRecord, ShownState
from trocar.tools.inspect.watch import arm_document, arm_type
from trocar.tools.output.errors import Problem, closed
from trocar.tools.systems.find import is_simulated


class SharedRecord(InstanceRecord):
    """The records of one instance of this machine."""

    def __init__(self, system: str, name: str) -> None:
        """Attach; SegmentError if there is no such record."""
        super().__init__(name)
        self._system, self._demand = system, Wanted(system)
        state = find(system, f"{name}/state")
        entries = [entry for entry in catalogue(system) if entry.instance == name]
        self._flags = {entry.name: entry for entry in entries if entry.kind == EVENT}
        self._events: dict[str, OpenTopic] = {}  # opened on first use
        self._reader: RingReader = directory.reader(system, name, "state", often=False)
        self._state = OpenTopic(system, state, self._reader)
        self._views = {entry.name: OpenTopic(system, entry, self._reader) for entry in entries if entry.view}
        self._time = SystemTime(system)

    def look(self) -> ShownState:
        """See InstanceRecord."""
        if not self.is_fresh():
            raise self._too_old()
        return ShownState(self._state.value, self._state.stamp_ns)

    def row(self) -> Mapping[str, Any]:
        """The newest state record as plain values; TimeoutError if it is too old."""
        self.look()
        return self._state.as_dict()

    def is_fresh(self) -> bool:
        """Whether there is a new record."""
        now_ns = self._time.now_ns()  # before the look: simulated time may pass quickly while we lack a core
        return self._state.newest() and (now_ns - self._state.stamp_ns) * 1e-9 <= FRESH_S

    def stamp_ns(self) -> int:
        """The robot's time in the newest record, of any age; 0: there is none."""
        return self._state.stamp_ns if self._state.newest() else 0

    def view(self, name: str) -> OpenTopic:
        """See InstanceRecord."""
        source = self._views.get(f"{self._name}/{name}")
        if source is None:
            raise Problem(f"{self._name} does not publish {name}")
        self.look()
        if not source.valid:
            raise self._invalid(name)
        if source.groups:
            try:
                self._demand.want(source.entry)
            except SegmentError as error:  # others have all places
                raise Problem(str(error)) from None
            if not wait_until_computed(source, FRESH_S):
                raise TimeoutError(f"{source.entry.name} was not computed within {FRESH_S:g} s")
        return source

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
        return list(self._reader.info.get("setups", {}))

    def close(self) -> None:
        """Detach, and end all subscriptions."""
        self._demand.close()
        self._time.close()
        self._state.close()
        self._state = self._time = closed(self._name)
        for event in self._events.values():
            event.close()


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

    def record(self, name: str) -> SharedRecord:
        """Records of an instance; Problem or SegmentError if it is not there (yet)."""
        return SharedRecord(self.name, name)

    def remote(self, name: str) -> Remote:
        """Commands to it; the same errors."""
        return Remote(self.name, name)

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
        from trocar.tools.inspect.processes import statuses  # see `System.status`

        return next((process.statistics for process in statuses(self.name) if process.name == name), {})

    def gripper_zero(self, name: str) -> float:
        """Angle (rad) above which a master's gripper is open."""
        return arm_document(self.name, name).gripper_zero
