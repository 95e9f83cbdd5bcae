"""Real-time properties of a process: priority, reserved CPU share, locked memory, cores.

Also reports, in words, which processes were refused them, and how to grant the rights.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import pwd
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from trocar.procs.document.process import Process

if TYPE_CHECKING:
    from trocar.procs.document.system import SystemConfig

PR_SET_NAME, PR_SET_TIMERSLACK = 15, 29
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
POPULATE_READ, POPULATE_WRITE = 22, 23  # of madvise
SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}.get(platform.machine(), 0)  # glibc has no wrapper before 2.41
SCHED_ATTR = struct.Struct("<IIQiIQQQ")  # size, policy, flags, nice, priority, runtime, deadline, period
SCHED_DEADLINE = 6
SCHED_FLAGS = 1 | 2  # not inherited by children; may use more than its reservation where no other process reserved

MAX_SPIN_US: Final = 50.0
LOCKED: Final = "locked"
NO_FIFO, NOT_LOCKED = "no FIFO", "not locked"
"""Refused requests, in the words of `realtime` and `lock_memory`."""
ORDINARY: Final = "other"
"""Nothing was requested."""
HIGHEST: Final = 98  # the highest priority that a system file may ask for
LOWEST: Final = 1  # of FIFO
LIMITS_FILE: Final = "/etc/security/limits.d/trocar.conf"
SYSTEMD: Final = f"LimitRTPRIO={HIGHEST} and LimitMEMLOCK=infinity"
CONTAINER: Final = f"--ulimit rtprio={HIGHEST} --ulimit memlock=-1"
CPUS: Final = Path("/sys/devices/system/cpu")
REGION = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S{4}) ([0-9a-f]+) \S+ \d+ *(.*)")


def realtime(row: Process, clock: str, *, reserved: float = 0.0) -> list[str]:
    """Set name, timer slack, priority and cores; returns the properties obtained, in words. Children inherit none.

    `reserved` is the guaranteed share of each period: Linux stops all FIFO processes for 50 ms when together they
    leave no time to others for a second, and a bus must not suffer from arms that take too long. A reservation cannot
    be combined with chosen cores. In lock-step nothing is urgent, and loops that never sleep must not keep others off
    the cores, so no priority is set.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(PR_SET_NAME, row.name.encode()[:15], 0, 0, 0)
    libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    notes = []
    if row.priority > 0 and clock == "wall" and reserved and not row.cpus and _reserve(libc, row.period_s, reserved):
        notes.append("deadline")
    elif row.priority > 0 and clock == "wall":
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(row.priority))
            notes.append(f"FIFO {row.priority}")
        except OSError:  # no right to it
            notes.append(NO_FIFO)
    if row.cpus:
        try:
            os.sched_setaffinity(0, row.cpus)
            notes.append(f"cpu {_ranges(row.cpus)}")
        except OSError:
            notes.append(f"no cpu {_ranges(row.cpus)}")
    return notes


def step_back() -> None:
    """Lower a FIFO process to the lowest FIFO priority, until `realtime` is called again; others are unchanged."""
    if is_urgent(0):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(LOWEST))


def keep_with(pid: int) -> None:
    """Give a process our CPU affinity; no effect on one that has ended."""
    with contextlib.suppress(ProcessLookupError):
        os.sched_setaffinity(pid, os.sched_getaffinity(0))


def cores() -> tuple[tuple[int, ...], ...]:
    """The processors that we may run on, grouped by core (hyper-threading), in order."""
    allowed = sorted(os.sched_getaffinity(0))
    found: dict[str, list[int]] = {}
    for cpu in allowed:
        try:
            siblings = (CPUS / f"cpu{cpu}/topology/thread_siblings_list").read_text()
        except OSError:  # unknown: a core of its own
            siblings = str(cpu)
        found.setdefault(siblings, []).append(cpu)
    return tuple(map(tuple, found.values()))


def _ranges(cpus: Iterable[int]) -> str:
    """Numbers as Linux writes them: 0,2-5."""
    found: list[list[int]] = []
    for cpu in sorted(cpus):
        if found and found[-1][-1] == cpu - 1:
            found[-1].append(cpu)
        else:
            found.append([cpu])
    return ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in found)


def in_words(notes: list[str]) -> bytes:
    """The notes of `realtime` and `lock_memory` for the control page; the long one comes last and may be cut."""
    return (", ".join(sorted(notes, key=lambda note: "cpu" in note))[:31] or ORDINARY).encode()


@dataclass(frozen=True, slots=True)
class Region:
    """A region of a process's memory as listed by /proc, sizes in bytes."""

    begin: int
    size: int
    rights: str  # as in "r-xp"
    offset: int  # in its file
    file: str


