"""One owner for each port of this machine: a second one is refused with the name and pid of the first.

An abstract Unix socket in the port's name: taking it is one step, and the kernel gives it back when its owner dies. It
listens, so that whoever is refused can ask the kernel who has it.
"""

from __future__ import annotations

import errno
import socket
import struct
from pathlib import Path
from typing import Final

from trocar.procs.io.bus.port import PortError
from trocar.procs.io.bus.ports import owned

_CREDENTIALS: Final = struct.Struct("3i")  # pid, user, group
ASK_S: Final = 0.5
ASKERS: Final = 4096  # nobody takes them out of the queue: whoever finds it full is not told the name


def hold(port: str) -> socket.socket:
    """Own `port` (as configuration files write it) until the socket is closed; PortError names who has it."""
    where = f"port {port}"
    name = f"\0trocar~port~{owned(port)}"
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


def _owner(name: str) -> str:
    """Who has it: process, system and pid, as far as the kernel tells."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(ASK_S)
            asking.connect(name)
            found = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        pid = int(_CREDENTIALS.unpack(found)[0])
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    except OSError:
        return "another program that is just starting or ending"
    reported = {flag: words[at + 1] for at, flag in enumerate(words[:-1]) if flag in ("--system", "--name")}
    if len(reported) == 2:
        return f"{reported['--name']} of system {reported['--system']} (pid {pid})"
    return f"pid {pid}"
