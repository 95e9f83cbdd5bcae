"""A TCP port of loopback where nobody listens, for a system of ours that will in a moment."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

TRIES: Final = 100


@contextmanager
def reserved_port(first: int) -> Iterator[int]:
    """The first one that is free from `first` on, and that none of our programs has reserved; OSError without any."""
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
