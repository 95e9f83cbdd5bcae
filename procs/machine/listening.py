"""Sockets that the supervisor holds and hands over to the process that it starts, as systemd does.

They are descriptors 3, 4, … in the order of the row's `listen`; LISTEN_FDS says how many, LISTEN_PID for whom, and
LISTEN_FDNAMES has a name for each.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from typing import Final

FIRST: Final = 3


def handed(environ: Mapping[str, str] = os.environ) -> tuple[socket.socket, ...]:
    """Listening sockets that are meant for this process, not blocking; call it once. None where it has no `listen`."""
    if environ.get("LISTEN_PID") != str(os.getpid()):
        return ()
    found = []
    for number in range(FIRST, FIRST + int(environ.get("LISTEN_FDS", "0"))):
        os.set_inheritable(number, False)
        found.append(socket.socket(fileno=number))
        found[-1].setblocking(False)
    return tuple(found)
