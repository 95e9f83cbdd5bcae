"""A free port, also where several programs look for one at the same time."""

from __future__ import annotations

import socket

from trocar.procs.machine.free_port import reserved_port


def test_a_port_is_given_once_and_not_where_somebody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = server.getsockname()[1]
        with reserved_port(taken) as first, reserved_port(taken) as second:
            assert taken < first < second
            with socket.create_server(("127.0.0.1", first)):
                pass
