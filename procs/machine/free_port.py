"""TCP ports and other numbers of which each program of this machine has its own, whichever users start them."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Final

TRIES: Final = 100


def reserve(what: str, first: int, last: int,
            is_free: Callable[[int], bool] = lambda number: True) -> tuple[int, socket.socket]:
    """The first free number from `first` to `last` that none of our programs has reserved for `what`; OSError if none.

    The abstract Unix socket reserves it: atomically, and while any process has it open.
    """
    for number in range(first, last + 1):
        mark = socket.socket(socket.AF_UNIX)
        with contextlib.suppress(OSError):
            mark.bind(f"\0trocar {what} {number}")
            if is_free(number):
                return number, mark
        mark.close()
    raise OSError(f"{what} {first} to {last} are all in use")


def reserve_port(first: int) -> tuple[int, socket.socket]:
    """The first TCP port of loopback from `first` on that is free and reserved by none of our programs."""
    return reserve("port", first, first + TRIES - 1, _is_free)


@contextlib.contextmanager
def reserved_port(first: int) -> Iterator[int]:
    """The same, until the end of the block or of our process."""
    number, mark = reserve_port(first)
    with mark:
        yield number


def _is_free(port: int) -> bool:
    with socket.socket() as probe, contextlib.suppress(OSError):
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
        return True
    return False
