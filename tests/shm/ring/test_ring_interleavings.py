"""The ring's real code in every interleaving with itself; and seeded mutants of it, each of which is caught."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from tests.shm.interleave import Broken, Explored, Explorer, Outcome
from tests.shm.process import Actor, Program
from tests.shm.simulated import FIRST, PAIR, Change, Real, private
from trocar.shm.ring.ring import HEAD

pytestmark = pytest.mark.searches
W2, W3, W4 = "self._slot[ALL] = self._source  # W2", "words[self._at] = n  # W3", "words[HEAD] = n  # W4"
VIOLATION = r"AssertionError|at the end"  # and not a mistake in the mutant's text
PUBLISH = f"        {W2}\n        {W3}\n        {W4}\n"
W1 = "words[self._at] = n + NEXT_BUSY  # W1 of the next record, after ours is out: delays no reader"
NEWEST = "        self._target[ALL] = bytes(slot)  # R2\n        if self._words[at] == n >= self.sequence and n:  # R3"
NEXT = "            self._target[ALL] = bytes(self._slot)  # R2\n            if words[at] == n:  # R3"
AGAIN = "            if words[at] == n:  # R3\n                self.sequence = n\n                return True"


def publish(*steps: str) -> Change:
    """Publish in another order."""
    return "ring", PUBLISH, "".join(f"        {step}\n" for step in steps)


def writer(real: Real, depth: int, count: int, previous_state: str = "") -> Program:
    """Publishes `count` records; record n has stamp 10 n and says who wrote it."""

    def run(me: Actor) -> None:
        if previous_state:
            me.after(previous_state)
        ring = real.on(me).writer(depth)
        who = 2000 if previous_state else 1000
        value, n = ring.field("value"), ring.sequence
        assert ring.stamp_ns == 10 * n and (n == 0 or int(value) - n in (1000, 2000)), "the successor's first record"
        for _ in range(count):
            value[...] = who + ring.sequence + 1
            ring.publish(10 * (ring.sequence + 1))
            me.note("out", ring.sequence)

    return run


class Watch:
    """A reader and what must be true of what it gets."""

    def __init__(self, me: Actor, ring: Any) -> None:
        self.me, self.ring = me, ring
        self.value, self.number = ring.field("value"), ring.field("sequence")
        self.seen: dict[int, int] = {}
        self.begin = self.place = ring._next - 1
        self.received = 0
        me.private = lambda: (private(self), private(ring), tuple(sorted(self.seen.items())))

    def whole(self, n: int, number: int, stamp: int, value: int) -> None:
        """A record is all of its sequence, and always the same."""
        assert (number, stamp, value % 1000) == (n, 10 * n, n), f"torn: {n} is {number}, {stamp}, {value}"
        assert self.seen.setdefault(n, value) == value, f"two records {n}: {value} and {self.seen[n]}"

    def newest(self) -> None:
        ring = self.ring
        if ring.newest():
            self.whole(ring.sequence, int(self.number), ring.stamp_ns, int(self.value))
            assert ring.sequence >= max(self.seen), f"newest gave {ring.sequence} after {max(self.seen)}"
        else:
            assert not self.seen, "newest gave nothing"

    def fresh(self) -> None:
        """As `newest`, and not older than the head was before."""
        head = self.ring.head
        self.newest()
        assert not head or self.ring.sequence >= head, "newest is not the newest"

    def next(self) -> bool:
        ring, lost = self.ring, self.ring.lost
        if not ring.next():
            assert ring.lost == lost, "lost, and nothing came after it"
            return False
        self.place += ring.lost - lost + 1
        assert ring.sequence == self.place, f"next gave {ring.sequence} for {self.place}"
        self.whole(ring.sequence, int(self.number), ring.stamp_ns, int(self.value))
        self.received += 1
        return True

    def last2(self) -> None:
        self.history(lambda: self.ring.last(2), lambda n, head: n > head - 2)

    def since(self) -> None:
        self.history(lambda: self.ring.since(20), lambda n, head: n >= 2)

    def history(self, get: Any, wanted: Any) -> None:
        """Whole records without a hole, and all that were wanted and there from beginning to end."""
        before = self.ring.head
        rows = [(int(r["sequence"]), int(r["stamp_ns"]), int(r["value"])) for r in get()]
        after = self.ring.head
        numbers = [n for n, _, _ in rows]
        for n, stamp, value in rows:
            self.whole(n, n, stamp, value)
        assert not rows or numbers == list(range(numbers[0], numbers[-1] + 1)), f"a hole in {numbers}"
        sure = [n for n in range(max(1, after - self.ring._depth + 2), before + 1) if wanted(n, after)]
        assert set(sure) <= set(numbers), f"{sure} were there, but we got {numbers}"

    def forget(self, step: int) -> None:
        """The private record is overwritten before it is looked at again."""
        self.ring._record._bytes[:] = bytes(len(self.ring._record._bytes))
        self.me.merge(step)


def reader(real: Real, depth: int, verbs: str) -> Program:
    """Does the verbs one after the other; when all is quiet gets the rest by `next`, and counts."""

    def run(me: Actor) -> None:
        watch = Watch(me, real.on(me).reader(depth))
        for step, verb in enumerate(verbs.split()):
            getattr(watch, verb)()
            watch.forget(step)
        ring = watch.ring
        assert ring.torn == ring.backwards == 0, ring.problem
        me.quiet()
        while watch.next():
            watch.forget(-1)
        watch.newest()
        assert ring.problem == ""
        assert watch.received + ring.lost == watch.place - watch.begin, "received + lost is not what was written"
        me.note("to", watch.place)
        for item in watch.seen.items():
            me.note("saw", item)

    return run


def judge(depth: int, outcome: Outcome) -> None:
    """All that is out was read or counted; nobody saw another record n."""
    ends, out = outcome.all("to"), outcome.all("out")
    total = outcome.cells["ring", 8 * HEAD]
    slot = "ring", FIRST + (total + 1) % depth * PAIR.stride
    total += outcome.cells.get(slot) == total + 1  # died between W3 and W4
    assert len(out) == len(set(out)), f"written twice: {out}"
    assert outcome.killed or total == len(out), f"{total} are out of {out}"
    assert total >= max(out, default=0) and set(ends) == {total}, f"read to {ends} of {total}"
    saw: dict[int, int] = {}
    for n, value in outcome.all("saw"):
        assert saw.setdefault(n, value) == value, f"two records {n}"


def ring(real: Real, depth: int, count: int, *verbs: str, heir: int = 0, model: str = "tso", kill: str = ""
         ) -> Explorer:
    """A writer of `count` records, a successor when it is gone, and readers."""
    programs = {"writer": writer(real, depth, count)}
    if heir:
        programs["heir"] = writer(real, depth, heir, "writer")
    programs |= {f"reader{i}": reader(real, depth, v) for i, v in enumerate(verbs)}
    return Explorer(programs, partial(judge, depth), model=model, kill=kill)


@pytest.mark.parametrize(("depth", "count", "verbs", "outcomes"), [
    (2, 3, "newest newest", 11), (2, 3, "next next", 14), (2, 3, "last2 since", 11),
    (3, 4, "fresh next", 21), (3, 3, "last2 since", 7), (4, 4, "next newest next", 12),
])
def test_no_reader_gets_a_torn_record(depth: int, count: int, verbs: str, outcomes: int) -> None:
    assert ring(Real(), depth, count, verbs).explore().outcomes == outcomes


def test_two_readers_do_not_disturb_each_other() -> None:
    assert ring(Real(), 3, 1, "newest", "next").explore().outcomes == 6


def test_a_killed_writer_and_its_successor_harm_nobody() -> None:
    assert ring(Real(), 2, 1, "newest next", heir=1, kill="writer").explore().outcomes == 38


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "count", "verbs", "heir", "kill", "outcomes"), [
    (3, 4, ("newest next last2 since",), 0, "", 24),
    pytest.param(2, 5, ("fresh next fresh next",), 0, "", 117, marks=pytest.mark.soak),
    pytest.param(2, 3, ("newest", "next"), 0, "", 90, marks=pytest.mark.soak),
    (3, 2, ("newest next newest",), 2, "writer", 134),
    (2, 2, ("next newest",), 1, "writer heir", 329),
])
def test_readers_and_deaths_go_together(depth: int, count: int, verbs: tuple[str, ...], heir: int, kill: str,
                                        outcomes: int) -> None:
    assert ring(Real(), depth, count, *verbs, heir=heir, kill=kill).explore().outcomes == outcomes


def test_merging_leaves_no_schedule_out() -> None:
    def explored(merging: bool) -> Explored:
        explorer = ring(Real(), 3, 2, "newest next")
        explorer.merging, explorer.reducing = merging, False
        return explorer.explore()

    merged, every = explored(True), explored(False)
    assert every.schedules == merged.schedules and every.states > 1.2 * merged.states


NEWEST_TWICE, NEXT_TWICE = (2, "newest newest"), (3, "next next")  # depth and verbs that catch it
MUTANTS: dict[str, tuple[tuple[int, str], tuple[Change, ...]]] = {
    "head before all": (NEWEST_TWICE, (publish(W4, W2, W3),)),
    "head before the number": (NEWEST_TWICE, (publish(W2, W4, W3),)),
    "number before the payload": (NEXT_TWICE, (publish(W3, W2, W4),)),
    "no busy mark": (NEWEST_TWICE, (("ring", W1, "pass"),)),
    "busy mark behind the payload": (NEWEST_TWICE, (
        ("ring", W1, "pass"), publish(W2, "words[self._at] = n + BUSY", W3, W4))),
    "newest does not look again": (NEWEST_TWICE, (("ring", "self._words[at] == n >= self.sequence and n:", "n:"),)),
    "newest looks before it copies only": (NEWEST_TWICE, (("ring", NEWEST, NEWEST.replace(
        "self._words[at]", "seen").replace("        self", "        seen = self._words[at]\n        self", 1)),)),
    "newest does not look again at its second try": (NEWEST_TWICE, (
        ("ring", AGAIN, AGAIN.replace("words[at] == n", "True")),)),
    "newest goes back": ((3, "next newest"), (("ring", "n = self.sequence  # `next`", "pass  # `next`"),)),
    "next does not look again": (NEXT_TWICE, (("ring", NEXT, NEXT.replace("words[at] == n", "True")),)),
    "next looks at no number": (NEXT_TWICE, (
        ("ring", "if seen == n:", "if seen:"), ("ring", NEXT, NEXT.replace("words[at] == n", "True")))),
    "one too few is counted lost": (NEXT_TWICE, (
        ("ring", "self.lost += max(1, oldest + room - n)", "self.lost += max(1, oldest + room - n) - 1"),)),
    "history does not look again": ((2, "last2"), (("ring", "if words[at] != n:", "if False:"),)),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_seeded_mutant_of_the_ring_is_caught(name: str) -> None:
    (depth, verbs), changes = MUTANTS[name]
    with pytest.raises(Broken, match=VIOLATION):
        ring(Real(*changes), depth, 3, verbs).explore()


MUTANT_HEIRS: dict[str, tuple[int, str, Change]] = {
    "record finished by the dead not taken over": (1, "next", (
        "ring", "if words[self._places[(n + 1) % self._depth][0]] == n + 1:", "if False:")),
    "heir marks nothing busy": (2, "newest", (
        "ring", "self._words[self._at] = self.sequence + NEXT_BUSY  # W1", "pass")),
    "heir does not move the head": (2, "newest", ("ring", "            words[HEAD] = n\n", "")),
}


@pytest.mark.parametrize("name", MUTANT_HEIRS)
def test_a_seeded_mutant_of_recovery_is_caught(name: str) -> None:
    count, verb, change = MUTANT_HEIRS[name]
    with pytest.raises(Broken, match=VIOLATION):
        ring(Real(change), 2, count, verb, heir=1, kill="writer").explore()


# Memories that keep less order than x86-64: what FencedWords are for.


@pytest.mark.parametrize("model", ["streams", "pso"])
def test_plain_words_need_an_ordered_memory(model: str) -> None:
    with pytest.raises(Broken, match=VIOLATION):
        ring(Real(), 2, 3 if model == "streams" else 2, "newest", model=model).explore()


@pytest.mark.parametrize("model", ["pso", "weak"])
@pytest.mark.slow
def test_fenced_words_do_without(model: str) -> None:
    assert ring(Real(fenced=True), 2, 2, "newest next", model=model).explore().outcomes == 8
    assert ring(Real(fenced=True), 3, 1, "next", heir=1, kill="writer", model=model).explore().outcomes == 22


def test_large_records_need_fences_at_the_writer_only() -> None:
    assert ring(Real(large=True), 2, 3, "newest next", model="streams").explore().outcomes == 17


LOAD = "        self._fence()\n        value = self._words[index]\n        self._fence()\n"
STORE = "        self._fence()\n        self._words[index] = value\n        self._fence()\n"
FENCES: dict[str, tuple[str, Change]] = {
    "no fence at loads": ("weak", ("order", LOAD, "        value = self._words[index]\n")),
    "no fence behind loads": ("weak", ("order", LOAD, "        self._fence()\n        value = self._words[index]\n")),
    "no fence before loads": ("weak", ("order", LOAD, "        value = self._words[index]\n        self._fence()\n")),
    "no fence at stores": ("pso", ("order", STORE, "        self._words[index] = value\n")),
    "no fence behind stores": ("pso", ("order", STORE, "        self._fence()\n        self._words[index] = value\n")),
    "no fence before stores": ("pso", ("order", STORE, "        self._words[index] = value\n        self._fence()\n")),
}


@pytest.mark.parametrize("name", FENCES)
def test_a_fence_left_out_is_noticed(name: str) -> None:
    model, change = FENCES[name]
    with pytest.raises(Broken, match=VIOLATION):
        for count, verb in ((2, "newest"), (3, "newest"), (3, "next next")):
            ring(Real(change, fenced=True), 2, count, verb, model=model).explore()
