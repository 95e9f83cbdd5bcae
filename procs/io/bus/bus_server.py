"""Manual access to a bus of controllers: serves `trocar bus`, one transaction a line.

    python -m trocar.procs.io.bus.bus_server PORT

Requests and replies are JSON objects, one a line: `{"do": "read", "board": 0, "address": 4}` is answered `{"value":
1363956017}`, an impossible request `{"error": "…"}`. The first line reports whether the port's name is valid. Nothing
is sent between requests; the process ends when the client closes the connection. Boards are found by reads alone where
possible, because every write, also of discovery, refreshes the watchdogs.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.named_port import hold, port_of
from trocar.procs.io.bus.transport import PortError
from trocar.shm.time.clock import monotonic_ns

Answer = dict[str, Any]


class BusServer:
    """The manual transactions, on a port without boards of its own."""

    def __init__(self, name: str, port: BusPort, held: contextlib.ExitStack) -> None:
        """`port`, called `name`, is not discovered yet; resources taken later are released with `held`."""
        self._name, self._port, self._held = name, port, held
        self._known: Mapping[str, Callable[..., Answer]] = {
            "discover": self.discover, "read": self.read, "block": self.block, "write": self.write,
            "own": self.own}

    def answer(self, request: Mapping[str, Any]) -> Answer:
        """The reply to one request."""
        try:
            arguments = {key: value for key, value in request.items() if key != "do"}
            return self._known[request["do"]](**arguments)
        except PortError as error:
            return {"error": str(error)}

    def discover(self) -> Answer:
        """All boards of the bus."""
        return {"boards": [dataclasses.asdict(info) for info in self._port.discover()]}

    def read(self, board: int, address: int) -> Answer:
        """One register."""
        return {"value": self._port.read_quadlet(board, address)}

    def block(self, board: int, address: int, quads: int) -> Answer:
        """A block transfer; at address 0 it is the board's real-time block."""
        return {"values": self._port.read_block(board, address, quads).tolist()}

    def write(self, board: int, address: int, value: int) -> Answer:
        """One register of one board, or of `bus_port.ALL_BOARDS`."""
        self._port.write_quadlet(board, address, value)
        return {}

    def own(self) -> Answer:
        """Own the port from now on; an error while another process or another host owns it."""
        self._held.enter_context(hold(self._name))
        self._port.refuse_other_host()
        return {}


def main() -> None:
    """Answer every line until the client closes the connection."""
    if len(sys.argv) != 2:
        sys.exit("started by: trocar bus")
    try:
        port = port_of(sys.argv[1], (), monotonic_ns, PortOptions(quiet=True))
    except PortError as error:
        _say({"misuse": str(error)})
        return
    _say({})
    with contextlib.closing(port), contextlib.ExitStack() as held:  # discovery opens it
        desk = BusServer(sys.argv[1], port, held)
        for line in sys.stdin:
            _say(desk.answer(json.loads(line)))


def _say(answer: Answer) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
