"""Lock-step: simulated time that its members advance themselves, without a conductor.

Every member stores its next wake time ("wish") and sleeps (shm/time/wakeup.py, in its control page). When all members
sleep and none is due, time advances to the earliest wish; any member that sees this does it, usually the last to fall
asleep. A process with news for a member wakes that member, and time stops until it sleeps again. One member may be a
server, which sleeps at its sockets; some members send to it without waiting, so they wake it before they sleep.

Finish:  F1 a client of the server wakes it  F2 finished + 1   F3 next := wish, or 0 (due) to look for news
         F4 fall asleep (word := 1, full fence)   F5 time reached, or news? then awake, done   F6 after the look:
         next := wish, full fence   F7 advance   F8 wait while the word is 1, bounded; then awake: from F2
Serve:   the same, but at its sockets: before F2 and in F5 it answers until no request waits there
Advance: A1 is any member awake or due? then done; remember all values of `finished`
         A2 take the lock; if taken, its holder does A6 after our look, or A4 applies: done
         A3 as A1, and `finished` unchanged    A4 beyond the limit (shm/time/held_time.py), or paced and
         too early? done, returning when to look again
         A5 now := the earliest wish    A6 release the lock, full fence, wake all that are due, from A1

Only awake members wake others (except clients, which come at any time). A member with news for an awake one, which
needs no waking, may be asleep before that one looks: that one looks while its wish is not out, and time is stopped
until F6. A1 alone may see A asleep, then B, which woke A in between: with A3 all slept at the moment between the two.
If two fall asleep at the same time, at least one sees that both do (F4 or F6, A1), or the lock's holder does (A6). F2,
F3 and F4 are stored in this order and loaded in the opposite one: a new wish is never taken for that of an earlier
sleep. The kernel frees the lock when its holder ends. Sleeps are bounded, and the supervisor repeatedly looks and
wakes: a crash between A2 and the end of A6 costs no more.
"""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.locks import Places
from trocar.shm.memory.order import full_fence
from trocar.shm.memory.rows import Field, Topic
from trocar.shm.memory.segment import Make, Segment, SegmentError, create, segment_name
from trocar.shm.ring.ring import attach
from trocar.shm.time.clock import local_ns, monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.wakeup import Wakeup

MEMBERS: Final = 64
EPOCH_NS: Final = 1_000_000_000_000  # start of simulated time: differences stay positive, and it is easy to recognise
POLL_NS: Final = 100_000_000
PACE_NS: Final = 1_000_000  # paced: minimum wait for real time; several steps then follow at once
BEHIND_NS: Final = 5_000_000  # a larger delay behind real time is not made up for
NEVER: Final = 1 << 62
WORDS: Final = 1 << 64  # their number

PAGE = Topic("clock", writer="supervisor", depth=1, fields=(
    Field("now_ns", "<u8", "ns", "simulated time (W: who has the lock)"),
    Field("monotonic_ns", "<u8", "ns", "CLOCK_MONOTONIC when it was last advanced (W: who has the lock)"),
    Field("local_ns", "<u8", "ns", "CLOCK_REALTIME at that moment (W: who has the lock)"),
    Field("advances", "<u8", "", "counts them (W: who has the lock)"),
    Field("base_ns", "<u8", "ns", "paced: simulated time that belongs to (W: who has the lock)"),
    Field("base_monotonic_ns", "<u8", "ns", "paced: this real time (W: who has the lock)"),
    Field("speed", "<f8", "", "simulated over real time in the last second (W: supervisor)"),
    Field("active", f"({MEMBERS},)<u8", "", "1: time waits for this member (W: supervisor)"),
    Field("next_ns", f"({MEMBERS},)<u8", "ns", "when it resumes (W: member; of a dead one: supervisor)"),
    Field("finished", f"({MEMBERS},)<u8", "", "times it went to sleep (W: member)"),
    Field("limit_ns", "<u8", "ns", "time does not go beyond; 0: it may (W: supervisor, or who holds it back)"),
))
SCHEMA = schema_of(PAGE)


