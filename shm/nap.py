"""The nap: the doorbell the other way round. One process sleeps, whoever has news for it wakes it.

Its word is 1 while it sleeps.

Sleep: P1 word := 1           P2 full fence            P3 is there news? then word := 0, done
       P4 futex wait while the word is 1, bounded; then word := 0
Rouse: Q1 the news is out     Q2 full fence            Q3 word 1?         Q4 word := 0, futex wake

A rouser that comes late in Q4 ends another sleep than it meant, early; nobody else ever stores 1, so none is missed.
The fences are needed as at the doorbell (shm/doorbell.py): P1 and P3, and Q1 and Q3, may pass each other without.
"""

from __future__ import annotations

from collections.abc import Callable

from shm.doorbell import Futex
from shm.order import full_fence
from shm.segment import Segment


class Nap:
    """One word of a segment: its one sleeper's end, and that of whoever wakes it."""

    def __init__(self, segment: Segment, offset: int) -> None:
        self._futex = Futex(segment, offset)
        self._fence = full_fence()

    def sleep(self, news: Callable[[], bool], timeout_ns: int) -> bool:
        """Sleep until roused or `timeout_ns`; returns `news()`. May return early without it."""
        self.begin()
        try:
            if news():  # P3
                return True
            self.wait(timeout_ns)  # P4
        finally:
            self.end()
        return news()

    def begin(self) -> None:
        """We sleep, as far as others can see; look for news before `wait`, then `end`."""
        self._futex.value = 1  # P1
        self._fence()  # P2

    def wait(self, timeout_ns: int) -> None:
        """Until roused or so long."""
        self._futex.wait(1, timeout_ns)

    def end(self) -> None:
        """We are awake."""
        self._futex.value = 0

    @property
    def sleeps(self) -> bool:
        """It sleeps, and nobody has woken it."""
        return self._futex.value == 1

    def rouse(self) -> None:
        """Wake the sleeper if it sleeps; call after the news is out."""
        self._fence()  # Q2
        self.wake()

    def wake(self) -> bool:
        """`rouse` without its fence, where there is one already; returns whether it slept."""
        if not self._futex.value:  # Q3
            return False
        self._futex.value = 0  # Q4
        self._futex.wake_sleepers()
        return True
