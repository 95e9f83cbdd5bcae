"""What carries datagrams to the boards of a bus and their replies back: a UDP socket, raw Ethernet, a FireWire card."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from trocar.procs.fpga import wire
from trocar.procs.io.bus.port import PortError

RECEIVE_BUFFER_BYTES: Final = 1 << 20  # asked for; the kernel doubles it
MIN_QUEUED_BYTES: Final = 512  # what it counts for any datagram, at least
MAX_QUEUED: Final = 2 * RECEIVE_BUFFER_BYTES // MIN_QUEUED_BYTES  # datagrams that a socket may hold


class Transport(Protocol):
    """The means of transport of one bus. Requests and replies have the form of `wire`, whatever is on the cable."""

    where: str
    """The other end, for messages."""
    on_firewire: bool
    """True: this computer is a node of the bus itself; there is no hub between."""
    gives_address: int | None
    """What the hub's address register is set to when a bus is found; None: boards need no address."""
    pause_ms: int
    """How long a board is away after it was given an address."""
    most_read: int
    """Bytes of the largest block that can be read."""
    most_write: int
    """Bytes of the largest block that can be written to one board or to all."""
    send: Callable[[wire.Buffer], object]
    """One request to the node that it names; OSError when it could not be sent, PortError when closed."""
    poll: Callable[[int], object]
    """Wait so many ms at most; true: there is something to receive."""
    recv_into: Callable[[memoryview], int]
    """One reply, and its size; 0: what came was none. OSError as for sockets."""
    fd: int
    """The socket to which datagrams for the hub are written unchanged, where only its replies arrive; -1: none."""
    stranger: str
    """Who sent the newest datagram that was refused because it is not from the boards; empty: nobody has."""

    def open(self) -> None:
        """Take what is needed; PortError when that fails."""

    def close(self) -> None:
        """Give it back; harmless when there is nothing."""

    def forget(self) -> bool:
        """From now on no reply to an earlier request is received. False: that cannot be promised."""

    def ask_everybody(self) -> int:
        """From now on requests to all reach whoever is there, before anything is known of them.

        The bus generation, where it is known before anybody has replied; else 0.
        """

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """From now on requests go to the hub, or, `by_board`, to the board with the node's number; BROADCAST: to all.

        The address that the hub must have been given, as its register shows it; 0 where there is none.
        """


def closed(where: str) -> PortError:
    """The transport is used before it was opened."""
    return PortError("the port is closed", where, "open it first")
