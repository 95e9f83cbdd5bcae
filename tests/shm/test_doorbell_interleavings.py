"""The doorbell's real code in every interleaving: nobody sleeps while there is something to see; and seeded mutants."""

from __future__ import annotations

import pytest

from tests.shm.interleave import Broken, Explorer, Outcome
from tests.shm.process import Actor, Program
from tests.shm.simulated import DATA_AT, FLAGS_AT, Change, Real, private

DATA = "page", DATA_AT
LONG = 10**12
TWO_PLACES: Change = "doorbell", "PLACES = 1", "PLACES = 2"


def ringer(real: Real, rounds: int, more: int = 0) -> Program:
    """Puts out 1 … `rounds`, ringing each time; and rings `more` times when all is quiet."""

    def run(me: Actor) -> None:
        bell = real.on(me).bell()
        for k in range(1, rounds + 1):
            me.store((DATA, k))  # E1
            bell.ring()
        if more:
            me.quiet()
        for _ in range(more):
            bell.ring()

    return run


def waiter(real: Real, rounds: int, predecessor: str = "") -> Program:
    """Waits for 1 … `rounds`."""

    def run(me: Actor) -> None:
        if predecessor:
            me.after(predecessor)
        place = real.on(me).waiter()
        me.private = lambda: place._flag.start
        for k in range(1, rounds + 1):
            while not place.wait(lambda k=k: me.load(DATA)[0] >= k, LONG):
                me.merge(k)
            me.note("heard", k)
            me.merge(k)

    return run


def awake(outcome: Outcome) -> None:
    """Nobody sleeps though all is out."""
    assert not outcome.asleep, f"{outcome.asleep} sleeps, though {outcome.cells[DATA]} is out"


def bell(real: Real, rounds: int, waiters: int = 1, model: str = "tso") -> Explorer:
    """A ringer, and waiters for all of its rounds."""
    waiting: dict[str, Program] = {f"waiter{i}": waiter(real, rounds) for i in range(waiters)}
    return Explorer({"ringer": ringer(real, rounds), **waiting}, awake, model=model)


def dying(real: Real, rounds: int, heir: bool = True) -> Explorer:
    """A waiter that may die at any step, and its successor."""
    programs = {"ringer": ringer(real, rounds, 3), "waiter": waiter(real, rounds)}
    if heir:
        programs["heir"] = waiter(real, rounds, "waiter")
    return Explorer(programs, taken_down, kill="waiter")


def taken_down(outcome: Outcome) -> None:
    """Besides, nobody's flag is up when all are gone."""
    awake(outcome)
    for place in (0, 1):
        assert not outcome.cells.get(("page", FLAGS_AT + place)), f"the flag of place {place} stays up"


def publisher(real: Real, rounds: int) -> Program:
    """Publishes 1 … `rounds` in a ring, ringing each time."""

    def run(me: Actor) -> None:
        ring, bell = real.on(me).writer(3), real.bell()
        for k in range(1, rounds + 1):
            ring.field("value")[...] = k
            ring.publish(k)
            bell.ring()

    return run


def subscriber(real: Real, rounds: int) -> Program:
    """Waits for newer records until it has the last."""

    def run(me: Actor) -> None:
        ring, place = real.on(me).reader(3), real.waiter()
        value, got = ring.field("value"), 0
        me.private = lambda: (private(ring), place._flag.start)
        while got < rounds:
            if place.wait(lambda had=got: ring.newest() and ring.sequence > had, LONG):
                got = ring.sequence
                assert int(value) == got, "torn"
            ring._record._bytes[:] = bytes(len(ring._record._bytes))
            me.merge()

    return run


@pytest.mark.parametrize(("rounds", "waiters", "states"), [(4, 1, 30_000), (1, 2, 8_000)])
def test_nobody_sleeps_while_there_is_something(rounds: int, waiters: int, states: int) -> None:
    assert bell(Real(*[TWO_PLACES] * (waiters - 1)), rounds, waiters).explore().states > states


def test_merging_leaves_no_schedule_out() -> None:
    slowly = bell(Real(), 2)
    slowly.merging = False
    assert slowly.explore().schedules == bell(Real(), 2).explore().schedules


@pytest.mark.slow
def test_a_dead_waiter_s_flag_is_taken_down_and_no_other() -> None:
    assert dying(Real(TWO_PLACES), 2).explore().states > 10_000
    assert dying(Real(), 3, heir=False).explore().states > 10_000


def test_a_ring_s_reader_can_sleep_at_the_bell() -> None:
    explorer = Explorer({"publisher": publisher(Real(), 2), "subscriber": subscriber(Real(), 2)}, awake)
    assert explorer.explore().states > 10_000


def test_the_bell_works_where_memory_keeps_no_order() -> None:
    assert bell(Real(fenced=True), 2, model="weak").explore().states > 1_000


D1, D2, E2 = "self._flag[0] = 1  # D1", "self._fence()  # D2", "self._fence()  # E2"
SLEEP = "self._futex.wait(value, timeout_ns)"
WAKE = "return int(SYSCALL(FUTEX, self._address, WAKE, ALL_WAITERS, None, None, 0))"
MUTANTS: dict[str, tuple[Change, ...]] = {
    "waiter without fence": (("doorbell", D2, "pass"),),
    "ringer without fence": (("doorbell", E2, "pass"),),
    "flag behind the look": (
        ("doorbell", D1, "pass"), ("doorbell", SLEEP, f"self._flag[0] = 1; self._fence(); {SLEEP}")),
    "counter read behind the look": (("doorbell", SLEEP, "self._futex.wait(self._futex.value, timeout_ns)"),),
    "counter not moved": (("doorbell", "self._word[0] = (self._word[0] + 1) & 0xFFFFFFFF", "pass"),),
    "nobody woken": (("doorbell", WAKE, "return 1"),),
    "flag of the living taken down": (("doorbell", "            if free:", "            if True:"),),
    "flag of the dead left up": (("doorbell", ">= UNHEARD", ">= 10 * UNHEARD"),),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_seeded_mutant_of_the_doorbell_is_caught(name: str) -> None:
    with pytest.raises(Broken, match=r"sleeps|stays up"):
        bell(Real(*MUTANTS[name]), 3).explore()
        dying(Real(*MUTANTS[name]), 3, heir=False).explore()
