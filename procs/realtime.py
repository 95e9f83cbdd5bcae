"""What a process asks of the scheduler, so that nobody holds it up: priority, a share of its own, memory, a core.

And in words which processes did not get it, and what grants the rights.
"""

from __future__ import annotations

import ctypes
import os
import platform
import pwd
import struct
from collections.abc import Mapping
from typing import Final

from procs.document.process import Process

PR_SET_NAME, PR_SET_TIMERSLACK = 15, 29
MCL_CURRENT, MCL_FUTURE = 1, 2
SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}.get(platform.machine(), 0)  # glibc has no wrapper before 2.41
SCHED_ATTR = struct.Struct("<IIQiIQQQ")  # size, policy, flags, nice, priority, runtime, deadline, period
SCHED_DEADLINE = 6
SCHED_FLAGS = 1 | 2  # children get none of it; it may have more than it reserved where nobody else did

NO_FIFO, NOT_LOCKED = "no FIFO", "not locked"
"""What was asked for and not got, as `realtime` says it."""
HIGHEST: Final = 98  # the highest priority that a system file may ask for
LIMITS_FILE: Final = "/etc/security/limits.d/trocar.conf"
SYSTEMD: Final = f"LimitRTPRIO={HIGHEST} and LimitMEMLOCK=infinity"


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


def user() -> str:
    """Who we are, as limits.d knows people."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return str(os.getuid())


def limits_lines(name: str) -> tuple[str, str]:
    """The two lines of LIMITS_FILE that grant both rights to a user from the next login on."""
    return f"{name} - rtprio {HIGHEST}", f"{name} - memlock unlimited"


def lacking(policies: Mapping[str, str]) -> str:
    """Several lines for a person; empty where every process got what it asked for. `policies` as `realtime` says them.

    What grants the rights is said for the user we are: whoever looks at a system of somebody else sees the idea.
    """
    slow = [name for name, words in policies.items() if NO_FIFO in words]
    loose = [name for name, words in policies.items() if NOT_LOCKED in words]
    if not slow and not loose:
        return ""
    reported = [f"no real-time priority (FIFO refused): {', '.join(slow)}"] if slow else []
    reported += [f"memory not locked (mlockall refused): {', '.join(loose)}"] if loose else []
    lines = limits_lines(user())
    return "\n".join((
        *reported,
        f"they are late whenever this machine is busy; two lines in {LIMITS_FILE} and a new login grant both:",
        *(f"    {line}" for line in lines),
        f"or, where systemd starts the system, {SYSTEMD} in its unit; trocar doctor looks at the rest of the machine",
    ))
