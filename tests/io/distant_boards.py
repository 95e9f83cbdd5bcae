"""Emulated controllers in a network namespace of their own, at the far end of a virtual cable.

    unshare -n python -m tests.io.distant_boards INTERFACE NETWORK BOARD…

Waits until the interface has been moved here, gives every board its address, and serves until the input closes.
"""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import time

from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.boards.endpoints import ANY, Endpoints
from trocar.procs.document import system as document
from trocar.procs.document.system import Controller
from trocar.procs.fpga import wire
from trocar.procs.fpga.port_name import DEFAULT_ADDRESS
from trocar.procs.io.bus.udp import address_of

TICKS_PER_NS = 49.152e-3
PATIENCE_S = 20.0


def main() -> None:
    interface, network, *boards = sys.argv[1:]
    ids = [int(board) for board in boards]
    deadline = time.monotonic() + PATIENCE_S
    while interface not in [name for _, name in socket.if_nameindex()]:
        assert time.monotonic() < deadline
        select.select([], [], [], 0.01)
    own = ids if network == "ethernet" else [0]
    for words in (["link", "set", "lo", "up"], ["link", "set", interface, "up"],
                  *(["addr", "add", f"{address_of(DEFAULT_ADDRESS, board)}/16", "brd", "+", "dev", interface]
                    for board in own)):
        subprocess.run(["ip", *words], check=True)
    late = network == "ethernet"
    rows = tuple(Controller(board, firmware=9 if late else 8, fpga="V3" if late else "V2") for board in ids)
    bus = EmulatedBus(rows, network=network)
    start = time.monotonic_ns()

    def answer(_bus, data, _now_ns, to):
        return bus.answer(bytes(data), round((time.monotonic_ns() - start) * TICKS_PER_NS), to)

    endpoints = Endpoints((document.BusConfig("far", ANY, rows, network=network),), answer, time.monotonic_ns, False,
                          addressee=lambda _, address: bus.board_at(address))
    index = socket.if_nametoindex(interface)
    endpoints._doors[0].sock.setsockopt(
        socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
        socket.inet_aton(wire.MULTICAST) + bytes(4) + index.to_bytes(4, sys.byteorder))
    print("serving", flush=True)
    while not select.select([sys.stdin], [], [], 0)[0]:
        endpoints.serve(5_000_000)
    endpoints.close()


if __name__ == "__main__":
    main()
