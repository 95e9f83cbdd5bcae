"""Words as coroutines: they wait beside each other, and what goes wrong is raised where they are awaited."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from trocar.shm.mailbox.client import Reply
from trocar.tools.client.aio import Aio
from trocar.tools.client.moves import Waits, move
from trocar.tools.output.errors import Refused


class SlowArm:
    """Homes for as long as nobody holds it; its moves end when `goal` is set."""

    held, goal = threading.Event(), threading.Event()

    def __init__(self) -> None:
        self.jaw, self.thread, self.is_open = SimpleNamespace(open=self.move), threading.get_ident(), True

    def home(self) -> str:
        assert self.held.wait(20.0) and threading.get_ident() == self.thread
        return "homed"

    def hold(self) -> None:
        self.held.set()

    def move(self) -> Any:
        remote: Any = SimpleNamespace(
            instance="PSM1", ask=lambda *_: Reply(1, "accepted", ""),
            replies_to=lambda number: [Reply(1, "done", "")] if self.goal.is_set() else [])
        return move(Waits(), remote, "jaw/move_jp", ())

    def refuse(self) -> None:
        raise Refused("not homed")

    def close(self) -> None:
        self.is_open = False


@pytest.fixture
def made() -> list[SlowArm]:
    SlowArm.held.clear()
    SlowArm.goal.clear()
    return []


def aio(made: list[SlowArm]) -> Aio:
    def make() -> SlowArm:
        made.append(SlowArm())
        return made[-1]

    return Aio(make)


def test_a_stop_need_not_wait_for_what_takes_long(made: list[SlowArm]) -> None:
    async def both() -> None:
        async with aio(made) as arm:
            homing = asyncio.ensure_future(arm.home())
            await asyncio.sleep(0.01)
            await arm.hold()
            assert await homing == "homed"
            with pytest.raises(Refused, match="not homed"):
                await arm.refuse()

    asyncio.run(both())
    assert len(made) == 2 and not any(arm.is_open for arm in made)


def test_a_move_is_over_at_its_goal_and_goes_on_when_cancelled(made: list[SlowArm]) -> None:
    async def moves() -> None:
        async with aio(made) as arm:
            moving = asyncio.ensure_future(arm.jaw.open())
            await asyncio.sleep(0.02)
            assert not moving.done()
            SlowArm.goal.set()
            assert not (await moving).is_busy()
            SlowArm.goal.clear()
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(arm.jaw.open(), 0.05)

    asyncio.run(asyncio.wait_for(moves(), 20.0))


def test_who_is_not_there_is_told_at_the_begin() -> None:
    def nobody() -> Any:
        raise TimeoutError("PSM1 is not connected")

    async def attach() -> None:
        async with Aio(nobody):
            pass

    with pytest.raises(TimeoutError, match="not connected"):
        asyncio.run(attach())
