"""The place for stops in every interleaving of the real code: two who stop, deaths of all; and seeded mutants."""

from __future__ import annotations

from typing import Any

import pytest

from tests.shm.interleave import Broken, Explorer, Outcome
from tests.shm.mailbox.test_mailbox_interleavings import ONE_REPLY, SAYS, owner
from tests.shm.process import Actor, Program
from tests.shm.simulated import Change, Real, private

pytestmark = pytest.mark.searches
STOPS = {"one": 1000, "other": 2000, "last": 3000}


def stopper(real: Real, who: str, count: int = 1, *, width: int = 1, previous_state: str = "", heir: bool = False
            ) -> Program:
    """Stops so many times; without an heir polls for a last time when all is quiet.

    Its nth stop has the value 1000 (2000…) + n, `width` times.
    """

    def run(me: Actor) -> None:
        if previous_state:
            me.after(previous_state)
        stops = real.on(me).stopper()
        me.private = lambda: private(stops)
        for n in range(1, count + 1):
            value = STOPS[who] + n
            me.note("asks", value)
            try:
                number = stops.stop("power_off", [value] * width)
            except (real.place.MailboxFull, real.place.SegmentError) as error:
                me.note("kept out", type(error).__name__)
            else:
                me.note("sent", (-number, value))
            me.merge(n)
        if heir:
            return
        me.quiet()
        for reply in stops.answers():
            assert reply.text == (SAYS.get(reply.outcome) or str(-reply.id)), f"torn: {reply}"
            me.note("reported", (-reply.id, reply.outcome))
        me.note("lost", stops.lost)

    return run


def judge(outcome: Outcome) -> None:
    """Every stop that was sent ran once, and who sent it was told what became of it, as long as nobody died."""
    asked, sent, ran = outcome.all("asks"), dict(outcome.all("sent")), [value for _, value in outcome.all("ran")]
    assert len(sent) == len(outcome.all("sent")), f"a number was given twice: {outcome.all('sent')}"
    assert set(ran) <= set(asked) and len(ran) == len(set(ran)), f"asked {asked}, ran {ran}"
    if set(outcome.killed) & {"owner"}:
        return
    assert set(sent.values()) <= set(ran), f"sent {sent}, ran {ran}"
    for name in set(STOPS) & set(outcome.notes) - set(outcome.killed):
        mine = [note[1][0] for note in outcome.notes[name] if note[0] == "sent"]
        reported = [note[1] for note in outcome.notes[name] if note[0] == "reported"]
        lost = [note[1] for note in outcome.notes[name] if note[0] == "lost"]  # of who has listened to the end
        assert {n for n, _ in reported} <= set(mine), f"{name} sent {mine} and was told {reported}"
        assert len(reported) == len(mine) or any(lost) or not lost, f"{name} sent {mine} and was told {reported}"


def two(real: Real, *, kill: str = "", rounds: int = 1, stops: int = 1, width: int = 1, heir: bool = False,
        refuses: bool = False) -> Explorer:
    """An owner and two who stop, at the same time or, as an `heir`, one when the other is gone."""
    programs = {"owner": owner(real, rounds, numbered=False)}
    if kill == "owner":
        programs["heir"] = owner(real, rounds, "owner", refuses, False)
    programs["one"] = stopper(real, "one", stops, width=width, heir=heir)
    programs["other"] = stopper(real, "other", width=width, previous_state="one" if heir else "")
    return Explorer(programs, judge, kill=kill)


def test_two_who_stop_at_once_are_both_heard() -> None:
    assert two(Real(), rounds=0).explore().outcomes == 10


@pytest.mark.slow
def test_two_who_stop_while_their_owner_looks_are_both_heard() -> None:
    assert two(Real()).explore().outcomes == 188


@pytest.mark.slow
def test_who_dies_in_the_place_for_stops_leaves_it_usable() -> None:
    assert two(Real(), kill="one", heir=True).explore().outcomes == 188


@pytest.mark.slow
def test_a_death_in_the_place_for_stops_does_not_keep_another_from_it() -> None:
    assert two(Real(), kill="one", rounds=0).explore().outcomes == 89


@pytest.mark.slow
@pytest.mark.parametrize(("refuses", "outcomes"), [(False, 286), pytest.param(True, 515, marks=pytest.mark.soak)])
def test_an_owner_that_dies_runs_no_stop_twice(refuses: bool, outcomes: int) -> None:
    assert two(Real(), kill="owner", heir=True, refuses=refuses).explore().outcomes == outcomes


LOCKED = "taken = not locks.take(RESERVED)  # L1"
L2 = "                self._go_on(RESERVED)  # L2\n"
SEEN = "                if not self._waiting:\n                    self._seen = self._words[self._answered]\n"
SEND = "            number = self.send(name, values, text, origin, peer)\n"
L3 = "            self._locks.give_back(RESERVED)  # L3\n"
MUTANTS: dict[str, tuple[dict[str, Any], tuple[Change, ...]]] = {
    "nobody locks": ({"rounds": 0}, (("place", LOCKED, "taken = False"),)),
    "unlocked before it is stored": ({"rounds": 0}, (("place", SEND, L3 + SEND),)),
    "goes on from where it was before": ({"rounds": 0, "stops": 2}, (
        ("place", L2, "                if not self._waiting:\n    " + L2),)),
    "seen when it is stored": ({"heir": True}, (
        ("place", SEND, SEND + "            self._seen = self._words[self._answered]\n"),)),
    "answers of others are taken for ours": ({"rounds": 0}, (
        ("place", "[reply for reply in self.poll() if reply.id in self._waiting]", "self.poll()"),)),
}


@pytest.mark.parametrize("name", MUTANTS)
@pytest.mark.slow
def test_a_seeded_mutant_of_the_place_for_stops_is_caught(name: str) -> None:
    scenario, changes = MUTANTS[name]
    with pytest.raises(Broken, match=r"AssertionError|at the end"):
        two(Real(*changes), **scenario).explore()


def test_replies_that_come_round_are_counted() -> None:
    assert two(Real(ONE_REPLY), rounds=0).explore().outcomes == 10
