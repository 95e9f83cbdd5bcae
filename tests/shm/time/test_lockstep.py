"""Simulated time that its members advance: nobody is left behind, nobody held up for ever; and paced by real time."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.time.lockstep import BEHIND_NS, EPOCH_NS, LockstepClock, Table, Timekeeper, wait_for_wakeup

MS = 1_000_000
PLAYER = """
import sys
from trocar.shm.time.lockstep import LockstepClock
clock = LockstepClock(sys.argv[1], sys.argv[2])
period, count = int(sys.argv[3]), int(sys.argv[4])
deadline = clock.now_ns()
seen = []
for _ in range(count):
    deadline += period
    clock.sleep_until(deadline, lambda: False)
    seen.append(clock.now_ns())
print(*seen, flush=True)
sys.stdin.read()
"""
Make = Callable[..., Timekeeper]


@pytest.fixture
def keeper(world: Any) -> Iterator[Make]:
    """Makes the clock of these members."""
    made: list[Timekeeper] = []

    def make(*members: str, **settings: Any) -> Timekeeper:
        for name in members:
            create_control(world.name, name)
        made.append(Timekeeper(world.name, Table(members, **settings)))
        return made[0]

    yield make
    made[0].close()
    world.remove()


def forever() -> bool:
    return False


def once() -> Callable[[], bool]:
    """Stopped at the second look."""
    looks = iter((False,))
    return lambda: next(looks, True)


@pytest.mark.slow
def test_two_processes_advance_exactly_in_lock_step(world: Any, keeper: Make) -> None:
    time_ = keeper("A", "B")
    time_.admit(["A", "B"])
    periods = {"A": (MS, 30), "B": (2_500_000, 12)}
    players = {name: world.start(PLAYER, name, str(period), str(count)) for name, (period, count) in periods.items()}
    for name, (period, count) in periods.items():
        seen = [int(t) for t in players[name].stdout.readline().split()]
        assert seen == [EPOCH_NS + k * period for k in range(1, count + 1)]
        time_.admit(list(periods)[1:])
        time_.let_pass(0.001)
    for player in players.values():
        world.finish(player)
    assert time_.now_ns() == EPOCH_NS + 30 * MS and time_.words[time_._stamps[2]] == 1 + 30 + 6


def test_time_stands_while_a_member_works(world: Any, keeper: Make) -> None:
    time_ = keeper("A", "B")
    time_.admit(["A", "B"])
    one, other = LockstepClock(world.name, "A"), LockstepClock(world.name, "B")
    one.sleep_until(EPOCH_NS + MS, once())
    assert one.now_ns() == EPOCH_NS, "B is awake"
    time_.admit(["A"])
    one.sleep_until(EPOCH_NS + MS, forever)
    assert other.now_ns() == EPOCH_NS + MS, "nobody waits for B any more"
    for clock in (one, other):
        clock.close()


@pytest.mark.slow
def test_a_dead_member_is_dropped_and_the_others_go_on(world: Any, keeper: Make) -> None:
    time_ = keeper("A", "B")
    time_.admit(["A", "B"])
    for name in "AB":
        world.start(PLAYER, name, str(MS), "100000000")
    world.until(lambda: time_.now_ns() > EPOCH_NS + 20 * MS, "time goes on")
    world.kill(world.children[0])
    stands = time_.now_ns()
    world.until(lambda: time_._wakeups[1].sleeps and time_.words[time_._next[1]] > time_.now_ns(), "the other waits")
    time_.advance()
    assert time_.now_ns() <= stands + MS, "the other may still go to where the dead one would have woken"
    time_.admit(["B"])
    time_.let_pass(0.001)
    world.until(lambda: time_.now_ns() > stands + 20 * MS, "time goes on")
    world.kill(world.children[1])


def test_who_is_woken_runs_before_time_goes_on(world: Any, keeper: Make) -> None:
    time_ = keeper("A", "B")
    one, other = LockstepClock(world.name, "A"), LockstepClock(world.name, "B")
    time_.admit(["A", "B"])
    other.sleep_until(EPOCH_NS + MS, once())
    other._own.begin()  # as it is while it sleeps
    page = ControlPage(world.name, "B", write=True)
    page.wakeup().wake()
    one.sleep_until(EPOCH_NS + MS, once())
    assert one.now_ns() == EPOCH_NS
    assert other.sleep_until(EPOCH_NS + MS, forever, lambda: True), "there was news"
    for part in (one, other, page):
        part.close()


def test_a_stopped_member_does_not_wait_for_time(world: Any, keeper: Make) -> None:
    keeper("A").admit(["A"])
    clock = LockstepClock(world.name, "A")
    clock.sleep_until(EPOCH_NS + 10**12, lambda: True)
    assert clock.simulated and clock.now_ns() == EPOCH_NS
    clock.close()


def test_the_server_answers_before_it_takes_a_new_time(world: Any, keeper: Make) -> None:
    time_ = keeper("boards", "IO1", server="boards", asking=("IO1",))
    boards, io = LockstepClock(world.name, "boards"), LockstepClock(world.name, "IO1")
    time_.admit(["boards", "IO1"])
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard: list[tuple[bytes, int]] = []

    def serve(timeout_ns: int) -> bool:
        ready = wait_for_wakeup([ours.fileno()], boards.wakeup, timeout_ns)
        if ready:
            heard.append((ours.recv(9), boards.now_ns()))
        return bool(ready)

    for k in range(1, 4):
        boards.serve_until(EPOCH_NS + k * MS, once(), serve)  # leaves a wish, and its sockets alone
        boards._own.begin()
        theirs.send(b"write %d" % k)
        io.sleep_until(EPOCH_NS + k * MS, once())
        assert io.now_ns() == EPOCH_NS + (k - 1) * MS, "the server was woken, and has not slept since"
        boards.serve_until(EPOCH_NS + k * MS, once(), serve)
        io.sleep_until(EPOCH_NS + k * MS, once())
        boards._own.begin()
        while io.now_ns() < EPOCH_NS + k * MS:
            io._own.begin()
            io.advance()
        io._own.end()
    assert heard == [(b"write %d" % k, EPOCH_NS + (k - 1) * MS) for k in range(1, 4)]
    for part in (boards, io, ours, theirs):
        part.close()


def test_the_server_alone_still_serves_its_sockets(world: Any, keeper: Make) -> None:
    keeper("boards", server="boards").admit(["boards"])
    boards = LockstepClock(world.name, "boards")
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    answered = 0

    def serve(timeout_ns: int) -> bool:
        nonlocal answered
        ready = wait_for_wakeup([ours.fileno()], boards.wakeup, timeout_ns)
        if ready:
            answered += len(ours.recv(9))
        return bool(ready)

    for k in range(1, 20):
        theirs.send(b"?")
        boards.serve_until(EPOCH_NS + k * MS, forever, serve)
        assert (answered, boards.now_ns()) == (k, EPOCH_NS + k * MS)
    for part in (boards, ours, theirs):
        part.close()


def test_a_sleeping_server_is_woken_by_a_datagram(world: Any, keeper: Make) -> None:
    time_ = keeper("boards", "IO1", server="boards")
    boards = LockstepClock(world.name, "boards")
    boards._own.begin()
    time_._wake(0)
    assert boards.wakeup is not None and select.select([boards.wakeup], (), (), 1.0)[0]
    assert wait_for_wakeup([], boards.wakeup, 0) == [] and not select.select([boards.wakeup], (), (), 0)[0]
    boards.close()


def test_paced_time_is_never_faster_than_real_time(world: Any, keeper: Make) -> None:
    begin = monotonic_ns()
    keeper("A", paced=True).admit(["A"])
    clock = LockstepClock(world.name, "A")
    for k in range(1, 300):
        clock.sleep_until(EPOCH_NS + k * MS // 3, forever)
        assert clock.now_ns() - EPOCH_NS <= monotonic_ns() - begin
    clock.close()


def test_paced_time_does_not_sprint_after_a_delay(world: Any, keeper: Make) -> None:
    time_ = keeper("A", paced=True)
    time_.admit(["A"])
    clock = LockstepClock(world.name, "A")
    clock.sleep_until(EPOCH_NS + MS, forever)
    time_.words[time_._base[1]] -= 200 * MS  # so much real time has passed since
    begin, simulated = monotonic_ns(), clock.now_ns()
    for k in range(2, 60):
        clock.sleep_until(EPOCH_NS + k * MS, forever)
        assert clock.now_ns() - simulated <= monotonic_ns() - begin + BEHIND_NS + MS
    clock.close()


def test_the_page_says_what_real_time_belongs_to_it(world: Any, keeper: Make) -> None:
    time_ = keeper("A")
    time_.admit(["A"])
    clock = LockstepClock(world.name, "A")
    before = monotonic_ns(), time.time_ns()
    clock.sleep_until(EPOCH_NS + MS, forever)
    monotonic, local = (clock.words[at] for at in clock._stamps[:2])
    assert before[0] <= monotonic <= monotonic_ns() and before[1] <= local <= time.time_ns()
    clock.close()


def test_who_joins_waits_until_time_waits_for_it(world: Any, keeper: Make) -> None:
    time_ = keeper("A")
    clock = LockstepClock(world.name, "A")
    looks = iter((False, False, True))

    def stopped() -> bool:
        time_.admit(["A"])
        return next(looks)

    clock.join(stopped)
    assert next(looks) is False, "admitted after the first look"
    clock.close()


def test_who_is_no_member_is_refused(world: Any, keeper: Make) -> None:
    keeper("A")
    with pytest.raises(SegmentError, match="gui is no member"):
        LockstepClock(world.name, "gui")
