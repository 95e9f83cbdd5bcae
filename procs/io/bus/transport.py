"""What carries datagrams to the boards of a bus and their replies back: a UDP socket, raw Ethernet, a FireWire card."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

from trocar.procs.fpga import wire
from trocar.procs.node.setup_error import SetupError

RECEIVE_BUFFER_BYTES: Final = 1 << 20  # asked for; the kernel doubles it
MIN_QUEUED_BYTES: Final = 512  # what it counts for any datagram, at least
MAX_QUEUED: Final = 2 * RECEIVE_BUFFER_BYTES // MIN_QUEUED_BYTES  # datagrams that a socket may hold


class PortError(SetupError):
    """A bus that cannot be used: what is wrong, where, and what would be right."""

    def __init__(self, what: str, where: str, allowed: str) -> None:
        super().__init__(f"{where}: {what}; {allowed}")
        self.what = what
        self.where = where
        self.allowed = allowed


class Transport(ABC):
    """The means of transport of one bus. Requests and replies have the form of `wire`, whatever is on the cable."""

    where: str
    """The other end, for messages."""
    on_firewire = False
    """True: this computer is a node of the bus itself; there is no hub between."""
    gives_address: int | None = None
    """What the hub's address register is set to when a bus is found; None: boards need no address."""
    pause_ms = 0
    """How long a board is away after it was given an address."""
    most_read = wire.MAX_DATA
    """Bytes of the largest block that can be read."""
    most_write = wire.MAX_DATA
    """Bytes of the largest block that can be written to one board or to all."""
    send: Callable[[wire.Buffer], object]
    """One request to the node that it names; OSError when it could not be sent, PortError when closed."""
    poll: Callable[[int], object]
    """Wait so many ms at most; true: there is something to receive."""
    recv_into: Callable[[memoryview], int]
    """One reply, and its size; 0: what came was none. OSError as for sockets."""
    fd = -1
    """The socket to which datagrams for the hub are written unchanged, where only its replies arrive; -1: none."""
    stranger = ""
    """Who sent the newest datagram that was refused because it is not from the boards; empty: nobody has."""

    @abstractmethod
    def open(self) -> None:
        """Take what is needed; PortError when that fails."""

    @abstractmethod
    def close(self) -> None:
        """Give it back; harmless when there is nothing."""

    def shut(self) -> None:
        """Nothing can be sent or received from now on."""
        self.send = self.poll = self.recv_into = self._closed

    def _closed(self, _: object) -> int:
        raise self.is_closed()

    def is_closed(self) -> PortError:
        """The transport is used before it was opened."""
        return PortError("the port is closed", self.where, "open it first")

    def forget(self) -> bool:
        """From now on no reply to an earlier request is received. False: that cannot be promised."""
        return False

    @abstractmethod
    def ask_everybody(self) -> int:
        """From now on requests to all reach whoever is there, before anything is known of them.

        The bus generation, where it is known before anybody has replied; else 0.
        """

    @abstractmethod
    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """From now on requests go to the hub, or, `by_board`, to the board with the node's number; BROADCAST: to all.

        The address that the hub must have been given, as its register shows it; 0 where there is none.
        """
