"""Listening sockets that the supervisor keeps open and passes to the process that it starts, like systemd.

They are descriptors 3, 4, … in the order of the row's `listen`; LISTEN_FDS has their number, LISTEN_PID the process id
of the receiver, and LISTEN_FDNAMES a name for each.
"""

from __future__ import annotations

import os
import socket
from typing import Final

FIRST: Final = 3


def handed() -> tuple[socket.socket, ...]:
    """Listening sockets passed to this process, non-blocking; call it once. Empty for a process without `listen`."""
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return ()
    found = []
    for number in range(FIRST, FIRST + int(os.environ.get("LISTEN_FDS", "0"))):
        os.set_inheritable(number, False)
        found.append(socket.socket(fileno=number))
        found[-1].setblocking(False)
    return tuple(found)
