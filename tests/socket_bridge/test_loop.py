"""The process of the socket bridge: what its clients hold down ends with them, also after a stall."""

from __future__ import annotations

import json
import socket

from tests.host.hosted import COARSE, document
from trocar.procs.host.host import Host
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.node.pacing import Pauses
from trocar.procs.socket_bridge.loop import SocketLoop

PULL = {"op": "call", "to": "boards", "command": "pull_tip", "text": "PSM1", "values": [0, 0, -0.1, 0, 0, 0, 1]}
SETS = (*COARSE, "socket={listen: ['127.0.0.1:7399']}")
STALL_NS = 1_000_000_000


def test_what_clients_hold_down_is_released_when_a_stall_disconnects_them() -> None:
    times = [STALL_NS]
    with (Host(document("demo.yaml", "emulated", SETS)) as host,
          socket.create_server(("127.0.0.1", 0)) as listening,
          socket.create_connection(listening.getsockname()) as client):
        loop = SocketLoop(Node(document_of(host.name), "socket_bridge"))
        loop.node.listening, loop.node.pauses = (listening,), Pauses(STALL_NS // 2, lambda: times[0])
        loop.begin()
        loop.node.pauses.begin()
        audit = host.reader("boards", "audit")

        def commands() -> list[str]:
            found = []
            for _ in range(20):
                loop._serve(5_000_000)
                host.run(0.01)
                while audit.next():
                    found.append(audit.field("command").item().decode())
            return found

        client.sendall(json.dumps(PULL).encode() + b"\n")
        assert commands() == ["pull_tip"], client.recv(4096)
        times[0] += STALL_NS
        assert loop.node.pauses.is_over()
        loop.quit()
        assert commands() == ["release_tip"]
        loop.node.give_back()
        loop.node.close()
