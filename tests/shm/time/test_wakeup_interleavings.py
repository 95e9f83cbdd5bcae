"""The nap's real code in every interleaving: nobody sleeps while there is news; and seeded mutants."""

from __future__ import annotations

import pytest

from tests.shm.interleave import Broken, Explorer, Outcome
from tests.shm.process import Actor, Program
from tests.shm.simulated import Change, Real

pytestmark = pytest.mark.searches
LONG = 10**12


def waker(real: Real, name: str, rounds: int) -> Program:
    """Has `rounds` news of its own, one after the other."""

    def run(me: Actor) -> None:
        wakeup = real.on(me).wakeup()
        for k in range(1, rounds + 1):
            me.store(((name, 0), k))  # Q1
            wakeup.wake()

    return run


def sleeper(real: Real, rounds: dict[str, int]) -> Program:
    """Sleeps until it has seen all of everybody's news."""

    def run(me: Actor) -> None:
        wakeup = real.on(me).wakeup()
        me.private = lambda: 0
        seen = dict.fromkeys(rounds, 0)

        def news() -> bool:
            return any(me.load((name, 0))[0] > seen[name] for name in rounds)

        while seen != rounds:
            if wakeup.sleep(news, LONG):
                seen = {name: me.load((name, 0))[0] for name in rounds}
            me.merge(tuple(seen.values()))

    return run


def wakeup(real: Real, rounds: dict[str, int], model: str = "tso") -> Explorer:
    """One sleeper, and a waker for each name."""
    wakers = {name: waker(real, name, count) for name, count in rounds.items()}
    return Explorer({"sleeper": sleeper(real, rounds), **wakers}, woken, model=model)


def woken(outcome: Outcome) -> None:
    """It does not sleep though there is news."""
    assert not outcome.asleep, "it sleeps, though all is out"


@pytest.mark.parametrize(("rounds", "outcomes"), [({"io": 3}, 27), ({"io": 1, "client": 1}, 9)])
def test_nobody_sleeps_while_there_is_news(rounds: dict[str, int], outcomes: int) -> None:
    assert wakeup(Real(), rounds).explore().outcomes == outcomes


def test_merging_leaves_no_schedule_out() -> None:
    def schedules(merging: bool) -> int:
        explorer = wakeup(Real(), {"io": 2})
        explorer.merging, explorer.reducing = merging, False
        return explorer.explore().schedules

    assert schedules(False) == schedules(True)


def test_sleeps_work_where_memory_keeps_no_order() -> None:
    assert wakeup(Real(fenced=True), {"io": 2}, model="weak").explore().outcomes == 9


P2, Q2 = "self._fence()  # P2", "self._fence()  # Q2"
DROWSY: dict[str, Change] = {
    "sleeper without fence": ("wakeup", P2, "pass"),
    "waker without fence": ("wakeup", Q2, "pass"),
    "word left as it is": ("wakeup", "self._futex.value = 0  # Q4", "pass"),
    "nobody woken": ("wakeup", "self._futex.wake()", "pass"),
}


@pytest.mark.parametrize("name", DROWSY)
def test_a_seeded_mutant_of_the_nap_is_caught(name: str) -> None:
    with pytest.raises(Broken, match="sleeps"):
        wakeup(Real(DROWSY[name]), {"io": 3}).explore()
