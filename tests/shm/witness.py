"""Records that say by themselves whether they are whole, who writes them, and who judges what readers give.

All words of a record follow from its number and the life that wrote it: a torn record contradicts itself, and a number
given twice with different content has two authors.
"""

from __future__ import annotations

import ctypes
import mmap
import signal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.topics import Field, Topic

MASK = 2**64 - 1
BY_NUMBER, BY_LIFE = 0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F
REMEMBERED = 1 << 14
PR_SET_PDEATHSIG = 1


class RingViolation(Exception):
    """Something that must always hold does not."""


def holds(true: object, what: str) -> None:
    """Violation when it does not."""
    if not true:
        raise RingViolation(what)


def die_with_parent() -> None:
    """For a fork: be killed when our parent is gone."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class Notes:
    """What a child writes down for its parent: a map of its own, which outlives the child."""

    READY, ATTACH_STEPS, FREE = 0, 1, 2
    WORDS, TEXT = 64, 4000

    def __init__(self) -> None:
        self._map = mmap.mmap(-1, 8 * self.WORDS + self.TEXT)
        self.words = memoryview(self._map)[: 8 * self.WORDS].cast("q")

    def clear(self) -> None:
        """Nothing has been written in this life."""
        self._map[:] = bytes(len(self._map))

    @property
    def text(self) -> str:
        """Why the child gave up, if it did."""
        return self._map[8 * self.WORDS :].rstrip(b"\0").decode(errors="replace")

    @text.setter
    def text(self, text: str) -> None:
        raw = text.encode()[-self.TEXT :]
        self._map[8 * self.WORDS : 8 * self.WORDS + len(raw)] = raw


def topic(slots: int, size: int) -> Topic:
    """A ring of so many slots, whose records carry `size` bytes that follow from their number and author."""
    fields = (Field("life", "<u8", "", "who wrote it"),
              Field("data", f"({size // 8 - 1},)<u8", "", "follows from the others"))
    return Topic("telling", "io", fields, depth=slots)


def first_word(number: int, life: int) -> np.uint64:
    """What the first word of a record's data must be; the others count up from it."""
    return np.uint64(number * BY_NUMBER + life * BY_LIFE & MASK)


class Author:
    """Publishes such records; the stamp of each is its number."""

    def __init__(self, writer: RingWriter, life: int) -> None:
        self.writer, self._life = writer, life
        self._lives, self._data = writer.field("life"), writer.field("data")
        self._count = np.arange(self._data.size, dtype=np.uint64)

    def publish(self) -> int:
        """One record more; returns its number."""
        n = self.writer.sequence + 1
        np.add(self._count, first_word(n, self._life), out=self._data)
        self._lives[...] = self._life
        return self.writer.publish(n)


class Lives:
    """Which life wrote which number, as far as anybody has seen, for the last REMEMBERED numbers."""

    def __init__(self) -> None:
        self._seen = [(0, 0)] * REMEMBERED

    def judge(self, number: int, life: int) -> None:
        """A number has one author for good."""
        known, author = self._seen[number % REMEMBERED]
        if known == number and author != life:
            raise RingViolation(f"record {number} was given twice, by life {author} and by life {life}")
        self._seen[number % REMEMBERED] = (number, life)


class Witness:
    """Judges what one reader gives, with `next` or with `newest`; attach it while nobody writes, or take `start` so."""

    def __init__(self, reader: RingReader, lives: Lives) -> None:
        self.reader, self._lives = reader, lives
        self._life, self._data, self._number = (reader.field(f) for f in ("life", "data", "sequence"))
        self._count = np.arange(self._data.size, dtype=np.uint64)
        self.start = reader._next - 1  # what it counts from
        self.received = self.last = 0

    def judge(self) -> int:
        """The record just read is whole, and nobody has read another one of this number; returns the number."""
        n = self.reader.sequence
        self._whole(n, int(self._number[()]), self.reader.stamp_ns, int(self._life[()]), self._data)
        return n

    def _whole(self, n: int, number: int, stamp: int, life: int, data: NDArray[np.uint64]) -> None:
        if not (number == stamp == n and np.array_equal(data - first_word(n, life), self._count)):
            other = int(np.count_nonzero(data - first_word(n, life) != self._count))
            raise RingViolation(f"record {n} is torn: number {number}, stamp {stamp}, life {life}, "
                                f"{other} of {data.size} words belong to another")
        self._lives.judge(n, life)

    def newest(self) -> bool:
        """One `newest`, judged; numbers never fall."""
        if not self.reader.newest():
            return False
        n = self.judge()
        if n < self.last:
            raise RingViolation(f"newest gave {n} after {self.last}")
        self.received += 1
        self.last = n
        return True

    def next(self) -> bool:
        """One `next`, judged; numbers rise, and received + lost is exact after each."""
        if not self.reader.next():
            return False
        n = self.judge()
        if n <= self.last:
            raise RingViolation(f"next gave {n} after {self.last}")
        self.received += 1
        self.last = n
        if self.received + self.reader.lost != n - self.start:
            raise RingViolation(f"{self.received} received + {self.reader.lost} lost are not {n} - {self.start}")
        return True

    def history(self, rows: NDArray[Any]) -> list[int]:
        """The numbers of what `last` or `since` gave, judged: whole, in order, without a hole."""
        numbers: list[int] = rows["sequence"].tolist()
        for row in rows:
            n = int(row["sequence"])
            self._whole(n, n, int(row["stamp_ns"]), int(row["life"]), row["data"])
        if numbers and numbers != list(range(numbers[0], numbers[-1] + 1)):
            raise RingViolation(f"the history given has holes: {numbers}")
        return numbers
