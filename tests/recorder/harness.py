"""A system of rings alone, written by the test, and the parts of a recorder on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from trocar.procs.recorder.box import BlackBox, BoxLimits
from trocar.procs.recorder.disk import Disk, DiskFile, no_room_made, open_new
from trocar.procs.recorder.fault import FaultRecording
from trocar.procs.recorder.files import path_of
from trocar.procs.recorder.named import NamedRecording, chosen
from trocar.procs.recorder.sources import LocalTimes, SystemSources
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.writing import ChannelTable
from trocar.shm.memory.rows import Field
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import create_control
from trocar.shm.time.system_time import SystemTime
from trocar.shm.topics import ARM_STATE, EVENTS, RECORDER_STATE, SETPOINT, Topic

SELDOM = Topic("gains", "user", (Field("number", "<f8", "", "as it is set"),), depth=8)
SLOW = Topic("state", "user", rate_hz=100, depth=20, fields=(Field("number", "<f8", "", "counts"),))


class RingsOfATest:
    """PSM1 with state, setpoint and events; box with a ring of twenty records; recorder with its own state."""

    def __init__(self, system: str, folder: Path) -> None:
        self.system, self.folder = system, folder
        for instance, topics in (("PSM1", (ARM_STATE, SETPOINT, EVENTS)), ("box", (SLOW, SELDOM)),
                                 ("recorder", (RECORDER_STATE,))):
            create_control(system, instance, topics=topics)
            for topic in topics:
                kind = {"PSM1": "arm", "box": "user"}.get(instance, "recorder")
                directory.create_ring(system, instance, topic, {}, {"kind": kind, "type": "PSM"})
        self.state = directory.writer(system, "PSM1", "state", "arm")
        self.setpoint = directory.writer(system, "PSM1", "setpoint", "arm")
        self.slow = directory.writer(system, "box", "state", None)
        self.seldom = directory.writer(system, "box", "gains", None)
        self._events = directory.writer(system, "PSM1", "events", "arm")
        self.events = Events(self._events, monotonic_ns)
        self.time = SystemTime(system)
        self.disk, self.table = Disk(), ChannelTable()
        self.times = LocalTimes(self.time)
        self._begin_ns = self.times.monotonic_ns
        self.sources = SystemSources(system, self.table, "recorder")
        self.opened: Any = open_new
        self.begun: list[DiskFile] = []
        self._closing: list[Any] = []

    def write(self, count: int) -> None:
        """So many records of the arm's two rings, one ms apart until now."""
        first = max(self.state.stamp_ns, monotonic_ns() - count * 1_000_000) + 1
        for n in range(count):
            self.state.field("count")[...] = 2
            self.state.field("valid")[...] = True
            self.state.field("position")[:2] = n
            self.state.publish(first + n * 1000)
            self.setpoint.publish(first + n * 1000)

    def begin_file(self, path: Path, kind: str, make_room: Callable[[], bool] = no_room_made, **more: str
                   ) -> DiskFile:
        """As the recorder does."""
        facts = {names.SYSTEM: {"format": names.FORMAT, "kind": kind, "system": self.system, **more}}
        self.begun.append(DiskFile(self.disk, path, self.table, facts, (), self.times.local_ns, self.opened,
                                   make_room))
        return self.begun[-1]

    def box(self, **limits: Any) -> BlackBox:
        """A black box."""
        usual = {"rate_hz": 50.0, "minutes": 10.0, "size_mb": 500.0, "compression": "zstd"}
        return BlackBox(self.folder, self.disk, self.sources, self.times, BoxLimits(**usual | limits), self.begin_file)

    def named(self, *topics: str, seconds: float = 0.0) -> NamedRecording:
        """A recording of these topics."""
        file = self.begin_file(path_of(self.folder, names.NAMED, self.times.local_ns, "grasp"), names.NAMED)
        made = NamedRecording("grasp", self.sources, chosen(self.sources, topics), file, self.times, seconds, "zstd")
        self._closing.append(made)
        return made

    def begin_fault(self, fault: FaultRecording, make_room: Callable[[], bool] = no_room_made) -> DiskFile:
        """The same for a fault's."""
        path = path_of(self.folder, names.FAULT, self.times.local_ns, fault.faults[0].instance)
        return self.begin_file(path, names.FAULT, make_room,
                               **{names.CODE: fault.code, names.FIRST: "yes" if fault.is_first else ""})

    def fault(self, reason: str = "PSM1 is in FAULT", *, is_first: bool = False) -> FaultRecording:
        """What is kept of a fault."""
        return FaultRecording(SeenFault("PSM1", reason, is_first=is_first), self.sources, self.times, self.begin_fault)

    def passes(self, seconds: float = 0.0) -> None:
        """So long after the beginning, for the recorder; how busy this machine is does not count."""
        self.times.look()
        self.times.monotonic_ns = self._begin_ns + round(seconds * 1e9)

    def idle(self) -> None:
        """Nothing waits for the disk."""
        end = monotonic_ns() + 30_000_000_000
        while self.disk.waiting:
            assert monotonic_ns() < end
            pause(0.001)

    def written(self) -> None:
        """All that was given to the disk is there; nothing more can be."""
        assert self.disk.close(30.0)

    def close(self) -> None:
        """Give everything back."""
        for each in self._closing:
            each.close()
        for ring in (self.state, self.setpoint, self.slow, self.seldom, self._events):
            ring.close()
        self.sources.close()
        self.time.close()
        self.disk.close(30.0)
