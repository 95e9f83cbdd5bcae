"""The process at the other end of a connected Unix socket, as the kernel reports it."""

from __future__ import annotations

import socket
import struct
from typing import Final, NamedTuple

_CREDENTIALS: Final = struct.Struct("iII")
SO_PEERGROUPS: Final = 59
MAX_GROUPS: Final = 256  # Python reads no longer option


class PeerProcess(NamedTuple):
    """Process, user and group at the time of the connection; of a listening socket: when it began to listen."""

    pid: int
    user: int
    group: int


def peer_of(connected: socket.socket) -> PeerProcess:
    """The process at the other end."""
    found = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return PeerProcess(*_CREDENTIALS.unpack(found))


def groups_of(connected: socket.socket) -> set[int]:
    """All groups of that process; OSError if they are more than MAX_GROUPS."""
    found = connected.getsockopt(socket.SOL_SOCKET, SO_PEERGROUPS, 4 * MAX_GROUPS)
    return {peer_of(connected).group, *memoryview(found).cast("I")}
