"""What a process asks of the scheduler, so that nobody holds it up: priority, a share of its own, memory, a core."""

from __future__ import annotations

import ctypes
import os
import platform
import struct

from procs.document.system import Process
from procs.rights import NO_FIFO, NOT_LOCKED

PR_SET_NAME, PR_SET_TIMERSLACK = 15, 29
MCL_CURRENT, MCL_FUTURE = 1, 2
SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}.get(platform.machine(), 0)  # glibc has no wrapper before 2.41
SCHED_ATTR = struct.Struct("<IIQiIQQQ")  # size, policy, flags, nice, priority, runtime, deadline, period
SCHED_DEADLINE = 6
SCHED_FLAGS = 1 | 2  # children get none of it; it may have more than it reserved where nobody else did


def realtime(row: Process, clock: str, *, locked: bool, reserved: float = 0.0) -> str:
    """Name, timer slack, priority, locked memory, core; returns what was obtained, in words; children get none of it.

    `reserved` is a share of each period that nobody else may take: Linux stops all FIFO processes for 50 ms when
    together they leave nothing to others for a second, and a bus must not pay for arms that take too long. It cannot be
    had with a core of one's own. In lock-step nothing is urgent, and loops that never sleep must not keep others from
    the cores: no priority there, and no memory need be locked.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(PR_SET_NAME, row.name.encode()[:15], 0, 0, 0)
    libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    notes = []
    if row.priority > 0 and clock == "wall" and reserved and row.cpu is None and _reserve(libc, row.period_s, reserved):
        notes.append("deadline")
    elif row.priority > 0 and clock == "wall":
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(row.priority))
            notes.append(f"FIFO {row.priority}")
        except OSError:  # no right to it
            notes.append(NO_FIFO)
    if locked and clock == "wall":
        notes.append("locked" if libc.mlockall(MCL_CURRENT | MCL_FUTURE) == 0 else NOT_LOCKED)
    if row.cpu is not None:
        try:
            os.sched_setaffinity(0, {row.cpu})
            notes.append(f"cpu {row.cpu}")
        except OSError:
            notes.append(f"no cpu {row.cpu}")
    return ", ".join(notes)[:31] or "other"


def is_urgent(pid: int) -> bool:
    """Whether a process comes before all that have no priority; OSError: there is none."""
    return os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR)


def _reserve(libc: ctypes.CDLL, period_s: float, share: float) -> bool:
    """SCHED_DEADLINE for a share of each period, and of what nobody reserved; False: it may not be had."""
    if not SCHED_SETATTR:
        return False
    period_ns = round(period_s * 1e9)
    wanted = SCHED_ATTR.pack(SCHED_ATTR.size, SCHED_DEADLINE, SCHED_FLAGS, 0, 0, round(share * period_ns), period_ns,
                             period_ns)
    return bool(libc.syscall(SCHED_SETATTR, 0, wanted, 0) == 0)
