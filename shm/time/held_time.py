"""Simulated time held back by an outside program: time advances to the limit that this program sets, and stops there.

Actions during such a stop (a command sent, a ring read) happen at that instant in every run. One program at a time may
hold time; the kernel releases its place when it ends, and the supervisor then lets time run.
"""

from __future__ import annotations

from typing import Final

from trocar.shm.memory.closable import Closable
from trocar.shm.memory.locks import Places
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.lockstep import NEVER, SCHEMA, Steps, Table, clock_page, waker_of, wakeups_of

LOOK_S: Final = 1e-4
LATER_S: Final = 1e-3  # the longest interval between two looks
PAUSE_NS: Final = 100_000_000  # a longer interval between two looks is a stall of ours: only this much counts


class HeldTime(Steps, Closable):
    """Time is stopped from the start; a context manager, at whose end time runs freely again."""

    def __init__(self, system: str) -> None:
        """SegmentError: the system does not simulate time, or another program holds it."""
        self._over = False
        page = clock_page(system, write=True)
        try:
            table = Table.of_info(page.header.info)
            super().__init__(page, wakeups_of(system, table, page), waker_of(system, table, page))
            self._held = Places(page, page.header.first + SCHEMA.offset("limit_ns"), 1)
            if not self._held.take(0):
                raise SegmentError(f"{page.name}: another program holds the time of {system}")
            self.words[self._limit] = self.now_ns()
        except BaseException:
            page.close()
            raise

    def run_until(self, time_ns: int, wait_s: float) -> bool:
        """Let time go to `time_ns`, and wait until all due work is done and all members sleep.

        False if that takes longer than `wait_s` in real time, without our own stalls: then a member is awake, or no
        member takes part.
        """
        self.words[self._limit] = time_ns
        left_ns, before_ns, look_s = round(wait_s * 1e9), monotonic_ns(), LOOK_S
        while self.advance() != NEVER:
            now_ns = monotonic_ns()
            left_ns, before_ns = left_ns - min(now_ns - before_ns, PAUSE_NS), now_ns
            if left_ns <= 0:
                return False
            pause(look_s)
            look_s = min(2.0 * look_s, LATER_S)
        return True

    def wake_ns(self, member: str) -> int:
        """The time at which a member wants to resume."""
        return self.words[self._next[self.table.members.index(member)]]

    def close(self) -> None:
        """Release time."""
        if not self._over:
            self._over = True
            self.words[self._limit] = 0
            self.advance()
            self._wake_due()
            self._held.give_back(0)
            super().close()
