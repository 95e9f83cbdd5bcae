"""What a client sends to a bridge that its connection starts waits until the bridge runs, and counts as sent then."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from tests.socket_bridge.bridge import Bridge, BridgeClient, bridge, run
from trocar.shm.time.clock import monotonic_ns

MOVE = {"to": "PSM1", "command": "move_jp", "values": [0.1, 0, 0.12, 0, 0, 0]}


async def outcome(made: Bridge, client: BridgeClient, **call: Any) -> tuple[str, str]:
    """Of a command, which the arm carries out at once if its mailbox lets it through."""
    client.say("call", id=1, **call)
    reply = asyncio.ensure_future(client.hear("reply"))
    while not reply.done():
        for command in made.robot.mailbox.drain(monotonic_ns()):
            command.done()
        await asyncio.wait([reply], timeout=0.002)
    return reply.result()["outcome"], reply.result()["text"]


@pytest.mark.parametrize("begins", [True, False])
def test_a_move_in_the_first_bytes_of_a_connection_is_late_if_it_may_have_waited(world: Any, begins: bool) -> None:
    async def whole() -> None:
        async with bridge(world.name, begins=begins) as made, made.client() as client:
            found, why = await outcome(made, client, **MOVE)
            assert (found, "late" in why) == (("refused", True) if begins else ("done", False))
            assert (await outcome(made, client, **MOVE))[0] == "done", "this one was sent to a bridge that runs"

    run(whole())


def test_a_stop_in_the_first_bytes_is_never_late(world: Any) -> None:
    async def whole() -> None:
        async with bridge(world.name, begins=True) as made, made.client() as client:
            assert (await outcome(made, client, to="PSM1", command="hold"))[0] == "done"

    run(whole())
