"""The doorbell: wake the processes that wait for new data, and pay nothing when none does.

Each waiting place has a flag, written by the waiter only, and a counter, written by the ringer only.

Wait:  D0 c := counter          D1 flag := 1
       D2 full fence            D3 is the data there? then flag := 0, done
       D4 futex wait while the counter is c, bounded; then flag := 0
Ring:  E1 the data is out       E2 full fence       E3 any flag set?       E4 counter + 1, futex wake
       E5 nobody heard UNHEARD rings at a place whose flag is up: if its lock is free, its waiter is dead, flag := 0;
          if not, the place is looked at again UNHURRIED rings later

Without the fences the store of D1 and the load of D3 (and E1, E3) may pass each other even on x86-64, and a wake-up is
lost (shm/order.py says what makes the fence); waits are bounded anyway. Futex waits run on the monotonic clock: setting
the wall clock disturbs nobody.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import operator
import os
import platform
import struct
from collections.abc import Callable
from functools import partial

from shm.order import full_fence
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
UNHURRIED = 1024  # more rings before a place is looked at again whose waiter lives and yet does not listen
UNHEARD = 16  # rings; a living waiter that is just waking up misses one or two


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]  # ctypes asks for a list


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

    def wake(self) -> int:
        """Add one to the word and wake everybody who sleeps on it, returns how many. One process alone may do this."""
        self._word[0] = (self._word[0] + 1) & 0xFFFFFFFF
        return self.wake_sleepers()

    def wake_sleepers(self) -> int:
        """Wake everybody who sleeps on it, returns how many; the word stays as it is."""
        return int(SYSCALL(FUTEX, self._address, WAKE, ALL_WAITERS, None, None, 0))


class AllTaken(SegmentError):
    """No place is free and fit; `places` are those that somebody has."""

    def __init__(self, text: str, places: list[int]) -> None:
        super().__init__(text)
        self.places = places


class Places:
    """Places of a segment, each with a lock byte in the file: the kernel frees the place of a process that dies."""

    def __init__(self, segment: Segment, first: int, count: int) -> None:
        """`count` places whose lock bytes begin at file offset `first`."""
        self._segment, self._first, self._count = segment, first, count

    def claim(self, fit: Callable[[int], bool] = lambda place: True) -> int:
        """Take a place that is free and `fit`; AllTaken when there is none. Given back at close."""
        taken = []
        for place in range(self._count):
            if not self.take(place):
                taken.append(place)
            elif fit(place):
                self._segment.at_close(partial(self.give_back, place), unlocks=True)
                return place
            else:
                self.give_back(place)
        raise AllTaken(f"{self._segment.name}: all {self._count} places are taken", taken)

    def take(self, place: int) -> bool:
        """Take a place, if nobody has it, until `give_back`. Not for two threads: both would get it."""
        return _lock(self._segment.fd, self._first + place)

    def give_back(self, place: int) -> None:
        """Let somebody else have a place."""
        _unlock(self._segment.fd, self._first + place)

    def while_free(self, place: int, act: Callable[[], object]) -> bool:
        """Call `act` if nobody has the place, and let nobody take it meanwhile; returns whether it was called.

        Not called either when the system has no descriptor or lock to spare.
        """
        try:
            # opened anew, because a lock does not exclude its own description
            ours = os.open(f"/proc/self/fd/{self._segment.fd}", os.O_RDWR)
        except OSError:
            return False
        try:
            with contextlib.suppress(OSError):
                free = _lock(ours, self._first + place)
                if free:
                    act()
                return free
            return False
        finally:
            os.close(ours)


def _lock(fd: int, at: int) -> bool:
    try:
        fcntl.fcntl(fd, OFD_SETLK, LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, at, 1, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return False
        raise
    return True


def _unlock(fd: int, at: int) -> None:
    fcntl.fcntl(fd, OFD_SETLK, LOCK.pack(fcntl.F_UNLCK, os.SEEK_SET, at, 1, 0))


class Bell:
    """The ringing end: `flags` (PLACES bytes) and `counters` (PLACES words) of the owner's control page."""

    def __init__(self, segment: Segment, flags_at: int, counters_at: int) -> None:
        self._flags = segment.keep(segment.view[flags_at : flags_at + PLACES])
        self._futexes = [Futex(segment, counters_at + 4 * i) for i in range(PLACES)]
        self._places = Places(segment, flags_at, PLACES)
        self._unheard = [0] * PLACES
        self._fence = full_fence()

    def ring(self) -> None:
        """Wake every waiter; call after the data is out."""
        self._fence()  # E2
        if self._flags.tobytes() == QUIET:  # E3
            return
        deaf = -1
        for place, flag in enumerate(self._flags):
            if not flag:
                continue
            self._unheard[place] = 0 if self._futexes[place].wake() else self._unheard[place] + 1  # E4
            if self._unheard[place] >= UNHEARD:
                deaf = place
        if deaf >= 0:  # E5, one a ring: it opens a file. No waiter can come in between, the place is ours meanwhile
            taken_down = self._places.while_free(deaf, partial(operator.setitem, self._flags, deaf, 0))
            self._unheard[deaf] = 0 if taken_down else -UNHURRIED


class Waiter:
    """The waiting end: one place at one owner's bell."""

    def __init__(self, segment: Segment, flags_at: int, counters_at: int) -> None:
        self._segment = segment
        place = Places(segment, flags_at, PLACES).claim()
        self._flag = segment.view[flags_at + place : flags_at + place + 1]
        self._flag[0] = 0
        self._futex = Futex(segment, counters_at + 4 * place)
        self._fence = full_fence()
        segment.at_close(self._leave)

    def _leave(self) -> None:
        self._flag[0] = 0
        self._flag.release()

    def wait(self, ready: Callable[[], bool], timeout_ns: int) -> bool:
        """Sleep until rung or `timeout_ns`; returns `ready()`. May return early without it."""
        value = self._futex.value  # D0: a ring between here and D4 must not be slept through
        self._flag[0] = 1  # D1
        self._fence()  # D2
        try:
            if ready():  # D3
                return True
            self._futex.wait(value, timeout_ns)  # D4
        finally:
            self._flag[0] = 0
        return ready()
