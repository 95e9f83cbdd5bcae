"""Random messages by the hundred, through a real connection: each is answered or dropped, and nothing else happens."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from tests.socket_bridge.bridge import Bridge, BridgeClient, bridge, run
from tests.socket_bridge.fuzz import message
from trocar.procs.socket_bridge import session

SLICE = 50


async def fuzzed(made: Bridge, client: BridgeClient, count: int, seed: int) -> None:
    """So many messages; after some the bridge must still answer."""
    draw, sent = random.Random(seed), 0

    async def read() -> None:
        while await client.reader.read(1 << 16):
            pass

    await client.ask("ping")
    reading = asyncio.ensure_future(read())
    while sent < count:
        for _ in range(SLICE):
            client.raw(message(draw) + b"\n")
        sent += SLICE
        await client.writer.drain()
        for request in made.robot.mailbox.drain(0):
            draw.choice([request.accept, request.done, request.refuse, request.fail])("é" * 99)
        if not sent % 500:
            made.robot.show_arm(draw.random())
            made.robot.events.status("x" * draw.randint(1, 99), "PSM1")
        await asyncio.sleep(0)
    await made.until(lambda: made.server.served.counts.received >= count * 0.98)
    reading.cancel()


def tell(world: Any, count: int, seed: int) -> None:
    async def story() -> None:
        async with bridge(world.name) as made:
            async with made.client() as client, made.client() as other:
                await fuzzed(made, client, count, seed)
                assert (await other.ask("ping"))["op"] == "answer"
                counts = made.server.served.counts
                assert counts.refused > count / 4 and counts.commands > count / 200
            await made.until(lambda: not made.server.sessions)
            assert not made.server.served.topics._open, "nothing is left open"
    run(story())


def test_random_messages_are_answered_and_leave_nothing(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "MANY_WRONG", 1 << 30)
    tell(world, 500, 1)


@pytest.mark.soak
def test_a_hundred_thousand_random_messages(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "MANY_WRONG", 1 << 30)
    for seed in range(10):
        tell(world, 10_000, 100 + seed)
