"""Ports by name: the class that opens each, and one owner for each on this machine.

A second owner is refused with the name and pid of the first. The owner has an abstract Unix socket in the port's name:
binding it is one atomic step, and the kernel frees it when its owner dies. The socket listens, so that a refused
process can query the owner from the kernel.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from trocar.procs.fpga.port_name import ETHERNET, UDP, PortName, PortNameError
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.ethernet import EthernetTransport, interface_of
from trocar.procs.io.bus.firewire import FirewireTransport
from trocar.procs.io.bus.transport import PortError, Transport
from trocar.procs.io.bus.udp import UdpTransport
from trocar.shm.memory.peers import peer_of

ASK_S: Final = 0.5
ASKERS: Final = 4096  # connections are never accepted: with a full queue, the owner's name is not available


def named(name: str) -> PortName:
    """The parts of a port's name; PortError for ports that cannot be opened."""
    try:
        return PortName.parse(name)
    except PortNameError as error:
        raise PortError(error.what, f"port {name}", f"allowed: {error.allowed}") from error


def transport_of(name: PortName) -> Transport:
    """The transport to the boards of a port; not opened yet."""
    if name.kind == UDP:
        return UdpTransport(name.where, bridge=name.bridge)
    if name.kind == ETHERNET:
        return EthernetTransport(name.where)
    return FirewireTransport(int(name.where))


def port_of(name: str, board_ids: Sequence[int], now_ns: Callable[[], int], options: PortOptions) -> BusPort:
    """The port `name`, as configuration files write it, with its boards; nothing is opened yet. The name determines
    `bridge`.
    """
    parts = named(name)
    return BusPort(transport_of(parts), board_ids, now_ns, replace(options, bridge=parts.bridge))


def hold(port: str) -> socket.socket:
    """Own `port` (as configuration files write it) until the socket is closed; PortError names the present owner."""
    where = f"port {port}"
    name = f"\0trocar~port~{_owned(port)}"
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        lock.bind(name)
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise PortError(f"cannot be held ({error.strerror})", where, "allowed: one owner") from error
        raise PortError(f"in use by {_owner(name)}", where, "allowed: one owner; stop it first") from None
    lock.listen(ASKERS)
    return lock


def _owned(name: str) -> str:
    """The resource with one owner at a time: the same for all names of one bus."""
    parts = named(name)
    if parts.kind == ETHERNET:
        return f"{ETHERNET}:{interface_of(parts.where)}"
    return parts.owned


def _owner(name: str) -> str:
    """The owner: process, system and pid, as far as the kernel reports."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(ASK_S)
            asking.connect(name)
            pid = peer_of(asking).pid
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    except OSError:
        return "another program that is just starting or ending"
    reported = {flag: words[at + 1] for at, flag in enumerate(words[:-1]) if flag in ("--system", "--name")}
    if len(reported) == 2:
        return f"{reported['--name']} of system {reported['--system']} (pid {pid})"
    return f"pid {pid}"
