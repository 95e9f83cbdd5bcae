"""Lock-step's real code in every interleaving: nobody oversleeps, nobody is left behind; and seeded mutants."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.shm.interleave import Broken, Explorer, Outcome
from tests.shm.process import Actor, Address, Program
from tests.shm.simulated import Change, Real
from trocar.shm.time.lockstep import SCHEMA, Table

pytestmark = [pytest.mark.slow, pytest.mark.searches]

Wishes = dict[str, tuple[int, ...]]
NEWS: Address = "news", 0
NOW = 4096 + SCHEMA.offset("now_ns")
LATER = 9


def begun(real: Real, me: Actor, name: str, table: Table) -> Any:
    """A member that time waits for."""
    member = real.on(me).member(name, table)
    me.private = lambda: 0
    return member


def going(me: Actor, key: object) -> bool:
    """Not stopped; how we came here does not matter."""
    me.merge(key)
    return False


def leave(steps: Any, place: int) -> None:
    """What the supervisor does when a member has ended: time does not wait for it any more."""
    steps.words[steps._active[place]] = 0
    steps._fence()
    steps.advance()
    steps._wake_due()


def sleeper(real: Real, name: str, table: Table, wishes: tuple[int, ...], wakes: str = "") -> Program:
    """Sleeps until each of these instants; after the first it has news for another member."""

    def run(me: Actor) -> None:
        member = begun(real, me, name, table)
        for wish in wishes:
            member.sleep_until(wish, partial(going, me, wish))
            me.note(member.now_ns())
            if wakes and wish == wishes[0]:
                me.store((NEWS, 1))
                member._wakeups[table.members.index(wakes)].wake()
        leave(member, member._place)

    return run


def hearer(real: Real, name: str, table: Table, wishes: tuple[int, ...] = ()) -> Program:
    """Sleeps until each of these instants, then for long, or until there is news."""

    def run(me: Actor) -> None:
        member = begun(real, me, name, table)
        for wish in wishes:
            member.sleep_until(wish, partial(going, me, wish))
            me.note(member.now_ns())
        member.sleep_until(LATER, partial(going, me, 0), lambda: me.load(NEWS)[0] == 1)
        me.note(member.now_ns())
        leave(member, member._place)

    return run


def supervisor(real: Real, table: Table, mortal: str) -> Program:
    """Drops a member that died."""

    def run(me: Actor) -> None:
        real.on(me)
        me.after(mortal)
        leave(real.keeper(table), table.members.index(mortal))

    return run


def admitted(real: Real, table: Table) -> dict[Address, int]:
    at = 4096 + int(real.lockstep.SCHEMA.offset("active"))
    return {("clock", at + 8 * place): 1 for place in range(len(table.members))}


def on_time(wishes: Wishes, outcome: Outcome) -> None:
    """Nobody sleeps for ever, and each woke at its time. Who died may have left somebody to the end of its sleep."""
    now = outcome.cells["clock", NOW]
    for name in outcome.asleep:
        assert outcome.killed and now >= wishes[name][0], f"{name} sleeps though nobody is awake"
    for name, wanted in wishes.items():
        if name not in (*outcome.killed, *outcome.asleep):
            assert outcome.notes[name] == tuple((wish,) for wish in wanted), f"{name} woke at {outcome.notes[name]}"


def lockstep(real: Real, wishes: Wishes, kill: str = "") -> Explorer:
    """Members that sleep until their wishes; one may die."""
    table = Table(tuple(wishes))
    programs = {name: sleeper(real, name, table, wanted) for name, wanted in wishes.items()}
    if kill:
        programs["supervisor"] = supervisor(real, table, kill)
    return Explorer(programs, partial(on_time, wishes), kill=kill, before=admitted(real, table))


def news(real: Real, third: bool = False) -> Explorer:
    """io has news for the console at 1, while the arm, if there is one, wants to go on at 2."""
    wishes: Wishes = {"console": (1,), "io": (1, 3)} | ({"arm": (2,)} if third else {})
    table = Table(tuple(wishes))
    programs = {name: sleeper(real, name, table, wanted, "console" if name == "io" else "")
                for name, wanted in wishes.items() if name != "console"}
    programs["console"] = hearer(real, "console", table)
    return Explorer(programs, partial(on_time, wishes), before=admitted(real, table))


def news_for_who_is_awake(real: Real) -> Explorer:
    """io has news for the console at 1, when the console is awake as well and about to fall asleep."""
    wishes: Wishes = {"console": (1, 1), "io": (1, 3)}
    table = Table(tuple(wishes))
    programs = {"io": sleeper(real, "io", table, wishes["io"], "console"),
                "console": hearer(real, "console", table, wishes["console"][:1])}
    return Explorer(programs, partial(on_time, wishes), before=admitted(real, table))


def test_two_who_wake_together_wait_for_each_other() -> None:
    assert lockstep(Real(), {"A": (1,), "B": (1,)}).explore().outcomes == 323


def test_who_has_news_holds_time_until_it_was_heard() -> None:
    assert news(Real()).explore().outcomes == 4_130


def test_who_falls_asleep_hears_at_once_what_was_said_while_it_was_awake() -> None:
    assert news_for_who_is_awake(Real()).explore().outcomes == 2_372


def test_everybody_wakes_at_its_time() -> None:
    assert lockstep(Real(), {"A": (1, 2), "B": (2,)}).explore().outcomes == 4_681


def test_a_death_at_any_step_leaves_nobody_behind() -> None:
    assert lockstep(Real(), {"A": (1,), "B": (1,)}, kill="B").explore().outcomes == 1_287


COUNT = "words[self._finished[place]] = (words[self._finished[place]] + 1) % WORDS  # F2"
TOGETHER = partial(lockstep, wishes={"A": (1,), "B": (1,)})
APART = partial(lockstep, wishes={"A": (1, 2), "B": (2,)})
MUTANTS: dict[str, tuple[Callable[[Real], Explorer], tuple[Change, ...]]] = {  # and the search that finds it first
    "asleep before the wish is out": (TOGETHER, (
        ("lockstep", "words[self._next[place]] = deadline_ns if news is None else 0  # F3", "pass"),
        ("lockstep", "wakeup.begin()  # F4", "wakeup.begin(); words[self._next[place]] = deadline_ns"))),
    "wish before the count": (news, (
        ("lockstep", COUNT, "words[self._next[place]] = deadline_ns"),
        ("lockstep", "words[self._next[place]] = deadline_ns if news is None else 0  # F3",
         "words[self._finished[place]] += 1"))),
    "falling asleep without fence": (TOGETHER, (("wakeup", "self._fence()  # P2", "pass"),)),
    "nobody is woken": (APART, (
        ("lockstep", "            if wish:\n                self._wake_due()", "            pass"),)),
    "no lock": (APART, (("lockstep", "if not self._lock.take(0):", "if False:"),)),
    "two looks that may differ": (news, (("lockstep", "if wish and seen == again:", "if wish:"),)),
    "no look after the lock": (APART, (("lockstep", "while self._wish(seen):  # A1", "if self._wish(seen):"),)),
    "time goes on while somebody looks": (news_for_who_is_awake, (
        ("lockstep", "deadline_ns if news is None else 0  # F3", "deadline_ns"),)),
    "who has looked hides it": (news, (
        ("lockstep", "                    self._fence()\n                early", "                early"),)),
    "time goes past who is awake": (news, (("lockstep", "if not wakeup.sleeps:", "if False:"),)),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_seeded_mutant_of_lock_step_is_caught(name: str) -> None:
    search, changes = MUTANTS[name]
    with pytest.raises(Broken):
        search(Real(*changes)).explore()
