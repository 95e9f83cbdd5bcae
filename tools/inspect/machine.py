"""Requirements of a robot on its machine: each check returns its finding, and the command that fixes it."""

from __future__ import annotations

import ipaddress
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil

from trocar.procs.machine.logind import at_logout
from trocar.procs.machine.open_files import raised, shortage
from trocar.procs.machine.paths import ROOT, STATE_REMEDY, log_folder, why_not_writable
from trocar.procs.machine.port_holders import SocketHolder, holders
from trocar.procs.native.library import NativeLibrary
from trocar.procs.native.library import native as library
from trocar.procs.node.realtime import (
    CONTAINER,
    LIMITS_FILE,
    NO_FIFO,
    NOT_LOCKED,
    SYSTEMD,
    is_urgent,
    limits_lines,
    user,
)
from trocar.shm.memory.segment import FOLDER
from trocar.tools.inspect import service
from trocar.tools.systems.find import environment, left_over, other_owner
from trocar.tools.systems.processes import running

OK, NOTE, BAD = "ok", "note", "bad"
BOARDS_PORT: Final = 1394
BOARDS_NET: Final = ipaddress.ip_network("169.254.0.0/16")
MEGABYTE: Final = 1e6
ENOUGH_MB, MIN_MB = 256.0, 64.0  # a full system of seven arms takes about 100
GOOD_CORES: Final = 4
FREE_CORES: Final = 2.0  # io and arms of one robot, and their other needs
LOOK_S: Final = 1.0
BUSY_PERCENT: Final = 20.0  # of a core, from which on a process is named
NAMED: Final = 3
ETHERNET: Final = "1"  # as /sys/class/net/*/type has it
CONTAINER_MARKS: Final = (".dockerenv", "run/.containerenv")
ASK: Final = """
from trocar.procs.document.process import Process
from trocar.procs.node.realtime import in_words, lock_memory, realtime
print(in_words([*realtime(Process("doctor", "io", 0.001, priority=90), "wall"), lock_memory()]).decode())
"""


@dataclass(frozen=True, slots=True)
class MachineFinding:
    """One thing looked at: `state` is ok, note (fine to try things) or bad (a robot does not run well)."""

    check: str
    state: str
    found: str
    mend: str = ""  # a command; empty: nothing to fix


def findings() -> Iterator[MachineFinding]:
    """All of them; takes a good second, in which the processors are measured."""
    yield kernel()
    yield compiled(library())
    yield rights(obtained())
    yield cores(len(psutil.Process().cpu_affinity()))
    yield governor()
    yield shared_memory()
    yield logout(*at_logout(os.getuid()))
    yield state_folder(os.environ)
    yield open_files(*resource.getrlimit(resource.RLIMIT_NOFILE))
    yield ports(holders(BOARDS_PORT))
    yield network(psutil.net_if_addrs())
    yield firewire()
    yield from as_service()
    yield from load()


def kernel(root: Path = Path("/")) -> MachineFinding:
    """The kernel's version, and whether it is a real-time one."""
    release = platform.release()
    if _text(root / "sys/kernel/realtime") == "1":
        return MachineFinding("kernel", OK, f"{release}, real-time (PREEMPT_RT)")
    mend = "sudo apt-get install linux-image-rt-amd64    # Ubuntu: sudo pro enable realtime-kernel"
    return MachineFinding("kernel", NOTE, f"{release}, no real-time kernel: occasionally late by milliseconds", mend)


def compiled(found: NativeLibrary) -> MachineFinding:
    """Whether the most expensive parts of io, arms and emulated boards run in C, and in which file."""
    if found.library is not None:
        return MachineFinding("compiled part", OK, f"io, arms and emulated boards run in C: {found.file}")
    text = f"io, arms and emulated boards run on numpy, at two to five times the cost: {found.why}"
    mend = "sudo apt-get install gcc libc6-dev    # then python -m trocar.procs.native.build"
    return MachineFinding("compiled part", NOTE, text, mend)


def obtained() -> str:
    """Real-time properties of one of our processes, tested with one, in the words of `realtime`."""
    done = subprocess.run([sys.executable, "-P", "-c", ASK], cwd=ROOT, env=environment(), capture_output=True,
                          text=True, errors="replace", check=False)
    return done.stdout.strip() or f"{NO_FIFO}, {NOT_LOCKED}"


