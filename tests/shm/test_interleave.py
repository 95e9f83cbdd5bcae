"""The explorer itself: what the memory models allow (the litmus tests of the trade), how it counts, how it kills."""

from __future__ import annotations

import random

import pytest

from tests.shm.buffers import MODELS
from tests.shm.interleave import Broken, Explorer, Outcome
from tests.shm.process import Actor, Address, Program

pytestmark = pytest.mark.searches
X, Y, Z = ("a", 0), ("a", 8), ("a", 16)
LOCK = "lock", 1


def program(text: str) -> Program:
    """`x=1 y? fence`: stores 1 to x, loads y and notes it, waits until all is stored; `xy=1` and `xy?` are copies.

    `x~` sleeps while x is 0, `x!` wakes all that sleep there, `lock` and `unlock` are for one lock.
    """
    places: dict[str, Address] = {"x": X, "y": Y, "z": Z}

    def run(me: Actor) -> None:
        for word in text.split():
            if word in ("fence", "quiet"):
                getattr(me, word)()
            elif word == "lock":
                me.note(word, (me.lock(LOCK, 0),))
            elif word == "unlock":
                me.unlock(0)
            elif word.endswith("~"):
                me.sleep(places[word[:-1]], 0)
            elif word.endswith("!"):
                me.note(word, (me.wake(places[word[:-1]]),))
            elif word.endswith("?"):
                me.note(word[:-1], me.load(*(places[c] for c in word[:-1])))
            else:
                names, value = word.split("=")
                me.store(*((places[c], int(value)) for c in names))

    return run


def outcomes(model: str, *texts: str, kill: str = "") -> set[tuple[int, ...]]:
    """What the loads gave, and if there are none what is in x, y, z at the end; of all schedules."""
    found: set[tuple[int, ...]] = set()

    def collect(outcome: Outcome) -> None:
        loads = tuple(v for notes in outcome.notes.values() for _, values in notes for v in values)
        found.add(loads or tuple(outcome.cells.get(place, 0) for place in (X, Y, Z)))

    Explorer({f"p{i}": program(text) for i, text in enumerate(texts)}, collect, model=model, kill=kill).explore()
    return found


@pytest.mark.parametrize("model", MODELS)
def test_a_load_overtakes_a_store_unless_there_is_a_fence(model: str) -> None:
    assert (0, 0) in outcomes(model, "x=1 y?", "y=1 x?")
    assert (0, 0) in outcomes(model, "x=1 fence y?", "y=1 x?")
    assert (0, 0) not in outcomes(model, "x=1 fence y?", "y=1 fence x?")


def test_only_weaker_models_reorder_stores() -> None:
    passed = {model: (1, 0) in outcomes(model, "x=1 y=1", "y? x?") for model in MODELS}
    assert passed == {"tso": False, "streams": False, "pso": True, "weak": True}
    assert all((1, 0) not in outcomes(model, "x=1 fence y=1", "y? fence x?") for model in MODELS)
    in_order = {(1, 2, 0), (2, 1, 0), (2, 2, 0)}
    assert outcomes("tso", "x=1 y=2", "y=1 x=2") == in_order
    assert outcomes("pso", "x=1 y=2", "y=1 x=2") == in_order | {(1, 1, 0)}


def test_only_the_weak_model_reorders_loads() -> None:
    passed = {model: (1, 0) in outcomes(model, "x=1 fence y=1", "y? x?") for model in MODELS}
    assert passed == {"tso": False, "streams": False, "pso": False, "weak": True}
    readers = ("y? x?", "x? y?")
    assert (1, 0, 1, 0) not in outcomes("tso", "x=1", "y=1", *readers)  # all see stores in one order


def test_a_copy_may_overtake_single_stores_in_streams_only() -> None:
    assert (1, 0) not in outcomes("tso", "x=1 yz=1", "y? x?") and (1, 0) in outcomes("streams", "x=1 yz=1", "y? x?")
    assert (1, 0) not in outcomes("streams", "yz=1 x=1", "x? y?") | outcomes("streams", "x=1 fence yz=1", "y? x?")


@pytest.mark.parametrize("model", MODELS)
def test_one_word_never_goes_back_and_own_stores_are_seen(model: str) -> None:
    assert outcomes(model, "x=1 x=2", "x? x?") == {(a, b) for a in range(3) for b in range(a, 3)}
    assert outcomes(model, "x=1 x?") == {(1,)}
    assert outcomes(model, "x=1 x?", "x=2") == {(1,), (2,)}


