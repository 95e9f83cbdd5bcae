"""The one clock: wall (CLOCK_MONOTONIC) or lock-step (simulated, advanced by the supervisor).

In lock-step a page holds the simulated time and a counter that is rung at each advance. A process that sleeps shows in
its control page what it has finished (`done_ns`) and when it wants to go on (`next_ns`); the supervisor advances to the
earliest wish once everybody's lies ahead. Nothing else in the project reads a clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from shm.doorbell import Futex
from shm.layout import schema_of
from shm.pulse import Pulse
from shm.ring import attach
from shm.segment import Make, Segment, create, segment_name
from shm.topics import Field, Topic

PAGE = Topic(
    "clock",
    writer="supervisor",
    rate_hz=0,
    depth_s=0,
    depth=1,
    fields=(
        Field("now_ns", "<i8", "ns", "simulated time"),
        Field("tick", "<u4", "", "counts advances, a futex word"),
    ),
)
SCHEMA = schema_of(PAGE)
EPOCH_NS = 1_000_000_000_000  # simulated time begins here: differences stay positive, and it is easy to recognise
POLL_NS = 100_000_000


# Real monotonic time, for what must be bounded in real time even in lock-step (sockets, tools); in ns.
monotonic_ns = time.monotonic_ns
# The same, and it goes on while the computer is suspended; only for how long something took.
boottime_ns: Callable[[], int] = partial(time.clock_gettime_ns, time.CLOCK_BOOTTIME)
# Sleep in real time, in seconds; for tools and the supervisor.
pause = time.sleep


class WallClock:
    """CLOCK_MONOTONIC."""

    simulated = False

    def __init__(self, spin_ns: int = 0) -> None:
        """`spin_ns`: the last part of every sleep is spent looking at the clock, which is more exact than waking up."""
        self.spin_ns = spin_ns

    def now_ns(self) -> int:
        """Monotonic time."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """Sleep until the deadline; returns at once when it has passed."""
        left = deadline_ns - self.spin_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)  # CPython sleeps with clock_nanosleep on CLOCK_MONOTONIC
        while self.spin_ns and time.monotonic_ns() < deadline_ns:
            pass


def _page(system: str) -> Segment:
    segment = Segment(segment_name(system, "supervisor", "clock"), write=True)
    try:
        attach(segment, "clock", SCHEMA)
    except BaseException:
        segment.close()
        raise
    return segment


class LockstepClock:
    """Simulated time, as seen by one process."""

    simulated = True
    spin_ns = 0

    def __init__(self, system: str, pulse: Pulse) -> None:
        """Attach the clock page of `system`; `pulse` is the process's own control page (attached with write)."""
        self._segment = _page(system)
        first = self._segment.header.first
        at = (first + SCHEMA.offset("now_ns")) // 8
        self._now = self._segment.view.cast("q")[at : at + 1]
        self._tick = Futex(self._segment, first + SCHEMA.offset("tick"))
        self._turn = pulse.turn()
        self._done, self._next = pulse.field("done_ns"), pulse.field("next_ns")

    def now_ns(self) -> int:
        """Simulated time."""
        return int(self._now[0])

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """Say that everything due now is done, and wait until simulated time reaches the deadline (or `stopped()`)."""
        self.announce(deadline_ns)
        while True:
            tick = self._tick.value
            if self._now[0] >= deadline_ns or stopped():
                return
            self._tick.wait(tick, POLL_NS)

    def announce(self, deadline_ns: int) -> None:
        """Say that everything due now is done and when we want to go on, without waiting."""
        self._next[...] = deadline_ns
        self._done[...] = self._now[0]
        self._turn.wake()


def create_clock(system: str, make: Make = create) -> int:
    """Make the clock page; returns its size."""
    return make(segment_name(system, "supervisor", "clock"), "clock", SCHEMA, 1, {})


class Conductor:
    """The supervisor's end of lock-step: owns the clock page."""

    def __init__(self, system: str, make: Make = create) -> None:
        """Make the page and set simulated time to EPOCH_NS."""
        self.size = create_clock(system, make)
        self._segment = _page(system)
        first = self._segment.header.first
        at = (first + SCHEMA.offset("now_ns")) // 8
        self._now = self._segment.view.cast("q")[at : at + 1]
        self._tick = Futex(self._segment, first + SCHEMA.offset("tick"))
        self._now[0] = self._time_ns = EPOCH_NS
        self.held_up_by = ""  # who had not finished when `advance` was called last

    @property
    def now_ns(self) -> int:
        """Simulated time: our own copy, whatever was written into the page."""
        return self._time_ns

    def advance(self, players: list[Pulse], give_up_ns: int) -> bool:
        """One step: wait until every player has finished what was due, then go to the earliest wish.

        Returns False when somebody has not finished within `give_up_ns` real time; nothing was advanced then, and
        `held_up_by` says whom it was waiting for.
        """
        now, self.held_up_by = self.now_ns, ""
        wishes = []
        for player in players:
            if not _finished(player, now, give_up_ns):
                self.held_up_by = player.instance
                return False
            wishes.append(int(player.get("next_ns")))
        wish = min((w for w in wishes if w > now), default=now + 1_000_000)
        self._now[0] = self._time_ns = wish
        self._tick.wake()
        return True

    def close(self) -> None:
        """Unmap; the supervisor unlinks."""
        self._segment.close()


def _finished(player: Pulse, now_ns: int, give_up_ns: int) -> bool:
    turn = player.turn()
    end = time.monotonic_ns() + give_up_ns
    while True:
        value = turn.value
        if player.get("next_ns") > now_ns:  # whoever wants to go on later has finished, or was not due now
            return True
        left = end - time.monotonic_ns()
        if left <= 0:
            return False
        turn.wait(value, left)
