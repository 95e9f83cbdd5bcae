"""The doorbell: wake the processes that wait for new data, and pay nothing when none does.

Each waiting place has a flag, written by the waiter only, and a counter, written by the ringer only.

Wait:  D1 flag := 1   D2 full fence   D3 is the data there? then flag := 0, done   D4 futex wait on the counter, bounded
Ring:  E1 data is out E2 full fence   E3 any flag set?                             E4 counter + 1, futex wake

Without the fences the store of D1 and the load of D3 (and E1, E3) may pass each other even on x86-64, and a wake-up is
lost. A lock's acquire and release are atomic read-modify-writes, which are full fences on x86-64; waits are bounded
anyway. Futex waits run on the monotonic clock: setting the wall clock disturbs nobody.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import platform
import struct
import threading
from collections.abc import Callable
from functools import partial

from shm.segment import Segment, SegmentError

PLACES = 16
FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine(), 0)
WAIT, WAKE = 0, 1
ALL_WAITERS = 2**31 - 1
OFD_SETLK = 37  # Linux: open-file-description locks; given back by the kernel when the description closes
LOCK = struct.Struct("hhqqi4x")
LIBC = ctypes.CDLL(None, use_errno=True)
SYSCALL = LIBC.syscall
SYSCALL.restype = ctypes.c_long
QUIET = bytes(PLACES)


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]  # ctypes asks for a list


class Fence:
    """A full memory fence: one uncontended lock cycle."""

    def __init__(self) -> None:
        lock = threading.Lock()
        self._acquire, self._release = lock.acquire, lock.release

    def __call__(self) -> None:
        """Order every earlier store before every later load."""
        self._acquire()
        self._release()


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

    def wait(self, value: int, timeout_ns: int) -> None:
        """Sleep while the word equals `value`, at most `timeout_ns`; may wake early."""
        if timeout_ns <= 0:
            return
        self._timeout.seconds, self._timeout.nanoseconds = divmod(timeout_ns, 1_000_000_000)
        SYSCALL(FUTEX, self._address, WAIT, ctypes.c_uint32(value), self._timeout_at, None, 0)

    def wake(self) -> None:
        """Add one to the word and wake everybody who sleeps on it. Only one process may do this to a word."""
        self._word[0] = (self._word[0] + 1) & 0xFFFFFFFF
        SYSCALL(FUTEX, self._address, WAKE, ALL_WAITERS, None, None, 0)


def claim_place(segment: Segment, first: int, count: int) -> int:
    """Take one of `count` places whose lock bytes begin at file offset `first`; SegmentError when all are taken.

    The lock is on our open file description: the kernel frees the place when we die.
    """
    for place in range(count):
        try:
            fcntl.fcntl(segment.fd, OFD_SETLK, LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, first + place, 1, 0))
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                continue
            raise
        free = LOCK.pack(fcntl.F_UNLCK, os.SEEK_SET, first + place, 1, 0)
        segment.at_close(partial(fcntl.fcntl, segment.fd, OFD_SETLK, free))
        return place
    raise SegmentError(f"{segment.name}: all {count} places are taken")


class Bell:
    """The ringing end: `flags` (PLACES bytes) and `counters` (PLACES words) of the owner's control page."""

    def __init__(self, segment: Segment, flags_at: int, counters_at: int) -> None:
        self._flags = segment.view[flags_at : flags_at + PLACES]
        self._futexes = [Futex(segment, counters_at + 4 * i) for i in range(PLACES)]
        self._fence = Fence()

    def ring(self) -> None:
        """Wake every waiter; call after the data is out."""
        self._fence()
        if self._flags.tobytes() == QUIET:
            return
        for place, flag in enumerate(self._flags):
            if flag:
                self._futexes[place].wake()


class Waiter:
    """The waiting end: one place at one owner's bell."""

    def __init__(self, segment: Segment, flags_at: int, counters_at: int) -> None:
        self._segment = segment
        place = claim_place(segment, flags_at, PLACES)
        self._flag = segment.view[flags_at + place : flags_at + place + 1]
        self._flag[0] = 0
        self._futex = Futex(segment, counters_at + 4 * place)
        self._fence = Fence()
        segment.at_close(self._leave)

    def _leave(self) -> None:
        self._flag[0] = 0
        self._flag.release()

    def wait(self, ready: Callable[[], bool], timeout_ns: int) -> bool:
        """Sleep until rung or `timeout_ns`; returns `ready()`. May return early without it."""
        value = self._futex.value
        self._flag[0] = 1
        self._fence()
        try:
            if ready():
                return True
            self._futex.wait(value, timeout_ns)
        finally:
            self._flag[0] = 0
        return ready()
