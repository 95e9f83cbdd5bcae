"""Programs that use a port of this machine, by the Linux kernel's lists of sockets, for messages to people.

Also the number of connections to a port.
"""

from __future__ import annotations

import contextlib
import pwd
from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import IPv4Address, ip_address
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
UDP, TCP = "udp", "tcp"
_ESTABLISHED, _LISTEN = "01", "0A"
_FROM_US: Final = ("01", "04", "05")  # established, or closed for writing
_MAPPED: Final = b"\0" * 10 + b"\xff\xff"  # before an IPv4 address in an IPv6 one


@dataclass(frozen=True, slots=True)
class SocketHolder:
    """A socket: its address and owner. `pid` 0: a program of another user, whose details the Linux kernel hides."""

    address: str
    port: int
    user: str
    pid: int = 0
    program: str = ""
    system: str = ""  # the system of one of our processes

    def __str__(self) -> str:
        who = f"{self.program} (pid {self.pid})" if self.pid else f"a program of user {self.user}"
        return f"{who} has {self.address}:{self.port}"


def holders(port: int, address: str = "0.0.0.0", protocol: str = UDP) -> tuple[SocketHolder, ...]:
    """Holders of sockets that conflict with this address and port; for 0.0.0.0, all holders of the port."""
    found = [row for row in _sockets(protocol, port) if _meet(row.address, address)
             and (protocol == UDP or row.state == _LISTEN)]
    owners = dict(_owners({row.inode for row in found})) if found else {}
    return tuple(SocketHolder(row.address, port, _user(row.uid), *owners.get(row.inode, ())) for row in found)


def connections(port: int) -> int:
    """Number of established TCP connections to this port, at any of our addresses."""
    return sum(row.state == _ESTABLISHED for row in _sockets(TCP, port))


def client_user(address: str, port: int, to: int) -> int | None:
    """The user id of the program with a connection from this local address and port to our port `to`; None: no such
    connection.
    """
    return next((row.uid for row in _sockets(TCP, port) if row.to == to and row.address == address
                 and row.state in _FROM_US and row.inode != "0"), None)  # inode 0: no longer held, shown as user 0


@dataclass(frozen=True, slots=True)
class _Row:
    address: str
    state: str
    inode: str
    uid: int
    to: int


def _meet(one: str, other: str) -> bool:
    return one == other or any(ip_address(address).is_unspecified for address in (one, other))


def _sockets(protocol: str, port: int) -> Iterator[_Row]:
    """All sockets with this local port, IPv4 and IPv6."""
    ending = f":{port:04X}"
    for table in (protocol, f"{protocol}6"):
        try:
            lines = (PROC / "net" / table).read_text().splitlines()[1:]
        except OSError:  # no IPv6
            continue
        for line in lines:
            words = line.split(maxsplit=10)
            if words[1].endswith(ending):
                yield _Row(_address(words[1].partition(":")[0]), words[3], words[9], int(words[7]),
                           int(words[2].partition(":")[2], 16))


def _address(text: str) -> str:
    """An address in the kernel's notation: words of four bytes, each in the machine's byte order."""
    data = b"".join(bytes.fromhex(text[at : at + 8])[::-1] for at in range(0, len(text), 8))
    return str(IPv4Address(data[-4:]) if data.startswith(_MAPPED) else ip_address(data))


def _owners(inodes: set[str]) -> Iterator[tuple[str, tuple[int, str, str]]]:
    wanted = {f"socket:[{inode}]": inode for inode in inodes}
    for folder in PROC.iterdir():
        if not folder.name.isdigit():
            continue
        with contextlib.suppress(OSError):  # it has ended, or is not readable
            for link in (folder / "fd").iterdir():
                inode = wanted.get(_target(link), "")
                if inode:
                    yield inode, (int(folder.name), *_program(folder))


def _target(link: Path) -> str:
    with contextlib.suppress(OSError):
        return str(link.readlink())
    return ""


def _program(folder: Path) -> tuple[str, str]:
    """A readable name (one of our processes with its system, else the name of the program), and the system."""
    words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
    reported = {flag: words[at + 1] for at, flag in enumerate(words[:-1]) if flag in ("--system", "--name")}
    if len(reported) == 2:
        return f"{reported['--name']} of system {reported['--system']}", reported["--system"]
    return (folder / "comm").read_text().strip(), ""


def _user(uid: int) -> str:
    with contextlib.suppress(KeyError):
        return pwd.getpwuid(uid).pw_name
    return str(uid)
