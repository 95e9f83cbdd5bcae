"""Listening sockets of processes: held by us, so that nobody who connects is refused while no process is there."""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import Final

from trocar.procs.document.process import Process, host_and_port
from trocar.procs.machine.port_holders import TCP, connections, holders

BACKLOG: Final = 128
LOOK_NS: Final = 500_000_000  # between two looks at the kernel's list of connections


class AddressTaken(Exception):
    """Nobody can listen there; the message names the process, the address, and who has it."""


class Listening:
    """The sockets of one process, in the order of its row."""

    def __init__(self, row: Process) -> None:
        """AddressTaken when one cannot be had."""
        self._ports = [host_and_port(address)[1] for address in row.listen]
        self._poll, self._look_at, self._connected = select.poll(), 0, False
        with ExitStack() as stack:
            self.sockets: Sequence[socket.socket] = [stack.enter_context(_socket(row.name, at)) for at in row.listen]
            self._held = stack.pop_all()
        for each in self.sockets:
            self._poll.register(each, select.POLLIN)

    def is_wanted(self, now_ns: int, is_running: bool, is_refused: bool = False, is_last: bool = False) -> bool:
        """Whether somebody is connected, or waits to be; only a process can have connections, also in its setup.

        `is_refused`: it is not going to be there, whoever waits. They are told so by the end of their connections, and
        count as long as they try again: one who has gone would otherwise wait for ever. `is_last`: the answer is of
        this moment, else LOOK_NS old at most.
        """
        if self._poll.poll(0):
            if is_refused:
                self._turn_away()
            return True
        if not is_running:
            self._connected = False
        elif is_last or now_ns >= self._look_at:
            self._look_at, self._connected = now_ns + LOOK_NS, any(map(connections, self._ports))
        return self._connected

    def _turn_away(self) -> None:
        for each in self.sockets:
            with suppress(OSError):  # nobody waits any more
                while True:
                    each.accept()[0].close()

    def close(self) -> None:
        """Nobody listens any more."""
        self._held.close()


def _socket(name: str, address: str) -> socket.socket:
    host, port = host_and_port(address)
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # old connections are in nobody's way
        made.bind((host, port))
        made.listen(BACKLOG)
        made.setblocking(False)
    except OSError as error:
        made.close()
        others = "; ".join(map(str, holders(port, host, TCP))) if error.errno == errno.EADDRINUSE else ""
        raise AddressTaken(f"{name} cannot listen at {address}: {others or error.strerror}") from None
    return made
