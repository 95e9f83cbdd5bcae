"""A bridge in the test's own event loop, on a system that the test plays; and clients of it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.document.bridges import SocketBridge
from trocar.procs.document.system import from_json
from trocar.procs.socket_bridge.server import SocketServer
from trocar.shm.mailbox.generations import Faults
from trocar.shm.system import directory

LOCAL = SocketBridge(("127.0.0.1:7380",))
DUE_S = 20.0


@dataclass
class BridgeClient:
    """A program that is connected."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    heard: list[dict[str, Any]] = field(default_factory=list)

    def say(self, op: str, **parts: Any) -> None:
        """One message."""
        self.raw(json.dumps({"op": op, **parts}).encode() + b"\n")

    def raw(self, data: bytes) -> None:
        """Any bytes."""
        self.writer.write(data)

    async def hear(self, op: str = "") -> dict[str, Any]:
        """The next message, of this kind; an empty one when the bridge has disconnected us."""
        while True:
            line = await asyncio.wait_for(self.reader.readline(), DUE_S)
            found: dict[str, Any] = json.loads(line) if line else {}
            if not found or op in ("", found["op"]):
                return found

    async def ask(self, op: str, **parts: Any) -> dict[str, Any]:
        """A message, and the answer to it."""
        self.say(op, id=7, **parts)
        while True:
            found = await self.hear()
            if not found or found.get("id") == 7:
                return found


@dataclass
class Bridge:
    """One that runs."""

    server: SocketServer
    port: int
    robot: ScriptedRobot
    is_over: bool = False

    @contextlib.asynccontextmanager
    async def client(self) -> AsyncIterator[BridgeClient]:
        """A program that connects, and leaves."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, limit=1 << 22)
        try:
            yield BridgeClient(reader, writer)
        finally:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()

    async def until(self, condition: Callable[[], object]) -> None:
        """Until something is so."""
        async with asyncio.timeout(DUE_S):
            while not condition():
                await asyncio.sleep(0.002)


@contextlib.asynccontextmanager
async def bridge(name: str, settings: SocketBridge = LOCAL, *, begins: bool = False) -> AsyncIterator[Bridge]:
    """A bridge on a system of this name, whose arm accepts all that it is asked; `begins`: clients may have waited for
    it, since this process began.
    """
    wrong: list[Any] = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: wrong.append(context))
    with robot(name) as scripted:
        scripted.show_arm(homed=True, state="ENABLED")
        document = from_json(directory.document(name))
        object.__setattr__(document, "socket", settings)
        listening = socket.create_server(("127.0.0.1", 0))
        made: list[Bridge] = []
        faults = Faults(name)
        first = FirstMessages(faults.generation)
        first._until_ns = first._until_ns + 60_000_000_000 if begins else 0
        server = SocketServer(document, lambda: made[0].is_over, logging.getLogger("bridge"), first)
        made.append(Bridge(server, listening.getsockname()[1], scripted))
        await server.listen([listening])
        try:
            yield made[0]
        finally:
            await server.close()
            faults.close()
            for _ in range(3):
                await asyncio.sleep(0)
            assert not wrong, wrong


def run(scenario: Coroutine[Any, Any, None]) -> None:
    """Run a test's story."""
    asyncio.run(asyncio.wait_for(scenario, 60.0))
