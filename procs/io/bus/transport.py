"""Transports carry datagrams to the boards of a bus and replies back: a UDP socket, raw Ethernet, a FireWire card."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

from trocar.procs.fpga import wire
from trocar.procs.node.setup_error import SetupError

RECEIVE_BUFFER_BYTES: Final = 1 << 20  # requested; the kernel doubles it
MIN_QUEUED_BYTES: Final = 512  # what the kernel counts for any datagram, at least
MAX_QUEUED: Final = 2 * RECEIVE_BUFFER_BYTES // MIN_QUEUED_BYTES  # datagrams that a socket may hold


class PortError(SetupError):
    """A bus that cannot be used: the problem, its place, and the allowed values."""

    def __init__(self, what: str, where: str, allowed: str) -> None:
        super().__init__(f"{where}: {what}; {allowed}")


class Transport(ABC):
    """Transport of one bus. Requests and replies have the form of `wire` on every medium."""

    where: str
    """The other end, for messages."""
    on_firewire = False
    """True: this computer is a node of the bus itself; there is no hub between."""
    gives_address: int | None = None
    """Written to the hub's address register when a bus is found; None: boards need no address."""
    pause_ms = 0
    """How long a board is silent after it was given an address."""
    most_read = wire.MAX_DATA
    """Bytes of the largest block that can be read."""
    most_write = wire.MAX_DATA
    """Bytes of the largest block that can be written to one board or to all."""
    send: Callable[[wire.Buffer], object]
    """Send one request to the node that it names; OSError if it could not be sent, PortError if closed."""
    poll: Callable[[int], object]
    """Wait this many ms at most; true: a datagram can be received."""
    recv_into: Callable[[memoryview], int]
    """Receive one reply, and return its size; 0: the datagram was no reply. OSError as for sockets."""
    fd = -1
    """The socket to which datagrams for the hub are written unchanged, and which receives only its replies; -1: none.
    """
    stranger = ""
    """Sender of the newest datagram refused because it is not from the boards; empty: there was none."""

    @abstractmethod
    def open(self) -> None:
        """Open the transport's resources; PortError if that fails."""

    @abstractmethod
    def close(self) -> None:
        """Release the resources; harmless if there are none."""

    def shut(self) -> None:
        """End sending and receiving."""
        self.send = self.poll = self.recv_into = self._closed

    def _closed(self, _: object) -> int:
        raise self.is_closed()

    def is_closed(self) -> PortError:
        """The error for a transport that is used before it is opened."""
        return PortError("the port is closed", self.where, "open it first")

    def forget(self) -> bool:
        """Receive no more replies to earlier requests. False: this cannot be guaranteed."""
        return False

    @abstractmethod
    def ask_everybody(self) -> int:
        """Address requests to all boards on the bus, before any of them is known.

        Returns the bus generation if it is known before the first reply; else 0.
        """

    @abstractmethod
    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """Address requests to the hub, or, `by_board`, to the board with the node's number; BROADCAST: to all.

        Returns the address that the hub must have been given, as its register shows it; 0 if there is none.
        """
