"""The control page: one per instance, with its heartbeat, timing and sleep state.

One record (the row below) behind the common header. Only the instance writes its cells, except: `wakeup`, which a waker
resets; `state` and `error` before the instance exists (the supervisor sets CREATED when it starts one); and clients'
subscriptions (shm/system/subscriptions.py). Statistics cover the last full second.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.shm.memory.holders import HOLDER
from trocar.shm.memory.layout import schema_of, shorten
from trocar.shm.memory.rows import Field, Topic
from trocar.shm.memory.segment import Make, Segment, SegmentError, create, segment_name
from trocar.shm.ring.ring import attach
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.wakeup import Wakeup

STATES = ("CREATED", "STARTING", "RUNNING", "STOPPING", "STOPPED", "FAILED")
SUBSCRIBERS = 64
CELL_BITS = 63  # bits of a cell for topics and groups; see subscriptions.EVERY for the last one

CONTROL = Topic("control", writer="*", depth=1, fields=(
    Field("wakeup", "<u4", "", "1: sleeps until there is news, a futex word (W: the instance; 0: who has news)"),
    Field("state", "u1", "", "place in STATES"),
    Field("pid", "<u4", "", "process"),
    Field("period_ns", "<i8", "ns", "nominal period, 0: event driven"),
    Field("heartbeat_ns", "<i8", "ns", "monotonic time of the last cycle; in simulated time also of looks at it"),
    Field("cycles", "<u8", "", "cycles since start"),
    Field("missed", "<u8", "", "deadlines missed since start"),
    Field("overruns", "<u8", "", "cycles whose work took longer than the period, since start"),
    Field("pauses", "<u8", "", "stalls that made it restart its work, since start"),
    Field("interval_cycles", "<u8", "", "cycles in the last full second"),
    Field("interval_missed", "<u8", "", "deadlines missed in the last full second"),
    Field("period_avg", "<f8", "s", "mean period"),
    Field("period_std", "<f8", "s", "standard deviation"),
    Field("period_min", "<f8", "s", "shortest"),
    Field("period_max", "<f8", "s", "longest"),
    Field("period_p99", "<f8", "s", "99 % are shorter"),
    Field("work_avg", "<f8", "s", "mean time of a cycle's work"),
    Field("work_std", "<f8", "s", "standard deviation"),
    Field("work_min", "<f8", "s", "shortest"),
    Field("work_max", "<f8", "s", "longest"),
    Field("work_p99", "<f8", "s", "99 % are shorter"),
    Field("latency_avg", "<f8", "s", "io: mean time from the boards' reply to the next write"),
    Field("latency_std", "<f8", "s", "standard deviation"),
    Field("latency_min", "<f8", "s", "shortest"),
    Field("latency_max", "<f8", "s", "longest"),
    Field("latency_p99", "<f8", "s", "99 % are shorter"),
    Field("policy", "S32", "", "scheduling obtained, e.g. FIFO 80, other"),
    Field("error", "S400", "", "why setup failed"),
    Field("computes", "S120", "", "what computes for all axes: native, or numpy: and the reason; empty: nothing"),
    Field("wanted", f"({SUBSCRIBERS},)<u8", "", "requests of each subscriber, one bit each (W: who has the place)"),
    Field("place", f"({SUBSCRIBERS},)u1", "", "a subscriber locks its byte; never written"),
    Field("holder", f"({SUBSCRIBERS},{HOLDER.size})u1", "", "process id, program (W: who has the place)"),
))
SCHEMA = schema_of(CONTROL)


def create_control(system: str, instance: str, make: Make = create, topics: Iterable[Topic] = ()) -> int:
    """Make the control page of an instance with these topics; returns its size."""
    name = segment_name(system, instance, "control")
    wanted = [wanted_name(topic.name, group) for topic in topics for group in ("", *topic.groups)]
    if len(wanted) > CELL_BITS:
        raise SegmentError(f"{name}: {len(wanted)} topics and groups of fields; allowed are {CELL_BITS}")
    return make(name, "control", SCHEMA, 1, {"wanted": wanted})


def wanted_name(topic: str, group: str = "") -> str:
    """Name of a topic, or of a group of its fields, in the list of possible subscriptions."""
    return f"{topic}/{group}" if group else topic


class ControlPage:
    """A control page, attached read-only (tools) or read-write (the instance, and processes that wake it)."""

    def __init__(self, system: str, instance: str, *, write: bool = False) -> None:
        """Attach; SegmentError if there is no such instance."""
        self.instance = instance
        self.segment = Segment(segment_name(system, instance, "control"), write=write)
        try:
            attach(self.segment, "control", SCHEMA)
        except BaseException:
            self.segment.close()
            raise
        self._record = np.frombuffer(self.segment.view, dtype=SCHEMA.dtype, count=1, offset=self.segment.header.first)

    def field(self, name: str) -> NDArray[Any]:
        """A live view on one cell."""
        view = self._record[name]
        return view.reshape(view.shape[1:])

    def get(self, name: str) -> Any:
        """One value, as a Python object."""
        return self._record[name][0].item()

    @property
    def state(self) -> str:
        """The lifecycle state the instance shows."""
        code = int(self._record["state"][0])
        return STATES[code] if code < len(STATES) else f"unknown ({code})"

    def show(self, state: str, error: str = "") -> None:
        """Set the lifecycle state (by the instance; before it has started, by the supervisor)."""
        self._record["error"][0] = shorten(error, 399)
        self._record["state"][0] = STATES.index(state)

    def wakeup(self) -> Wakeup:
        """The instance sleeps on it until there is news; others wake it. Needs write access."""
        return Wakeup(self.segment, self.segment.header.first + SCHEMA.offset("wakeup"))

    def close(self) -> None:
        """Unmap."""
        self.segment.close()


def silence_s(system: str, instance: str) -> float | None:
    """Real time since the last heartbeat of an instance, s; None: there is none."""
    with contextlib.suppress(SegmentError), contextlib.closing(ControlPage(system, instance)) as page:
        beat_ns = int(page.get("heartbeat_ns"))
        if 0 < beat_ns <= monotonic_ns():
            return (monotonic_ns() - beat_ns) * 1e-9
    return None
