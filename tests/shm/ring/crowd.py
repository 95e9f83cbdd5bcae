"""The processes of test_stress.py: one writer, and readers who judge every record they get."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable

from tests.shm import wrongs
from tests.shm.witness import Author, Lives, RingViolation, Witness, holds
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.time.clock import WallClock, monotonic_ns

PATIENCE_NS = 600_000_000_000
TURNS = 64  # between two looks at whether the test is over
HISTORY = 16
HURRY = 15  # periods that a writer makes up for after a pause
ROOM = 10  # niceness of the readers: eight of them would leave the writer little of two cores


def over() -> bool:
    """Whether the test has closed our input, or written to it."""
    try:
        os.read(0, 1)
    except BlockingIOError:
        return False
    return True


def attach(write: bool) -> Segment:
    """The ring of the test, when it lets us; a mistake asked for is put in before."""
    os.read(0, 1)
    os.set_blocking(0, False)
    if sys.argv[2]:
        wrongs.TEARING[sys.argv[2]]()
    return Segment(segment_name(sys.argv[1], "io", "telling"), write=write)


def write() -> None:
    """Arguments: system, mistake, rate (0: as fast as it goes). Publishes until the test is over; says how many."""
    author, clock = Author(RingWriter(attach(write=True), "io"), 1), WallClock()
    period_ns = round(1e9 / float(sys.argv[3])) if float(sys.argv[3]) else 0
    due = begin = monotonic_ns()
    while not over():
        for _ in range(1 if period_ns else TURNS):
            author.publish()
        if period_ns:
            due = max(due + period_ns, monotonic_ns() - HURRY * period_ns)
            clock.sleep_until(due, over)
    seconds = (monotonic_ns() - begin) / 1e9
    print(json.dumps({"published": author.writer.sequence, "rate_hz": round(author.writer.sequence / seconds)}))


class Historian:
    """Reads history: what is missing at its front has been overwritten, all else is there."""

    def __init__(self, witness: Witness, depth: int) -> None:
        self._witness, self._depth, self._turn = witness, depth, 0
        self.missing = 0

    def read(self) -> int:
        """One `last` or `since`; returns how many records it gave."""
        reader, self._turn = self._witness.reader, self._turn + 1
        before = reader.head
        asked = HISTORY if self._turn % 2 else min(self._depth - 1, 4 * HISTORY)
        numbers = self._witness.history(reader.last(asked) if self._turn % 2 else reader.since(before - asked + 1))
        if not before:
            return 0
        end = numbers[-1] if numbers else before
        holds(end >= before, f"history ends with {end}, head was {before}")
        first = numbers[0] if numbers else end + 1
        wanted = max(1, end - asked + 1 if self._turn % 2 else before - asked + 1)
        if first > wanted:
            self.missing += first - wanted
            word = reader._words[reader._places[(first - 1) % self._depth][0]]
            holds(word != first - 1, f"{first - 1} is still there and was left out")
        return len(numbers)


def read() -> None:
    """Arguments: system, mistake, verb, reads. Says "attached", then "enough" after so many reads; goes on until the
    test is over, reads what is left, and reports. Or says what was wrong."""
    os.nice(ROOM)
    try:
        _read()
    except RingViolation as violation:
        print(violation, flush=True)
        sys.exit(1)


def _read() -> None:
    segment = attach(write=False)
    witness = Witness(RingReader(segment), Lives())
    verb, quota, reader = sys.argv[3], int(sys.argv[4]), witness.reader
    historian = Historian(witness, segment.header.depth)
    turns: dict[str, Callable[[], int]] = {"next": witness.next, "newest": witness.newest, "history": historian.read}
    turn, reads, enough, deadline = turns[verb], 0, False, monotonic_ns() + PATIENCE_NS
    print("attached", flush=True)
    while not over():
        for _ in range(TURNS):
            reads += turn()
        if reads >= quota and not enough:
            enough = True
            print("enough", flush=True)
        if monotonic_ns() > deadline:
            raise RingViolation(f"only {reads} reads")
    while verb == "next" and witness.next():
        reads += 1
    if verb == "newest":
        reads += witness.newest()
    holds(verb == "history" or witness.last == reader.head, f"the last is {witness.last}, head is {reader.head}")
    holds(not reader.backwards, reader.problem)
    passed = reader.head - witness.start
    print(json.dumps({"verb": verb, "reads": reads, "received": witness.received, "lost": reader.lost, "passed": passed,
                      "given_up": reader.torn, "missing": historian.missing}))
