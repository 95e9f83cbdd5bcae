"""Processes of our systems in the kernel's list: found by their command lines, independent of shared memory."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from trocar.shm.memory import owners
from trocar.shm.memory.segment import start_time

SUPERVISOR = "supervisor"
TERMINATE, KILL, CONTINUE = 15, 9, 18  # signals
COMMISSION = "commission"  # the verb
DOOR = re.compile(r"trocar\.procs\.(\w+)\.loop")


@dataclass(frozen=True, slots=True)
class RunningProcess:
    """One process; with its start (ticks since boot) the pid names it for good."""

    system: str
    instance: str
    pid: int
    start: int

    def send(self, number: int) -> bool:
        """Send it a signal; False if it is gone (a new process with its pid is not hit) or not ours to signal."""
        if start_time(self.pid) != self.start:
            return False
        try:
            os.kill(self.pid, number)
        except (ProcessLookupError, PermissionError):
            return False
        return True

    def __str__(self) -> str:
        return f"{self.instance} (pid {self.pid})"


def running(system: str | None = None, *, foreign: bool = False) -> list[RunningProcess]:
    """All processes of a system, or of all, of trusted users; with `foreign` of all users. The supervisor first."""
    trusted = None if foreign else owners.accepted()
    found = [_parsed(folder, trusted) for folder in Path("/proc").iterdir() if folder.name.isdigit()]
    rows = [row for row in found if row is not None and system in (None, row.system)]
    return sorted(rows, key=lambda row: (row.instance != SUPERVISOR, row.start, row.pid))


@dataclass(frozen=True, slots=True)
class ParentProcess:
    """The parent of a process, with its command line in words."""

    pid: int
    command: tuple[str, ...]


def parent_of(pid: int) -> ParentProcess | None:
    """The parent of a process; None if it has ended, or we may not look."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        parent = int(text.rsplit(")", 1)[1].split()[1])
        words = Path(f"/proc/{parent}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except (OSError, ValueError):
        return None
    return ParentProcess(parent, tuple(words))


def commissioning(supervisor: int) -> int:
    """The pid of the `trocar commission` that started this supervisor; 0: another program did."""
    parent = parent_of(supervisor) if supervisor else None
    if parent is None:
        return 0
    verbs = (verb for word, verb in pairwise(parent.command) if Path(word).name == "trocar")
    return parent.pid if next(verbs, "") == COMMISSION else 0


def _parsed(folder: Path, trusted: frozenset[int] | None) -> RunningProcess | None:
    """One of ours, or None; a process that has ended and was not waited for has no command line."""
    try:
        words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
        uid = folder.stat().st_uid
    except OSError:
        return None
    door = DOOR.fullmatch(_after(words, "-m"))
    pid, system = int(folder.name), _after(words, "--system")
    is_trusted = trusted is None or uid in trusted
    if door is None or not system or not is_trusted or not (start := start_time(pid)):
        return None
    instance = SUPERVISOR if door.group(1) == SUPERVISOR else _after(words, "--name")
    return RunningProcess(system, instance, pid, start)


def _after(words: list[str], option: str) -> str:
    return words[words.index(option) + 1] if option in words[:-1] else ""