@pytest.mark.parametrize("model", MODELS)
def test_the_words_of_a_copy_come_in_any_order(model: str) -> None:
    every = {(a, b) for a in (0, 1) for b in (0, 1)}
    assert outcomes(model, "xy=1", "x? y?") == every
    assert outcomes(model, "x=1 y=1", "xy?") == every


def test_death_leaves_what_was_stored_and_parts_of_a_copy() -> None:
    assert outcomes("tso", "x=1 y=1", kill="p0") == {(0, 0, 0), (1, 0, 0), (1, 1, 0)}
    assert outcomes("tso", "xy=1 z=1", kill="p0") == {(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (1, 1, 1)}


def test_schedules_are_counted_exactly() -> None:
    def count(*texts: str) -> int:
        every = Explorer({f"p{i}": program(text) for i, text in enumerate(texts)})
        every.reducing = False
        return every.explore().schedules

    assert count("x? y?", "x? y?") == 6
    assert count("x? y? z?", "x? y? z?") == 20
    assert count("x=1 y=1", "x=2 y=2") == 6
    assert count("xy=1") == 2


WORDS = "x=1 y=1 y=2 z=1 xy=3 yz=4 x? y? z? xy? fence quiet lock lock lock unlock x~ x!"

LENGTHS = {"p": 3, "q": 2, "r": 1}


@pytest.mark.parametrize("model", MODELS)
def test_reducing_leaves_no_outcome_out(model: str) -> None:
    drawn, states = random.Random(1), {True: 0, False: 0}
    for _ in range(60):
        programs = {name: program(" ".join(drawn.choices(WORDS.split(), k=count))) for name, count in LENGTHS.items()}
        kill, found = drawn.choice(("", "p", "p q")), {}
        for reducing in states:
            found[reducing], count = ends(programs, model, kill, reducing)
            states[reducing] += count
        assert found[True] == found[False]
    assert states[True] < 0.8 * states[False], "hardly anything is left out"


def ends(programs: dict[str, Program], model: str, kill: str, reducing: bool) -> tuple[set[str], int]:
    """How all schedules ended, and in how many states."""
    found: set[str] = set()

    def collect(outcome: Outcome) -> None:
        memory = sorted(item for item in outcome.cells.items() if item[1])
        found.add(str((outcome.notes, outcome.asleep, outcome.killed, memory)))

    explorer = Explorer(programs, collect, model=model, kill=kill)
    explorer.reducing = reducing
    return found, explorer.explore().states


def test_a_lock_is_held_by_one_and_freed_by_death() -> None:
    def taker(me: Actor) -> None:
        me.note("got", me.lock(LOCK, 0))
        me.store((X, 1))

    def late(me: Actor) -> None:
        me.after("a")
        me.note("late", me.lock(LOCK, 0))

    seen: set[tuple[object, ...]] = set()

    def check(outcome: Outcome) -> None:
        seen.add(tuple(outcome.all("got")))
        assert outcome.all("late") == [True]

    Explorer({"a": taker, "late": late}, check, kill="a").explore()
    assert seen == {(), (True,)}
    with pytest.raises(Broken, match="late"):
        Explorer({"a": taker, "b": taker, "late": late}, check).explore()


def test_a_process_that_sleeps_is_woken_or_not() -> None:
    def sleeper(me: Actor) -> None:
        me.sleep(X, 0)

    def waker(me: Actor) -> None:
        me.note("woke", me.wake(X))

    seen: set[tuple[object, ...]] = set()

    def look(outcome: Outcome) -> None:
        seen.add((outcome.asleep, *outcome.all("woke")))

    Explorer({"s": sleeper, "w": waker}, look).explore()
    assert seen == {(("s",), 0), ((), 1)}


def test_a_violation_comes_with_a_shortest_schedule() -> None:
    def wrong(me: Actor) -> None:
        if me.load(X)[0] == 2:
            raise ValueError("two")

    explorer = Explorer({"a": program("x=1 x=2"), "b": wrong})
    explorer.shortest = True
    with pytest.raises(Broken) as caught:
        explorer.explore()
    assert str(caught.value).splitlines() == [
        "b: ValueError: two", "  a: stores a+0x0 1", "  a: stores a+0x0 2", "  b: loads a+0x0 2"]
