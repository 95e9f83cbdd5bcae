"""Addresses for emulated buses: every system has its own in 127/8."""

from __future__ import annotations

import contextlib
import socket
import zlib
from collections.abc import Callable
from typing import Final

from procs.port_holders import holders

BUS_PORT: Final = 1394


class NoAddress(Exception):
    """None is free; the message says who has them."""


def free_address(system: str) -> Callable[[int], str]:
    """Addresses 127.x.y.16k for the emulated buses of a system, not in use now; x.y follows from the name."""
    seed = zlib.crc32(system.encode())

    def address(bus: int) -> str:
        for attempt in range(256):
            number = (seed + attempt * 7919) % 0xFE00
            candidate = f"127.{1 + number // 256}.{number % 256}.{16 * (bus + 1)}"
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
                probe.bind((candidate, BUS_PORT))
                return candidate
        others = "; ".join(map(str, holders(BUS_PORT))) or "every address that was tried is taken"
        raise NoAddress(f"no free loopback address with port {BUS_PORT} for an emulated bus: {others}")

    return address
