"""What pages see and may ask for, on a system that the test plays; without a web server."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import closing
from typing import Any

import pytest

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.crtk.calls import CommandOwner, owners_of
from trocar.procs.document.system import from_json
from trocar.procs.gui import browsers
from trocar.procs.gui.browsers import PENDING, Browser, Browsers, ConsoleService
from trocar.procs.gui.catalogue import sources_of
from trocar.procs.gui.scene_source import ArmModels
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.generations import FaultCell, Faults
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns

OFF, STOP = [[["PSM1", "state_command", [], "disable"]]], [[["PSM1", "hold", [], ""]]]
ENDS = {"power_off": OFF, "stop": STOP}


class FakePage:
    """The end of a connection that a browser has."""

    def __init__(self) -> None:
        self.heard: list[dict[str, Any]] = []
        self.closed = ""

    async def send_text(self, data: str) -> None:
        self.heard.append(json.loads(data))

    async def close(self, code: int = 1000, reason: str | None = None) -> None:
        self.closed = reason or "?"

    def last(self, op: str) -> dict[str, Any]:
        return next(message for message in reversed(self.heard) if message["op"] == op)


class Console:
    """A console with pages, without a server."""

    def __init__(self, scripted: ScriptedRobot) -> None:
        document = from_json(directory.document(scripted.name))
        self.robot, self.is_over = scripted, False
        self.sources, self.models = sources_of(document), ArmModels(document)
        self.faults = Faults(scripted.name, write=True)
        self.owners = owners_of(document)
        self.all = Browsers(ConsoleService(scripted.name, self.owners, self.sources, lambda: self.is_over,
                                            self.models, "r", self.faults.generation, ENDS))
        self.control = self.all.served.control
        self._tasks: list[asyncio.Task[None]] = []
        self.made = 0

    def page(self) -> tuple[Browser, FakePage]:
        self.made += 1
        page = FakePage()
        browser = self.all.come(page, f"page {self.made}")
        self._tasks.append(asyncio.ensure_future(browser.deliver()))
        return browser, page

    async def tick(self, now_ns: int | None = None) -> None:
        self.all.tick(monotonic_ns() if now_ns is None else now_ns)
        for _ in range(4):
            await asyncio.sleep(0)

    async def ask(self, browser: Browser, page: FakePage, op: str, **parts: Any) -> dict[str, Any]:
        """Say it as a page does that has heard the newest tick; the answer."""
        if op in ("call", "jog"):
            parts = {"tick": self.all.served.ticks.add(monotonic_ns(), self.faults.generation()), **parts}
        browser.handle(json.dumps({"op": op, "id": 1, **parts}))
        await self.tick()
        return page.last("reply")

    def close(self) -> None:
        for browser in tuple(self.all.all):
            self.all.leave(browser)
        self.all.close()
        for task in self._tasks:
            task.cancel()
        self.sources.close()
        self.models.close()
        self.faults.close()


Story = Callable[[Console], Any]


def play(world: str, story: Story) -> None:
    """Run a test's story."""
    async def run() -> None:
        with robot(world) as scripted:
            console = Console(scripted)
            try:
                await story(console)
            finally:
                console.close()

    asyncio.run(run())


def executed(scripted: ScriptedRobot) -> list[str]:
    """What came to the arm."""
    found = []
    for command in scripted.mailbox.drain():
        found.append(command.name)
        scripted.mailbox.reply(command, 3, "")  # done
    return found