@dataclass(frozen=True, slots=True)
class Table:
    """The members: names in the order of their places; the server among them, and its clients."""

    members: tuple[str, ...]
    server: str = ""
    asking: tuple[str, ...] = ()
    paced: bool = False

    def to_info(self) -> dict[str, Any]:
        """As the page's header carries it."""
        return {"members": list(self.members), "server": self.server, "asking": list(self.asking), "paced": self.paced}

    @staticmethod
    def of_info(info: Mapping[str, Any]) -> Table:
        """The opposite; SegmentError for invalid info."""
        try:
            members = tuple(map(str, info["members"]))
            return Table(members[:MEMBERS], str(info["server"]), tuple(map(str, info["asking"])), bool(info["paced"]))
        except (KeyError, TypeError) as error:
            raise SegmentError(f"the clock page does not say who takes part: {error}") from None


def create_clock(system: str, table: Table, make: Make = create) -> int:
    """Make the clock page; returns its size. SegmentError: too many members."""
    if len(table.members) > MEMBERS:
        raise SegmentError(f"{len(table.members)} members of simulated time; allowed are {MEMBERS}")
    return make(segment_name(system, "supervisor", "clock"), "clock", SCHEMA, 1, table.to_info())


def clock_page(system: str, *, write: bool = False) -> Segment:
    """Attach the clock page; SegmentError if there is none."""
    segment = Segment(segment_name(system, "supervisor", "clock"), write=write)
    try:
        attach(segment, "clock", SCHEMA)
    except BaseException:
        segment.close()
        raise
    return segment


class Steps:
    """The page as members and supervisor share it: time, whose turn it is, and the step to the next instant."""

    def __init__(self, segment: Segment, wakeups: Sequence[Wakeup], wake_server: Callable[[], object]) -> None:
        """`segment` is the page, attached with write; `wakeups` those of the members, in the order of their places."""
        self.table = table = Table.of_info(segment.header.info)
        self.segment, self._wakeups, self._wake_server = segment, wakeups, wake_server
        first = segment.header.first

        def at(field: str) -> int:
            return (first + SCHEMA.offset(field)) // 8

        self.words = segment.words()
        self._now, self._stamps = at("now_ns"), (at("monotonic_ns"), at("local_ns"), at("advances"))
        self._base, self._limit = (at("base_ns"), at("base_monotonic_ns")), at("limit_ns")
        places = range(len(table.members))
        self._active, self._next, self._finished = ([at(field) + i for i in places]
                                                    for field in ("active", "next_ns", "finished"))
        self._rows = tuple(zip(self._active, wakeups, self._next, self._finished, strict=True))
        self._server = table.members.index(table.server) if table.server in table.members else -1
        self._place = -1  # our place, if we are a member
        self._lock = Places(segment, first + SCHEMA.offset("now_ns"), 1)
        self._fence = full_fence()

    def now_ns(self) -> int:
        """Simulated time."""
        return min(self.words[self._now], NEVER)

    def advance(self) -> int:
        """Go to the next instant if all sleep until then; returns ns until the next useful try, 0: others will do it,
        NEVER: all sleep, and it is beyond the limit.
        """
        seen: list[int] = []
        again: list[int] = []
        while self._wish(seen):  # A1
            if not self._lock.take(0):  # A2
                return PACE_NS
            early = wish = 0
            try:
                wish = self._wish(again)  # A3
                if wish and seen == again:
                    early = self._early(wish)  # A4
                    if not early:
                        self._go(wish)
            finally:
                self._lock.give_back(0)  # A6
            if early:
                return early
            if wish:
                self._wake_due()
        return 0

    def _wish(self, finished: list[int]) -> int:
        """The next instant, or 0 if a member is awake or due, or none takes part; and each member's count of sleeps."""
        words, wish = self.words, NEVER
        finished.clear()
        now = words[self._now]
        for active, wakeup, at, count in self._rows:
            if words[active]:
                if not wakeup.sleeps:
                    return 0
                wanted = words[at]
                if wanted <= now:
                    return 0
                wish = min(wish, wanted)
                finished.append(words[count])
        return 0 if wish == NEVER else wish

    def _early(self, wish: int) -> int:
        if 0 < self.words[self._limit] < wish:
            return NEVER
        if not self.table.paced:
            return 0
        words, (base, base_real), real = self.words, self._base, monotonic_ns()
        ahead = (wish - words[base]) - (real - words[base_real])
        if ahead > 0:
            return max(ahead, PACE_NS)
        if ahead < -BEHIND_NS:
            words[base], words[base_real] = wish, real
        return 0

    def _go(self, wish: int) -> None:
        words, (monotonic, local, advances) = self.words, self._stamps
        words[monotonic], words[local] = monotonic_ns(), local_ns()
        words[advances] = (words[advances] + 1) % WORDS
        words[self._now] = wish  # A5

    def _wake_due(self) -> None:
        self._fence()
        now = self.words[self._now]
        for place, at in enumerate(self._next):
            if self.words[at] <= now and place != self._place:
                self._wake(place)

    def _wake(self, place: int) -> None:
        if self._wakeups[place].wake_after_fence() and place == self._server:
            self._wake_server()

    def close(self) -> None:
        """Unmap."""
        self.segment.close()


