"""What a page may do that shows an earlier state: before a fault, or of another system."""

from __future__ import annotations

import asyncio
import json

from tests.conftest import World
from tests.gui.test_browsers import OFF, STOP, Console, FakePage, executed, play
from trocar.procs.gui.control import KEPT
from trocar.shm.mailbox.generations import FaultCell


def test_a_step_of_a_sequence_is_not_done_after_a_fault_that_came_after_the_press(world: World) -> None:
    async def story(console: Console) -> None:
        arm = FaultCell(console.faults, "PSM1")
        browser, page = console.page()
        arm.fault()
        await console.tick()
        pressed = console.all.served.ticks.number
        for _ in range(2 * KEPT):  # far more than the ticks that are kept: a slow arm is being powered
            await console.tick()
        browser.handle('{"op": "control", "take": true}')

        async def commands(since: int, text: str = "home") -> list[str]:
            await console.tick()
            call = {"op": "call", "to": "PSM1", "command": "state_command", "text": text, "id": 1, "since": since}
            browser.handle(json.dumps({**call, "tick": console.all.served.ticks.number}))
            await console.tick()
            return executed(console.robot)

        assert await commands(pressed) == ["state_command"]
        FaultCell(console.faults, "IO1/PSM1").fault()  # of anything
        assert [await commands(since) for since in (pressed, 10**6)] == [[], []]
        assert "press it again" in page.last("reply")["text"]
        assert await commands(pressed, "disable") == await commands(0) == ["state_command"], "a stop, and a new press"

    play(world.name, story)


def test_a_page_of_other_pages_than_these_takes_no_control_but_may_power_off_what_there_is(world: World) -> None:
    async def story(console: Console) -> None:
        console.robot.show_arm(0.1, "ENABLED")
        page = FakePage()
        browser = console.all.come(page, "old page", "other pages")
        delivering = asyncio.ensure_future(browser.deliver())
        answer = await console.ask(browser, page, "control", take=True)
        assert answer["outcome"] == "refused" and "load it again" in answer["text"]
        assert page.last("hello")["power_off"] == OFF and page.last("hello")["stop"] == STOP
        (((to, command, values, text),),) = OFF
        await console.ask(browser, page, "call", to=to, command=command, values=values, text=text)
        assert executed(console.robot) == ["state_command"]
        delivering.cancel()

    play(world.name, story)
