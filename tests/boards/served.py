"""A bus behind real sockets, and a host that speaks to it, in one thread: nothing is served until it is told to."""

from __future__ import annotations

import os
import socket
import time

import pytest

from tests.boards.rails import MS, Rails, two_buses
from tests.fpga import board_side
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.endpoints import Endpoints
from trocar.procs.document.system import BusConfig
from trocar.procs.fpga import wire

KEPT_BYTES = 1280  # what the kernel charges for a short datagram, at most
PATIENCE_S = 20.0


class Served:
    """A bus behind real sockets, and a host."""

    def __init__(self) -> None:
        address = f"127.{92 + (os.getpid() >> 8) % 100}.{os.getpid() & 0xFF}.16"  # nobody else's
        system = two_buses(address=address)
        assert system.emulation is not None
        self.world = Emulation(system, Rails(7), time.monotonic_ns())
        self.bus: BusConfig = system.emulation.buses[0]
        self.endpoints = Endpoints((self.bus,), self.world.answer, time.monotonic_ns, False)
        self.host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.host.connect((address, wire.UDP_PORT))
        self.host.settimeout(PATIENCE_S)

    def close(self) -> None:
        self.host.close()
        self.endpoints.close()

    @property
    def granted_bytes(self) -> int:
        """Receive buffer of the bus's socket."""
        return self.endpoints._doors[0].sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    def need(self, datagrams: int, size: int) -> None:
        """Skips the test where the buffer that was granted cannot hold so many."""
        wanted = datagrams * (KEPT_BYTES + size)
        if self.granted_bytes < wanted:
            pytest.skip(f"the system grants a receive buffer of {self.granted_bytes} bytes, {datagrams} datagrams need "
                        f"{wanted}: raise net.core.rmem_max or give the process CAP_NET_ADMIN")

    def burst(self, datagrams: list[bytes]) -> None:
        """Send all, then serve until all are executed, or time is up."""
        packets = self.world.buses[0].packets
        for data in datagrams:
            self.host.send(data)
        end = time.monotonic() + PATIENCE_S
        while self.world.buses[0].packets < packets + len(datagrams) and time.monotonic() < end:
            self.endpoints.serve(MS)
        assert self.world.buses[0].packets - packets == len(datagrams)

    def ask(self, node: int, address: int) -> int:
        self.host.send(wire.quadlet_read(node, address, 1, self.world.buses[0].generation))
        self.endpoints.serve(1000 * MS)
        response = board_side.decode_response(self.host.recv(100))
        assert isinstance(response, board_side.WireResponse)
        return response.value