class Member(Steps):
    """One member's end."""

    def __init__(self, segment: Segment, wakeups: Sequence[Wakeup], wake_server: Callable[[], object],
                 name: str) -> None:
        """The member is awake and due."""
        super().__init__(segment, wakeups, wake_server)
        self._place = place = self.table.members.index(name)
        self._own, self._asks = wakeups[place], name in self.table.asking and self._server >= 0
        self.words[self._next[place]] = 0
        self._own.end()

    def join(self, stopped: Callable[[], bool]) -> None:
        """Wait until the supervisor admits us to simulated time, or `stopped()`: earlier instants are not late."""
        active = self._active[self._place]
        while not self.words[active] and not stopped():
            self._own.sleep(lambda: self.words[active] == 1, POLL_NS)

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool],
                    news: Callable[[], bool] | None = None) -> bool:
        """All due now is done: wait until the deadline, `stopped()`, or `news()`; returns whether there was any."""
        return self._sleep(deadline_ns, stopped, news, self._own.wait)

    def serve_until(self, deadline_ns: int, stopped: Callable[[], bool], serve: Callable[[int], bool]) -> None:
        """As `sleep_until`, for the server. `serve(timeout_ns)` answers all requests at its sockets and returns whether
        there were any; without requests it waits up to this timeout for one or for the server's wake-up.
        """
        while serve(0):
            pass
        while self._sleep(deadline_ns, stopped, partial(serve, 0), serve):
            while serve(0):
                pass

    def _sleep(self, deadline_ns: int, stopped: Callable[[], bool], news: Callable[[], bool] | None,
               wait: Callable[[int], object]) -> bool:
        words, now, wakeup, place = self.words, self._now, self._own, self._place
        if words[now] >= deadline_ns:
            return False
        if self._asks:
            self._fence()
            self._wake(self._server)  # F1
        while not stopped():
            words[self._finished[place]] = (words[self._finished[place]] + 1) % WORDS  # F2
            words[self._next[place]] = deadline_ns if news is None else 0  # F3
            wakeup.begin()  # F4
            try:
                if words[now] >= deadline_ns:
                    return False
                if news is not None:
                    if news():  # F5
                        return True
                    words[self._next[place]] = deadline_ns  # F6
                    self._fence()
                early = self.advance()  # F7
                if words[now] < deadline_ns and wakeup.sleeps:
                    wait(min(early or POLL_NS, POLL_NS))  # F8
            finally:
                wakeup.end()
            if words[now] >= deadline_ns:
                return False
            if news is not None and news():
                return True
        return False


class LockstepClock(Member):
    """Simulated time, as seen by one process."""

    simulated = True
    spin_ns = 0

    def __init__(self, system: str, name: str) -> None:
        """Take the place of instance `name`; SegmentError: there is no page or no such place."""
        segment = clock_page(system, write=True)
        try:
            table = Table.of_info(segment.header.info)
            if name not in table.members:
                raise SegmentError(f"{name} is no member of the simulated time of {system}")
            super().__init__(segment, wakeups_of(system, table, segment), waker_of(system, table, segment), name)
            self.wakeup: socket.socket | None = None
            """Wakes the server, besides its own sockets."""
            if name == table.server:
                self.wakeup = _datagrams(segment)
                self.wakeup.bind(_address(system))
        except BaseException:
            segment.close()
            raise


