"""The wake-up word: one process sleeps, and any process with news for it wakes it, at no cost while it is awake.

Its word is 1 while it sleeps.

Sleep: P1 word := 1           P2 full fence            P3 is there news? then word := 0, done
       P4 futex wait while the word is 1, bounded; then word := 0
Wake:  Q1 the news is out     Q2 full fence            Q3 word 1?         Q4 word := 0, futex wake

A waker that is late in Q4 ends a later sleep early; only the sleeper stores 1, so no wake-up is missed. Without the
fences the store of P1 and the load of P3 (and Q1, Q3) may pass each other even on x86-64, and a wake-up is lost
(shm/memory/order.py explains the fence); waits are bounded anyway. Futex waits run on the monotonic clock: setting the
wall clock has no effect.
"""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable

from trocar.shm.memory.order import full_fence
from trocar.shm.memory.segment import Segment, SegmentError

FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine(), 0)
WAIT, WAKE = 0, 1
ALL_WAITERS = 2**31 - 1
LIBC = ctypes.CDLL(None, use_errno=True)
SYSCALL = LIBC.syscall
SYSCALL.restype = ctypes.c_long


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]  # ctypes requires a list


class Futex:
    """One 32-bit word of a segment that processes can sleep on."""

    def __init__(self, segment: Segment, offset: int) -> None:
        self._word = segment.view[offset : offset + 4].cast("I")
        if segment.view.readonly:
            raise SegmentError(f"{segment.name}: a futex needs write access")
        anchor = ctypes.c_uint32.from_buffer(segment.view, offset)
        self._anchor = anchor  # keeps the mapping alive while the address is in use
        self._address = ctypes.c_void_p(ctypes.addressof(anchor))
        self._timeout = _Timespec()
        self._timeout_at = ctypes.byref(self._timeout)

    @property
    def value(self) -> int:
        """The word."""
        return int(self._word[0])

    @value.setter
    def value(self, value: int) -> None:
        self._word[0] = value

    def wait(self, value: int, timeout_ns: int) -> None:
        """Sleep while the word equals `value`, at most `timeout_ns`; may wake early."""
        if timeout_ns <= 0:
            return
        self._timeout.seconds, self._timeout.nanoseconds = divmod(timeout_ns, 1_000_000_000)
        SYSCALL(FUTEX, self._address, WAIT, ctypes.c_uint32(value), self._timeout_at, None, 0)

    def wake(self) -> None:
        """Wake all sleepers on it; the word is unchanged."""
        SYSCALL(FUTEX, self._address, WAKE, ALL_WAITERS, None, None, 0)


class Wakeup:
    """One word of a segment: the end of its one sleeper, and that of its wakers."""

    def __init__(self, segment: Segment, offset: int) -> None:
        self._futex = Futex(segment, offset)
        self._fence = full_fence()

    def sleep(self, news: Callable[[], bool], timeout_ns: int) -> bool:
        """Sleep until woken or `timeout_ns`; returns `news()`. May return early without it."""
        self.begin()
        try:
            if news():  # P3
                return True
            self.wait(timeout_ns)  # P4
        finally:
            self.end()
        return news()

    def begin(self) -> None:
        """Announce sleep to others; check for news before `wait`, then `end`."""
        self._futex.value = 1  # P1
        self._fence()  # P2

    def wait(self, timeout_ns: int) -> None:
        """Wait until woken, at most this long."""
        self._futex.wait(1, timeout_ns)

    def end(self) -> None:
        """We are awake."""
        self._futex.value = 0

    @property
    def sleeps(self) -> bool:
        """Whether the process is asleep, and not yet woken."""
        return self._futex.value == 1

    def wake(self) -> None:
        """Wake the sleeper if it sleeps; call after the news is out."""
        self._fence()  # Q2
        self.wake_after_fence()

    def wake_after_fence(self) -> bool:
        """`wake` without its fence, if the caller has made one; returns whether the process slept."""
        if not self._futex.value:  # Q3
            return False
        self._futex.value = 0  # Q4
        self._futex.wake()
        return True