def test_a_page_gets_what_it_wants_when_it_changes(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        console.robot.show_arm(0.1, "ENABLED")
        await console.tick()
        assert page.heard[0]["op"] == "hello" and len(page.heard) == 1
        browser.handle('{"op": "want", "sources": ["PSM1/state"]}')
        await console.tick()
        shown = page.last("tick")["data"]["PSM1/state"]
        assert shown["state"] == "ENABLED" and shown["position"][0] == 0.1 and shown["velocity"][0] is None
        await console.tick()
        assert page.last("tick")["data"] == {}
        console.robot.show_arm(0.2, "ENABLED")
        await console.tick()
        assert page.last("tick")["data"]["PSM1/state"]["position"][0] == 0.2
        browser.handle('{"op": "want", "sources": []}')
        count = len(page.heard)
        await console.tick()
        assert len(page.heard) == count and len(console.sources._open) == 0

    play(world.name, story)


def test_a_page_that_does_not_keep_up_gets_all_of_the_newest(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        console.robot.show_arm(0.1)
        browser.handle('{"op": "want", "sources": ["PSM1/state"]}')
        for _ in range(PENDING):
            console.all.tick(monotonic_ns())  # nothing new, and nothing was taken
        await console.tick()
        ticks = [message for message in page.heard if message["op"] == "tick"]
        assert len(ticks) == 1 and "PSM1/state" in ticks[0]["data"] and console.all.served.counts.lost == PENDING

    play(world.name, story)


def test_what_is_old_says_how_old_it_is(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        browser.handle('{"op": "want", "sources": ["PSM1/state", "IO1/state"]}')
        console.robot.show_arm(0.1)
        await console.tick(monotonic_ns() + 3_000_000_000)
        data = page.last("tick")["data"]
        assert 2.9 <= data["PSM1/state"]["age"] <= 60.0 and data["IO1/state"] == {"age": None}

    play(world.name, story)


def test_only_the_page_that_has_control_commands(world: World) -> None:
    async def story(console: Console) -> None:
        (first, one), (second, two) = console.page(), console.page()
        enable = {"to": "PSM1", "command": "state_command", "text": "enable"}
        for forged in (enable, {"to": "PSM1", "command": "servo_jv", "values": [0.1] * 6},
                       {"to": "PSM1", "command": "state_command", "text": "enable disable"},
                       {"to": "supervisor", "command": "stop"}):
            answer = await console.ask(first, one, "call", **forged)
            assert answer["outcome"] == "refused" and "take control" in answer["text"]
        answer = await console.ask(first, one, "jog", arm="PSM1", twist=[0.01, 0, 0, 0, 0, 0])
        assert answer["outcome"] == "refused" and "take control" in answer["text"]
        assert executed(console.robot) == []
        first.handle('{"op": "control", "take": true}')
        await console.ask(first, one, "call", **enable)
        assert executed(console.robot) == ["state_command"]
        await console.tick()
        assert one.last("reply")["outcome"] == "done"
        answer = await console.ask(second, two, "control", take=True)
        assert answer["outcome"] == "refused" and "another page has control" in answer["text"]
        assert "take control" in (await console.ask(second, two, "call", **enable))["text"]
        second.handle('{"op": "control", "take": true, "over": true}')
        assert "take control" in (await console.ask(first, one, "call", **enable))["text"]
        assert executed(console.robot) == []
        console.all.leave(second)
        assert console.control.holder(monotonic_ns()) == ""

    play(world.name, story)


def test_control_is_taken_over_only_from_the_person_in_the_question(world: World) -> None:
    async def story(console: Console) -> None:
        (first, one), (second, two), (third, three) = console.page(), console.page(), console.page()
        assert (await console.ask(first, one, "control", take=True, person="Ada"))["outcome"] == "done"
        assert (await console.ask(second, two, "control", take=True, over=True, person="Bo"))["outcome"] == "done"
        taken = {"take": True, "over": True, "person": "Cy", "from": "Ada"}
        answer = await console.ask(third, three, "control", **taken)
        assert answer["outcome"] == "refused" and "Bo has control now, not Ada" in answer["text"]
        assert console.control.holder(monotonic_ns()) == second.name
        assert (await console.ask(third, three, "control", **taken | {"from": "Bo"}))["outcome"] == "done"
        assert console.all.person(console.control.holder(monotonic_ns())) == "Cy"

    play(world.name, story)


@pytest.mark.parametrize(("command", "text"), [("hold", ""), ("state_command", "disable"), ("state_command", "pause")])
def test_every_page_may_stop_the_robot(world: World, command: str, text: str) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        browser.handle(json.dumps({"op": "call", "id": 1, "to": "PSM1", "command": command, "text": text}))
        assert executed(console.robot) == [command]
        await console.tick()
        assert page.last("reply")["outcome"] == "done"

    play(world.name, story)


@pytest.mark.parametrize(("message", "words"), [
    ("[]", "an object"), ("{", "no JSON"), ('{"op": "shout"}', "no op shout"), ('{"op": "want"}', "sources is missing"),
    ('{"op": "want", "sources": ["nothing/state"]}', "no source nothing/state"),
    ('{"op": "want", "sources": "PSM1/state"}', "a list"), ('{"op": "control", "take": 1}', "true or false"),
    ('{"op": "call", "to": "PSM1", "command": "move_jp", "values": [true]}', "numbers"),
    ('{"op": "call", "to": "PSM1", "command": "move_jp", "values": ["1"]}', "numbers"),
    ('{"op": "call", "to": "PSM9", "command": "hold"}', "no component PSM9"),
    ('{"op": "call", "to": "PSM1", "command": "hold", "as": "root"}', "no part as"),
    ('{"op": "beat", "id": {}}', "id has to be"), (" " * 70000, "65536 bytes")])
def test_what_is_no_message_is_answered_and_does_nothing(world: World, message: str, words: str) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        browser.handle(message)
        await console.tick()
        answer = page.last("reply")
        assert answer["outcome"] == "refused" and words in answer["text"], answer
        assert executed(console.robot) == [] and console.all.served.counts.refused == 1

    play(world.name, story)


def test_a_tip_that_a_page_pulls_is_let_go_with_its_control_whatever_holds_up_the_order(world: World) -> None:
    async def story(console: Console) -> None:
        create_mailbox(world.name, "boards", "boards", COMMANDS["boards"])
        console.owners["boards"] = CommandOwner("boards", {row.name: row for row in COMMANDS["boards"]})
        with closing(Mailbox(world.name, "boards", COMMANDS["boards"])) as boards:
            (one, _), (other, page) = console.page(), console.page()
            pull = {"op": "call", "to": "boards", "command": "pull_tip", "values": [0.0] * 6 + [1.0], "text": "PSM1"}

            async def came() -> list[str]:
                await console.tick()
                return [command.name for command in boards.drain()]

            one.handle('{"op": "control", "take": true}')
            await console.tick()
            one.handle(json.dumps({**pull, "tick": console.all.served.ticks.number}))
            assert await came() == ["pull_tip"] and await came() == []
            other.handle('{"op": "control", "take": true, "over": true}')
            console.is_over = True
            assert await came() == []
            console.is_over = False
            assert await came() == ["release_tip"] and await came() == []
            other.handle(json.dumps({**pull, "tick": console.all.served.ticks.number}))
            assert await came() == ["pull_tip"]
            one.handle(json.dumps({"op": "call", "to": "boards", "command": "release_tip", "text": "PSM1"}))
            assert await came() == ["release_tip"], "every page may let go"
            other.handle(json.dumps({**pull, "tick": console.all.served.ticks.number}))
            assert await came() == ["pull_tip"]
            console.is_over = True
            console.all.leave(other)
            assert await came() == []
            console.is_over = False
            assert await came() == ["release_tip"] and page.closed == ""

    play(world.name, story)


JOG = {"op": "jog", "arm": "PSM1", "twist": [0.0, 0.0, 0.0, 0.1, 0.0, 0.0]}
STREAM = {"op": "call", "to": "PSM1", "command": "servo_jv", "values": [0.1] * 6}
MOVE = {"op": "call", "to": "PSM1", "command": "move_jp", "values": [0.1] * 6}


@pytest.mark.parametrize(("message", "late_s", "counts"), [
    (JOG, 0.35, False), (STREAM, 0.0, True), (STREAM, 0.35, False), (MOVE, 0.35, True),
    (MOVE, 1.1, False), (MOVE, 30.0, False), ({**MOVE, "command": "hold", "values": []}, 30.0, True)])
def test_what_comes_late_is_not_done_unless_it_stops(world: World, message: dict[str, Any], late_s: float,
                                                     counts: bool) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        console.robot.show_arm(0.1, "ENABLED")
        await console.tick(monotonic_ns() - round(late_s * 1e9))
        browser.handle('{"op": "control", "take": true}')
        number = console.all.served.ticks.number
        await console.tick()
        browser.handle(json.dumps({**message, "id": 1, "tick": number}))
        assert len(executed(console.robot)) == counts
        await console.tick()
        answer = page.last("reply")
        assert (answer["outcome"], "too late" in answer["text"]) == (("done", False) if counts else ("refused", True))

    play(world.name, story)


@pytest.mark.parametrize("tick", [{}, {"tick": 0}, {"tick": 1 << 40}])
def test_a_desired_state_without_a_tick_that_was_heard_counts_as_old(world: World, tick: dict[str, int]) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        await console.tick()
        browser.handle('{"op": "control", "take": true}')
        browser.handle(json.dumps({**MOVE, **tick, "id": 1}))
        await console.tick()
        assert "too late" in page.last("reply")["text"] and executed(console.robot) == []

    play(world.name, story)


def test_what_was_wished_before_a_fault_is_said_to_be_from_before(world: World) -> None:
    async def story(console: Console) -> None:
        arm = FaultCell(console.faults, "PSM1")
        browser, _ = console.page()
        browser.handle('{"op": "control", "take": true}')
        await console.tick()
        before = console.all.served.ticks.number
        arm.fault()
        for message in (MOVE, {**MOVE, "command": "state_command", "values": [], "text": "home"}, STREAM):
            browser.handle(json.dumps({**message, "tick": before}))
        await console.tick()
        browser.handle(json.dumps({**MOVE, "tick": before + 1}))
        given = []
        for command in console.robot.mailbox.drain():
            given.append(command.origin.generation >= arm.valid_from)
            console.robot.mailbox.reply(command, 3, "")
        assert given == [False, False, False, True]

    play(world.name, story)


def test_beats_that_come_late_do_not_keep_control(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        browser.handle('{"op": "control", "take": true}')
        now = monotonic_ns()
        await console.tick(now)
        await console.tick(now + 1_900_000_000)
        assert page.last("tick")["you"], "it hears ticks, though it wants nothing: by them it shows that it is there"
        browser.handle('{"op": "beat", "tick": 1}')
        browser.handle('{"op": "beat"}')
        await console.tick(now + 2_100_000_000)
        assert console.control.holder(now + 2_100_000_000) == "" and not page.last("tick")["you"]
        count = len(page.heard)
        await console.tick(now + 2_200_000_000)
        assert len(page.heard) == count

    play(world.name, story)


def test_who_was_held_up_disconnects_all_and_hears_no_more_of_them(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        browser.handle('{"op": "control", "take": true}')
        console.is_over = True
        answer = await console.ask(browser, page, "call", to="PSM1", command="move_jp", values=[0.0] * 6)
        assert "stalled" in answer["text"]
        console.is_over = False
        console.all.forget("stalled")
        browser.handle('{"op": "call", "to": "PSM1", "command": "hold"}')
        await console.tick()
        assert page.closed == "stalled" and executed(console.robot) == []
        assert console.control.holder(monotonic_ns()) == ""

    play(world.name, story)


def test_a_page_that_says_thousands_of_things_is_listened_to_for_a_part_of_each_tick(
        world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(console: Console) -> None:
        monkeypatch.setattr(browsers, "A_TICK_NS", 1)  # shorter than any message
        browser, _ = console.page()
        said = 0

        async def receive() -> str:  # all is there already: nobody else gets a turn meanwhile
            nonlocal said
            said += 1
            return '{"op": "want", "sources": ["PSM1/state"]}'

        listening = asyncio.ensure_future(browser.listen(receive))
        await console.tick()
        said = 0
        for _ in range(5):
            await console.tick()
        listening.cancel()
        assert said == 5

    play(world.name, story)