def rights(words: str, root: Path = Path("/")) -> MachineFinding:
    """Real-time priority and locked memory."""
    lacking = [text for mark, text in ((NO_FIFO, "no real-time priority"), (NOT_LOCKED, "memory cannot be locked"))
               if mark in words]
    if not lacking:
        return MachineFinding("rights", OK, words)
    lines = limits_lines(user())
    quoted = " ".join(f"'{line}'" for line in lines)
    mend = f"printf '%s\\n' {quoted} | sudo tee -a {LIMITS_FILE}    # then log in again; systemd: {SYSTEMD}"
    if set(lines) <= set(_text(root / LIMITS_FILE[1:]).splitlines()):
        mend = f"log in again: {LIMITS_FILE} has been changed since your login"
    if any((root / mark).exists() for mark in CONTAINER_MARKS):
        mend = f"docker run {CONTAINER}"
    return MachineFinding("rights", BAD, f"{' and '.join(lacking)} for {user()}", mend)


def cores(count: int) -> MachineFinding:
    """Number of cores that we may use."""
    found = f"{count} to use"
    if count >= GOOD_CORES:
        return MachineFinding("cores", OK, found)
    mend = "trocar up SYSTEM --set io.period_s=0.001 --set arm.period_s=0.002"
    state = BAD if count < 2 else NOTE
    return MachineFinding("cores", state, f"{found}: enough for longer periods only; {GOOD_CORES} are good", mend)


def governor(root: Path = Path("/")) -> MachineFinding:
    """Whether idle cores lower their clock rate, which delays them when they are needed."""
    files = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    names = sorted({_text(file) for file in files})
    if not names:
        return MachineFinding("governor", OK, "none (a virtual machine, or a fixed frequency)")
    if names == ["performance"]:
        return MachineFinding("governor", OK, "performance")
    mend = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
    return MachineFinding("governor", NOTE, f"{', '.join(names)}: cores sleep, and wake late", mend)


def shared_memory(folder: Path = FOLDER) -> MachineFinding:
    """Whether there is room, and whether crashed systems have left segments in it."""
    try:
        free_mb = os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize / MEGABYTE
    except OSError as error:
        return MachineFinding("shared memory", BAD, f"{folder}: {error.strerror}",
                              f"sudo mount -t tmpfs tmpfs {folder}")
    found = f"{free_mb:.0f} MB free in {folder}"
    if free_mb < ENOUGH_MB:
        mend = f"sudo mount -o remount,size=1G {folder}    # docker run --shm-size=1g"
        return MachineFinding("shared memory", BAD if free_mb < MIN_MB else NOTE, found, mend)
    left = left_over()
    if left:
        return MachineFinding("shared memory", NOTE, f"{found}; crashed systems have left:  {', '.join(left)}",
                              "; ".join(map(_down, left)))
    return MachineFinding("shared memory", OK, found)


def logout(wrong: str, mend: str) -> MachineFinding:
    """Whether logind removes our shared memory when we log out."""
    return MachineFinding("logout", NOTE if wrong else OK, wrong or "shared memory stays when you log out", mend)


def state_folder(environ: Mapping[str, str]) -> MachineFinding:
    """Whether logs and recordings have a place."""
    folder = log_folder(environ, "").absolute()
    why = why_not_writable(folder)
    return MachineFinding("state folder", BAD if why else OK, f"{folder}{f': {why}' if why else ''}",
                          STATE_REMEDY if why else "")


def open_files(soft: int, hard: int) -> MachineFinding:
    """Maximum number of open files per process: the recorder and bridges open every ring."""
    wrong, mend = shortage(soft, hard)
    return MachineFinding("open files", BAD if wrong else OK, wrong or f"{raised(soft, hard)} for each process", mend)


def ports(found: Iterable[SocketHolder]) -> MachineFinding:
    """Whether another program has the boards' port at all addresses: no emulated boards can start then."""
    holding = list(found)
    others = [holder for holder in holding if ipaddress.ip_address(holder.address).is_unspecified]
    if not others:
        rest = f", not for boards at 0.0.0.0: {'; '.join(map(str, holding))}" if holding else ""
        return MachineFinding("ports", OK, f"UDP {BOARDS_PORT} is free for emulated boards, each at its address{rest}")
    known = next((holder for holder in others if holder.pid), None)
    mend = (f"sudo fuser -k {BOARDS_PORT}/udp" if known is None else _down(known.system) if known.system
            else f"kill {known.pid}")
    return MachineFinding("ports", BAD, "; ".join(map(str, others)), mend)


def network(addresses: Mapping[str, Sequence[Any]], root: Path = Path("/")) -> MachineFinding:
    """Ethernet interfaces, and whether one has an address among those of real boards."""
    cards = [folder for folder in sorted((root / "sys/class/net").glob("*")) if _text(folder / "type") == ETHERNET]
    reported, reaches = [], False
    for card in cards:
        own = [row.address for row in addresses.get(card.name, []) if row.family.name == "AF_INET"]
        reaches |= any(ipaddress.ip_address(address) in BOARDS_NET for address in own)
        reported.append(" ".join((card.name, _text(card / "operstate") or "?", *own)))
    if not cards:
        return MachineFinding("network", NOTE, "no Ethernet interface: real boards need one, or FireWire",
                              "lspci | grep -i ethernet")
    if reaches:
        return MachineFinding("network", OK, "; ".join(reported))
    free = next((card.name for card in cards if not addresses.get(card.name)), cards[0].name)
    return MachineFinding("network", NOTE, f"{'; '.join(reported)}: none in {BOARDS_NET}, where boards on UDP are",
                          f"sudo ip address add 169.254.0.1/16 dev {free}")


