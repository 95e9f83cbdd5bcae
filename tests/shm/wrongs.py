"""Seeded mistakes in the protocols of shm/, to show that the harness of kills.py catches them. One function each; it
puts the mistake into this process. Each is one that the numbered steps forbid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trocar.shm.mailbox.mailbox import FAILED, REPLY_START, Mailbox, Received
from trocar.shm.mailbox.mailbox_map import COMMANDS_DEPTH, REPLIES_DEPTH
from trocar.shm.mailbox.place import MailboxFull, Place
from trocar.shm.memory import segment
from trocar.shm.ring import ring
from trocar.shm.ring.ring import HEAD, RingReader, RingWriter
from trocar.shm.system.subscriptions import Clearing, Subscriber
from trocar.shm.time.wakeup import Wakeup


def head_first() -> None:
    """W4 before W2: head names a record that is not there yet."""

    def publish(self: RingWriter, stamp_ns: int) -> int:
        n, words = self.sequence + 1, self._words
        self._stamp[1] = stamp_ns
        words[HEAD] = n  # W4
        self._slot[:] = self._source  # W2
        words[self._at] = n  # W3
        self.sequence = n
        self._at, self._slot = self._places[(n + 1) % self._depth]
        words[self._at] = n + ring.NEXT_BUSY  # W1
        return n

    RingWriter.publish = publish  # type: ignore[method-assign]


def never_busy() -> None:
    """No W1: a slot keeps its old number while it is overwritten."""

    def publish(self: RingWriter, stamp_ns: int) -> int:
        n, words = self.sequence + 1, self._words
        self._stamp[1] = stamp_ns
        self._slot[:] = self._source  # W2
        words[self._at] = n  # W3
        words[HEAD] = n  # W4
        self.sequence = n
        self._at, self._slot = self._places[(n + 1) % self._depth]
        return n

    RingWriter.publish = publish  # type: ignore[method-assign]


def forgotten_record() -> None:
    """No V1: the successor gives the number of a record that is out, but not in head, a second time."""

    def recover(self: RingWriter) -> int:
        return self._words[HEAD]

    RingWriter._recover = recover  # type: ignore[method-assign]


def same_epoch() -> None:
    """A claim that does not count."""

    def claim(self: segment.Segment, name: str) -> segment.Identity:
        identity = honest(self, name)
        self.view[68:72] = (identity.epoch - 1).to_bytes(4, "little")
        return identity

    honest = segment.Segment.claim
    segment.Segment.claim = claim  # type: ignore[method-assign]


def deep_sleep() -> None:
    """No Q4: who sleeps is left asleep."""
    Wakeup.wake = lambda self: None  # type: ignore[method-assign]


def run_then_taken() -> None:
    """N3 behind N4: who dies in between leaves a command to his successor that has run."""

    def take(self: Mailbox, place: int, n: int) -> Received | None:
        before = self._taken[place]
        got = take_honestly(self, place, n)  # N2
        self._taken[place] = self._words[self._taken_at[place]] = before
        return got

    def answer(self: Mailbox, place: int, number: int, outcome: int, text: str) -> None:
        honest(self, place, number, outcome, text)
        if outcome != FAILED:
            self._taken[place] = self._words[self._taken_at[place]] = number  # N3

    take_honestly, honest = Mailbox._take, Mailbox.answer
    Mailbox._take, Mailbox.answer = take, answer  # type: ignore[method-assign]


def silence() -> None:
    """No V2: what the dead owner had taken is never answered."""
    Mailbox._unfinished = lambda self, place, taken: []  # type: ignore[method-assign]


def half_an_answer() -> None:
    """V2 without a look at A3: an answer cut short counts as given."""

    def unfinished(self: Mailbox, place: int, taken: int) -> list[int]:
        end = self._answered[place]
        slots = (self._replies[place][n % REPLIES_DEPTH] for n in range(max(1, end - REPLIES_DEPTH + 1), end + 1))
        return [taken] if taken and not any(self._words[at + REPLY_START >> 3] == taken for at in slots) else []

    Mailbox._unfinished = unfinished  # type: ignore[method-assign]


def sent_first() -> None:
    """M3 before M2: the owner is told of a command that is not there yet."""

    def send(self: Place, *given: Any, **more: Any) -> int:
        n = self._count + 1
        if n - self._words[self._taken] > COMMANDS_DEPTH:
            raise MailboxFull("full")
        self._words[self._sent] = n  # M3
        return honest(self, *given, **more)  # M2

    honest = Place.send
    Place.send = send  # type: ignore[method-assign]


def clear_the_living() -> None:
    """No F2: whatever is wanted is cleared."""

    def clear(self: Clearing) -> int:
        for place in range(2):
            self._words[self._cells.at + place] = 0  # F3
        return 1

    Clearing.clear = clear  # type: ignore[method-assign]


def come_as_the_dead() -> None:
    """No lock in C1: the place of somebody who lives is taken."""

    def come(self: Subscriber, instance: str) -> int:
        return 0

    Subscriber._come = come  # type: ignore[method-assign]


# name: (the mistake, who must die, at which step to begin, and for how many lives at most, until it shows)
WRONGS: dict[str, tuple[Callable[[], None], str, int, int]] = {
    "head first": (head_first, "writer", 1, 100),
    "forgotten record": (forgotten_record, "writer", 1, 100),
    "same epoch": (same_epoch, "writer", 1, 2),
    "deep sleep": (deep_sleep, "reader", 1, 100),
    "sent first": (sent_first, "client", 100, 300),
    "stop sent first": (sent_first, "who stops", 320, 200),
    "run, then taken": (run_then_taken, "owner", 280, 200),
    "silence": (silence, "owner", 130, 200),
    "half an answer": (half_an_answer, "owner", 330, 200),
    "clear the living": (clear_the_living, "subscriber", 1, 10),
    "come as the dead": (come_as_the_dead, "subscriber", 1, 100),
}


def no_second_look() -> None:
    """No R3: whatever was copied counts."""

    def newest(self: RingReader) -> bool:
        n = self._words[HEAD]  # R1
        self._target[:] = self._places[n % self._depth][1]  # R2
        self.sequence = n
        return n > 0

    def following(self: RingReader) -> bool:
        n = self._next
        if self._words[self._at] != n:  # S1
            return self._next_again(False)
        self._target[:] = self._slot  # R2
        self.sequence = n
        self._go_to(n + 1)
        return True

    RingReader.newest, RingReader.next = newest, following  # type: ignore[method-assign]


# Mistakes that show when writer and reader meet, by chance; test_stress.py gives them many.
TEARING: dict[str, Callable[[], None]] = {"never busy": never_busy, "no second look": no_second_look}