def regions(pid: int) -> list[Region]:
    """The memory of a process; OSError when it is gone."""
    with Path(f"/proc/{pid}/maps").open(encoding="utf-8", errors="replace") as lines:  # line by line: saves memory
        return [Region(int(row[1], 16), int(row[2], 16) - int(row[1], 16), row[3], int(row[4], 16), row[5])
                for row in map(REGION.match, lines) if row is not None]


def lock_memory() -> str:
    """Prevent the loop from waiting for a page: lock the pages that we have, and fetch those of our files.

    Pages that we share with the process that has forked us stay shared: our first write to one copies it, in 2 µs. So
    does the first use of a new page. Both are locked then (MCL_ONFAULT), and neither waits for a disk. The supervisor
    locks segments and code for all (procs/supervisor/shared_pages.py). Returns the result in words.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
        return NOT_LOCKED
    try:
        _fetch_each(libc, regions(os.getpid()))
    except PermissionError:  # an interpreter with file capabilities may not read its own maps: lock everything
        libc.mlockall(MCL_CURRENT | MCL_FUTURE)
    return LOCKED


def fetch_segments() -> None:
    """Fetch the pages of shared-memory segments that were mapped since `lock_memory`."""
    with contextlib.suppress(PermissionError):
        found = [region for region in regions(os.getpid()) if region.file.startswith("/dev/shm/")]
        _fetch_each(ctypes.CDLL(None), found)


def _fetch_each(libc: ctypes.CDLL, listed: Iterable[Region]) -> None:
    """Map the pages of files, without a copy; before Linux 5.14 no effect: they are mapped on first use."""
    for region in listed:
        place, own = (ctypes.c_void_p(region.begin), ctypes.c_size_t(region.size)), region.rights.endswith("p")
        if not own or "x" in region.rights:
            libc.munlock(*place)  # the supervisor locks it
        if region.file.startswith("/"):
            libc.madvise(*place, POPULATE_READ if own or "w" not in region.rights else POPULATE_WRITE)


def is_urgent(pid: int) -> bool:
    """Whether a process has real-time priority (FIFO or RR); OSError: no such process."""
    return os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR)


def _reserve(libc: ctypes.CDLL, period_s: float, share: float) -> bool:
    """Request SCHED_DEADLINE for a share of each period, plus unreserved time; False if it is refused."""
    if not SCHED_SETATTR:
        return False
    period_ns = round(period_s * 1e9)
    wanted = SCHED_ATTR.pack(SCHED_ATTR.size, SCHED_DEADLINE, SCHED_FLAGS, 0, 0, round(share * period_ns), period_ns,
                             period_ns)
    return bool(libc.syscall(SCHED_SETATTR, 0, wanted, 0) == 0)


def spin_ns(system: SystemConfig, name: str) -> int:
    """Spin time of an io, as configured for its bus; 0 on the only core, and without boards, where it has no use."""
    spin_us = next((io.spin_us for io in system.ios if io.name == name and io.port), 0.0)
    given = system.process(name).cpus  # not ours yet: we begin where the supervisor may run
    return round(min(spin_us, MAX_SPIN_US) * 1e3) if given or len(os.sched_getaffinity(0)) > 1 else 0


def user() -> str:
    """Our user name, as limits.d expects it."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return str(os.getuid())


def limits_lines(name: str) -> tuple[str, str]:
    """The two lines of LIMITS_FILE that grant both rights to a user from the next login on."""
    return f"{name} - rtprio {HIGHEST}", f"{name} - memlock unlimited"


def refused(policies: Mapping[str, str]) -> list[str]:
    """Refused rights with the processes concerned, one line each; `policies` in the words of `realtime`."""
    slow = [name for name, words in policies.items() if NO_FIFO in words]
    loose = [name for name, words in policies.items() if NOT_LOCKED in words]
    reported = [f"no real-time priority (FIFO refused): {', '.join(slow)}"] if slow else []
    return reported + ([f"memory not locked (mlockall refused): {', '.join(loose)}"] if loose else [])


def lacking(policies: Mapping[str, str]) -> str:
    """`refused` with instructions that grant the rights to our user; empty if nothing was refused."""
    lines = limits_lines(user())
    return "" if not (reported := refused(policies)) else "\n".join((
        *reported,
        f"they are late whenever this machine is busy; two lines in {LIMITS_FILE} and a new login grant both:",
        *(f"    {line}" for line in lines),
        f"or, where systemd starts the system, {SYSTEMD} in its unit; trocar doctor checks the rest of the machine",
    ))
