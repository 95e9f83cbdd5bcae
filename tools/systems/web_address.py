"""Address of a system's web console, and a free port for the console of a new system."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from typing import Final

from trocar.procs.document.system import from_json
from trocar.procs.machine.paths import token_file
from trocar.shm.system import directory

TRIES: Final = 100


def web_addresses(system: str) -> list[str]:
    """Addresses in a running system, with the token if one was made at its start; none without a console."""
    gui, token = from_json(directory.document(system)).gui, ""
    if gui is None:
        return []
    if gui.makes_token:
        with contextlib.suppress(OSError):  # another user's file: its owner has the token
            token = token_file(os.environ, system).read_text().strip()
    return gui.links(token, socket.gethostname())


@contextlib.contextmanager
def reserved_port(first: int) -> Iterator[int]:
    """The first TCP port of loopback from `first` on that is free and reserved by none of our programs.

    OSError without any.
    """
    for port in range(first, first + TRIES):
        with socket.socket(socket.AF_UNIX) as mark:
            try:
                mark.bind(f"\0trocar port {port}")
                with socket.socket() as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            yield port
            return
    raise OSError(f"ports {first} to {first + TRIES - 1} of 127.0.0.1 are all taken")