class Timekeeper(Steps):
    """The supervisor's end: it makes the page and decides for which members time waits."""

    def __init__(self, system: str, table: Table, make: Make = create) -> None:
        """Make the page and set simulated time to EPOCH_NS; the members' control pages are there."""
        self.size = create_clock(system, table, make)
        segment = clock_page(system, write=True)
        try:
            super().__init__(segment, wakeups_of(system, table, segment), waker_of(system, table, segment))
        except BaseException:
            segment.close()
            raise
        self.words[self._base[0]], self.words[self._base[1]] = EPOCH_NS, monotonic_ns()
        self._go(EPOCH_NS)
        self._speed = self.segment.view.cast("d")
        self.segment.at_close(self._speed.release)
        self._speed_at = (self.segment.header.first + SCHEMA.offset("speed")) // 8
        self._before, self._holds = (EPOCH_NS, monotonic_ns()), False
        self.holder = Places(segment, segment.header.first + SCHEMA.offset("limit_ns"), 1)
        """Taken by a program from outside that holds time back."""

    def hold(self, holds: bool) -> None:
        """Stop time, or let it run again unless a program holds it back."""
        self._holds = holds
        self.words[self._limit] = self.now_ns() if holds else self.words[self._limit]

    def admit(self, ready: Sequence[str]) -> None:
        """Time waits for exactly these members."""
        for place, name in enumerate(self.table.members):
            is_in = name in ready
            if is_in != bool(self.words[self._active[place]]):
                if not is_in:
                    self.words[self._next[place]] = 0
                self.words[self._active[place]] = int(is_in)
                self._fence()
                self._wake(place)

    def let_pass(self, seconds: float) -> None:
        """Sleep this long in real time, and keep time advancing if a member ended before it could do so."""
        if self.words[self._limit] and not self._holds and self.holder.take(0):  # the program that held it has ended
            self.words[self._limit] = 0
            self.holder.give_back(0)
        self.advance()
        self._wake_due()
        pause(seconds)
        self._measure()

    def _measure(self) -> None:
        now, real = self.now_ns(), monotonic_ns()
        if real - self._before[1] >= 1_000_000_000:
            self._speed[self._speed_at] = (now - self._before[0]) / (real - self._before[1])
            self._before = now, real


def wait_for_wakeup(files: Sequence[int], wakeup: socket.socket | None, timeout_ns: int) -> list[int]:
    """Those of `files` that can be read; waits at most this long for one or for the wakeup, which is drained."""
    watched = [*files, wakeup.fileno()] if wakeup is not None else files
    ready = select.select(watched, (), (), max(timeout_ns, 0) * 1e-9)[0]
    if wakeup is not None and wakeup.fileno() in ready:
        ready.remove(wakeup.fileno())
        with contextlib.suppress(OSError):
            while True:
                wakeup.recv(16)
    return ready


def wakeups_of(system: str, table: Table, segment: Segment) -> list[Wakeup]:
    """Those of all members; closed with the segment."""
    pages = []
    for member in table.members:
        pages.append(ControlPage(system, member, write=True))
        segment.at_close(pages[-1].close)
    return [page.wakeup() for page in pages]


def waker_of(system: str, table: Table, segment: Segment) -> Callable[[], object]:
    """How the server is woken: by a datagram, because it waits at sockets. Closed with the segment."""
    if not table.server:
        return lambda: None
    sender, address = _datagrams(segment), _address(system)

    def wake() -> None:
        with contextlib.suppress(OSError):  # it is gone, or has enough of them
            sender.sendto(b"", address)

    return wake


def _datagrams(segment: Segment) -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    segment.at_close(made.close)
    made.setblocking(False)
    return made


def _address(system: str) -> str:
    return f"\0trocar~{system}~step"
