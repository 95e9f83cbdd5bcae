"""Addresses, ports and ROS domains of a system that no other system of this machine has, of any user."""

from __future__ import annotations

import contextlib
import socket
import zlib
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final

from trocar.procs.config.loading.emulated import ports_of
from trocar.procs.document.process import host_and_port
from trocar.procs.document.system import IoConfig, SystemConfig
from trocar.procs.machine.free_port import reserve, reserve_port
from trocar.procs.machine.port_holders import holders
from trocar.procs.node.setup_error import SetupError

BUS_PORT: Final = 1394


class Reservations(contextlib.ExitStack):
    """Ports and ROS domains of one system; no other system gets them until this is closed.

    Another process that has the sockets of `marks` open keeps them as well.
    """

    def __init__(self) -> None:
        """Reserve nothing yet."""
        super().__init__()
        self.marks: list[socket.socket] = []

    def address(self, usual: str) -> str:
        """The usual address of loopback, or the next free port there; the usual one if none is free."""
        host, port = host_and_port(usual)
        with contextlib.suppress(OSError):
            return f"{host}:{self._kept(*reserve_port(port))}"
        return usual

    def domain(self, first: int, last: int) -> int | None:
        """The first ROS domain of these that no other system has; None: there is none."""
        with contextlib.suppress(OSError):
            return self._kept(*reserve("ROS domain", first, last))
        return None

    def _kept(self, number: int, mark: socket.socket) -> int:
        self.marks.append(self.enter_context(mark))
        return number


def free_address(system: str) -> Callable[[int], str]:
    """Free addresses 127.x.y.16k for the emulated buses of a system; x.y is derived from the name."""
    seed = zlib.crc32(system.encode())

    def address(bus: int) -> str:
        for attempt in range(256):
            number = (seed + attempt * 7919) % 0xFE00
            candidate = f"127.{1 + number // 256}.{number % 256}.{16 * (bus + 1)}"
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
                probe.bind((candidate, BUS_PORT))
                return candidate
        others = "; ".join(map(str, holders(BUS_PORT))) or "all addresses that were tried are taken"
        raise SetupError(f"no free loopback address with port {BUS_PORT} for an emulated bus: {others}")

    return address


def at_free_addresses(system: SystemConfig) -> SystemConfig:
    """The same system with its emulated buses at free addresses, as its document may be that of a running system.

    SetupError when none is free.
    """
    emulation = system.emulation
    if emulation is None:
        return system
    address = free_address(system.name)
    buses = tuple(replace(bus, address=address(place)) for place, bus in enumerate(emulation.buses))
    ports = ports_of(buses)

    def moved(ios: Iterable[IoConfig]) -> tuple[IoConfig, ...]:
        return tuple(replace(io, port=ports.get(io.name, io.port)) for io in ios)

    on_boards = None if emulation.ios is None else moved(emulation.ios)
    return replace(system, ios=moved(system.ios), emulation=replace(emulation, buses=buses, ios=on_boards))