def firewire(root: Path = Path("/")) -> MachineFinding:
    """Whether there are cards and controllers, and whether we may use them."""
    devices = service.firewire_devices(root)
    closed = [device for device in devices if not os.access(device, os.R_OK | os.W_OK)]
    if not devices:
        return MachineFinding("FireWire", NOTE, "no card: boards on a port fw need one",
                              "lspci | grep -i firewire    # where it has one: sudo modprobe firewire-ohci")
    if not closed:
        return MachineFinding("FireWire", OK, ", ".join(map(str, devices)))
    return MachineFinding("FireWire", BAD, f"no right to use {', '.join(map(str, closed))}",
                          f"{service.opens(closed[0], user())}    # then log in again")


def as_service(root: Path = Path("/")) -> Iterator[MachineFinding]:
    """The unit of systemd that starts a robot, if there is one."""
    unit = service.installed(root)
    if unit is None:
        return
    wrong = list(unit.problems(root))
    for text, mend in wrong:
        yield MachineFinding("service", BAD, text, mend)
    if not wrong:
        yield MachineFinding("service", OK, f"{unit.file} runs as {unit.user}")


def load() -> Iterator[MachineFinding]:
    """Load of the cores by other programs, the largest consumers, and other real-time processes."""
    processes = list(psutil.process_iter(["name", "username"]))
    for process in processes:
        _percent(process)
    usage = psutil.cpu_percent(interval=LOOK_S, percpu=True)
    allowed = psutil.Process().cpu_affinity()
    free = sum(100.0 - percent for core, percent in enumerate(usage) if core in allowed) / 100.0
    own = {row.pid: row.system for row in running(foreign=True)}
    us = psutil.Process().username()
    busy = [Busy(_percent(process), process.pid, str(process.info["name"]), own.get(process.pid, ""),
                 whose if (whose := str(process.info["username"])) != us else "")
            for process in processes if process.pid != os.getpid()]
    yield free_cpu(free, sorted(busy, key=lambda row: -row.percent))
    yield urgent([(row.pid, row.name) for row in busy if not row.system and _is_realtime(row.pid)])


@dataclass(frozen=True, slots=True)
class Busy:
    """A process, its share of a core, and its system; empty: none."""

    percent: float
    pid: int
    name: str
    system: str = ""
    user: str = ""
    """Its user, if that is another one."""

    def __str__(self) -> str:
        whose = f" of system {self.system}" if self.system else f" of user {self.user}" if self.user else ""
        return f"{self.name}{whose} (pid {self.pid}) {self.percent:.0f} %"


def free_cpu(free: float, busy: Iterable[Busy]) -> MachineFinding:
    """`free` cores, and the busy processes, the busiest first."""
    found = f"{free:.1f} cores"
    if free >= FREE_CORES:
        return MachineFinding("free CPU", OK, found)
    most = [row for row in busy if row.percent >= BUSY_PERCENT][:NAMED]
    others = [str(row.pid) for row in most if not (row.system or row.user)]  # no system, and nothing of another user
    own = next((_down(row.system) for row in most if row.system), "top")
    names = ", ".join(map(str, most)) or "no program for long"
    mend = f"renice 19 -p {' '.join(others)}" if others else own
    return MachineFinding("free CPU", BAD if free < 1.0 else NOTE, f"{found}; busy: {names}", mend)


def urgent(others: Iterable[tuple[int, str]]) -> MachineFinding:
    """Foreign programs with real-time priority: they precede everything else."""
    rows = list(others)
    if not rows:
        return MachineFinding("other real time", OK, "none")
    names = ", ".join(f"{name} (pid {pid})" for pid, name in rows[:NAMED])
    return MachineFinding("other real time", NOTE, f"{names}{', …' if len(rows) > NAMED else ''}",
                          f"sudo chrt -o -p 0 {rows[0][0]}")


def _down(system: str) -> str:
    """The command that ends a system, and who can run it if it is another user's."""
    owner = other_owner(system)
    return f"trocar down --system {system}{f'    # by {owner}: it is their system' if owner else ''}"


def _is_realtime(pid: int) -> bool:
    """Whether it is a program with a real-time policy; the kernel's own threads do not count."""
    try:
        return is_urgent(pid) and bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    except OSError:
        return False


def _percent(process: psutil.Process) -> float:
    """Of one core since the last call."""
    try:
        return float(process.cpu_percent())
    except psutil.Error:
        return 0.0


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
