"""Listening sockets of processes: kept open by us, so that clients can connect while the process is down."""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import Final

from trocar.procs.document.process import Process, host_and_port
from trocar.procs.machine.port_holders import TCP, connections, holders
from trocar.procs.node.setup_error import SetupError

BACKLOG: Final = 128
LOOK_NS: Final = 500_000_000  # polling interval for the Linux kernel's list of connections


class Listening:
    """The sockets of one process, in the order of its row."""

    def __init__(self, row: Process) -> None:
        """Open all sockets; SetupError when that fails."""
        self._ports = [host_and_port(address)[1] for address in row.listen]
        self._poll, self._look_at, self._connected = select.poll(), 0, False
        with ExitStack() as stack:
            self.sockets: Sequence[socket.socket] = [stack.enter_context(_socket(row.name, at)) for at in row.listen]
            self._held = stack.pop_all()
        for each in self.sockets:
            self._poll.register(each, select.POLLIN)

    def is_wanted(self, now_ns: int, is_running: bool, is_refused: bool = False, is_last: bool = False) -> bool:
        """Whether clients are connected, or wait for that; only a process, even in its setup, can have connections.

        `is_refused`: the process will not start, so waiting clients are disconnected; they count as demand as long as
        they retry, so that clients that have gone do not count forever. `is_last`: the answer must be up to date,
        otherwise it may be LOOK_NS old.
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
            with suppress(OSError):  # no more waiting clients
                while True:
                    each.accept()[0].close()

    def close(self) -> None:
        """Close all sockets."""
        self._held.close()


def _socket(name: str, address: str) -> socket.socket:
    host, port = host_and_port(address)
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # old connections do not block the address
        made.bind((host, port))
        made.listen(BACKLOG)
        made.setblocking(False)
    except OSError as error:
        made.close()
        others = "; ".join(map(str, holders(port, host, TCP))) if error.errno == errno.EADDRINUSE else ""
        raise SetupError(f"{name} cannot listen at {address}: {others or error.strerror}") from None
    return made
