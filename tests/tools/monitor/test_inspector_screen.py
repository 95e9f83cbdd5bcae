"""The screen of `trocar attach`, driven by textual's own pilot on a system that the test plays."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
from collections.abc import Awaitable, Callable
from typing import Any
from unittest import mock

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.tables import codes
from trocar.shm.memory.segment import segment_name, unlink
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.monitor.app import InspectorApp
from trocar.tools.monitor.pages.page import DARK, InspectorPage
from trocar.tools.monitor.pages.table import WIDE, Head, TableRow
from trocar.tools.monitor.pages.values import ValuesPage

pytestmark = pytest.mark.slow

SIZES = ((80, 24), (160, 50))
PATIENCE = 200  # looks at the screen

Story = Callable[[InspectorApp, Pilot[None], ScriptedRobot], Awaitable[None]]


def play(world: World, story: Story, size: tuple[int, int] = SIZES[0]) -> None:
    async def run() -> None:
        # nothing beats: on a busy machine it would stall
        with robot(world.name) as played, mock.patch("trocar.tools.inspect.processes._stalled", return_value=False):
            played.show_arm(0.25)
            app = InspectorApp(played.name)
            async with app.run_test(size=size) as pilot:
                await story(app, pilot, played)

    asyncio.run(run())


async def until(app: InspectorApp, pilot: Pilot[None], *words: str) -> str:
    """The screen, when it shows all of these."""
    for _ in range(PATIENCE):
        await pilot.pause(0.05)
        shown = screen(app)
        if all(word in shown for word in words):
            return shown
    raise AssertionError(f"{words} not seen:\n{screen(app)}")


def screen(app: InspectorApp) -> str:
    lines = app.screen._compositor.render_full_update()
    return "\n".join("".join(segment.text for segment in strip) for strip in lines.strips)  # type: ignore[attr-defined]


@pytest.mark.parametrize("size", SIZES)
def test_every_page_shows_itself_and_fits(world: World, size: tuple[int, int]) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
        seen = ("jitter" if size[0] < 100 else "missed", "PSM1/state", "is_homed", "error tracking",
                "DISABLED", "none under way")
        for number, words in enumerate(seen, 1):
            await pilot.press(str(number))
            if number == 3:
                await pilot.press("slash", *"is_homed", "enter")
            titles = [column.title for column in app.page.COLUMNS if size[0] >= WIDE or not column.is_wide]
            shown = await until(app, pilot, "supervisor runs", words, titles[-1], "/ search", "q quit")
            assert max(map(len, shown.splitlines())) <= size[0] and len(shown.splitlines()) <= size[1]
            assert any(line.split() == " ".join(titles).split() for line in shown.splitlines()), shown

    play(world, story, size)


def test_no_cell_of_a_table_is_cut() -> None:
    cells = ("MTMR_PSM1/error_state/measured_js", "teleoperation off, clutch", "1234567")
    texts = TableRow("console", cells).texts((Head("topic", 20), Head("state", 16), Head("Hz", 5, True)),
                                             {0: 20, 1: 16, 2: 5})
    assert ["".join(text.plain.split()) for text in texts] == ["".join(cell.split()) for cell in cells]
    assert all(len(line) <= width for text, width in zip(texts, (20, 16, 5), strict=True)
               for line in text.plain.split("\n"))


def test_a_topic_is_chosen_and_its_values_live(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("2", "slash", *"PSM1/state", "enter")
        await until(app, pilot, "PSM1/state", "1500")
        await pilot.press("enter")
        await until(app, pilot, "PSM1/state: record 1")
        await pilot.press("slash", *"position", "enter")
        await until(app, pilot, "0.25")
        played.show_arm(0.5)
        await until(app, pilot, "0.5 0.5 0.5", "record 2")
        await pilot.press("n")
        await until(app, pilot, "PSM1/measured_js", "[5]")

    play(world, story)


def test_enter_opens_the_topic_that_is_searched_for_by_its_whole_name(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("2")
        await until(app, pilot, "IO1/state", "PSM1/state")
        await pilot.press("slash", *"PSM1/measured_js", "enter", "enter")
        await until(app, pilot, "PSM1/measured_js: record 1")

    play(world, story)


def test_what_cannot_be_read_is_not_shown_with_the_values_of_another_topic(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("3", "slash", *"position", "enter")
        app.query_one(ValuesPage).choose("PSM1/measured_js")
        await until(app, pilot, "PSM1/measured_js: record 1", "0.25")
        unlink(segment_name(played.name, "IO1", "state"))
        app.query_one(ValuesPage).choose("IO1/state")
        assert "0.25" not in await until(app, pilot, "IO1/state: ", "there is no such")

    play(world, story)


def test_a_page_that_was_left_while_it_was_read_delays_the_next_one_by_nothing(
        world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("2")
        await until(app, pilot, "PSM1/state")
        read, show, topics, told = app._read, app._show_head, app.page, set()

        def slowly(page: InspectorPage, head_due: bool) -> Any:
            found = read(page, head_due)
            if page is not topics:
                return found
            app.call_from_thread(app.action_page, 5)
            return dataclasses.replace(found, problem="of the page before")

        def shown() -> None:
            told.add((app._problem, app._page_ns == 0))
            show()

        monkeypatch.setattr(app, "_read", slowly)
        monkeypatch.setattr(app, "_show_head", shown)
        await until(app, pilot, "DISABLED")
        assert ("", True) in told and "of the page before" not in {problem for problem, _ in told}

    play(world, story)


def test_what_processes_say_does_not_steer_the_terminal(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        evil = "\x1b]0;owned\x07\x9b2J red"
        played.events.report(codes.TRACKING, evil, "PSM1", 2, 0.06, 0.05, 6)
        played.arm.field("reason")[...] = evil.encode()
        played.show_arm(0.1, "FAULT")
        app.query_one(ValuesPage).choose("PSM1/state")
        for number, words in ((4, ("red",)), (5, ("why: ", "red")), (3, ("reason", "red"))):
            await pilot.press(str(number))
            if number == 3:
                await pilot.press("slash", *"reason", "enter")
            shown = await until(app, pilot, *words)
            assert not set(shown) & {"\x1b", "\x07", "\x9b"}, number

    play(world, story)


def test_frozen_it_says_so_and_changes_nothing(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("4")
        await until(app, pilot, "all of all processes")
        await pilot.press("f")
        await until(app, pilot, "FROZEN at")
        played.events.status("PSM1: HOMED", "PSM1")
        for _ in range(10):
            await pilot.pause(0.05)
        assert "HOMED" not in screen(app)
        await pilot.press("f")
        assert "FROZEN" not in await until(app, pilot, "PSM1: HOMED")

    play(world, story)


def test_events_are_filtered_by_keys(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        played.events.status("PSM1: HOMED", "PSM1")
        played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
        await pilot.press("4")
        await until(app, pilot, "HOMED", "cannot follow", f"remedy: {codes.TRACKING.remedy}"[:40])
        await pilot.press("s", "s")
        assert "HOMED" not in await until(app, pilot, "warning and worse", "cannot follow")
        await pilot.press("c")
        assert "cannot follow" not in await until(app, pilot, "warning and worse of IO1")
        await pilot.press("c", "slash", *"nothing such")
        assert "cannot" not in await until(app, pilot, "search: nothing such")
        await pilot.press("escape")
        await until(app, pilot, "cannot follow")

    play(world, story)


def test_a_fault_is_shown_with_its_remedy(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
        played.arm.field("reason")[...] = b"axis 2 cannot follow"
        played.show_arm(0.1, "FAULT")
        await pilot.press("5")
        await until(app, pilot, "FAULT", "why: axis 2 cannot follow", "remedy: check for a collision", "first: ")
        await pilot.press("2")
        head = str(app.query_one("#head", Static).render()).replace("\n", " ")
        await until(app, pilot, *head.split()[-4:])

    play(world, story)


def test_words_find_commands_and_arms(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
        played.events.status("PSM1: HOMED", "PSM1")
        played.show_arm(0.1, "FAULT")
        with contextlib.closing(directory.writer(played.name, "PSM1", "audit", "arm")) as ring:
            for command in (b"move_jp", b"crtk_version"):
                ring.field("command")[...], ring.field("outcome")[...] = command, b"done"
                ring.publish(monotonic_ns())
        for page, words, found in (("6", "MOVE", "move_jp"), ("5", "Tracking", "tracking"),
                                   ("4", "FOLLOW", "cannot follow"), ("4", "COLLISION", "cannot follow")):
            await pilot.press(page)
            await until(app, pilot, found)
            await pilot.press("slash", *words, "enter")
            await until(app, pilot, f'with "{words}"', found)
            assert app.page.table.row_count == 1
            await pilot.press("slash", *" and more", "enter")
            await until(app, pilot, f'with "{words} and more"')
            assert not app.page.table.row_count
            await pilot.press("escape")

    play(world, story)


def test_a_long_reason_is_whole_in_the_table_of_arms(world: World) -> None:
    words = [f"word{number}" for number in range(20)]

    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        played.arm.field("reason")[...] = " ".join(words).encode()
        played.show_arm(state="FAULT")
        await pilot.press("5")
        await until(app, pilot, "word0")
        table = app.query_one("#arms", InspectorPage).table
        shown = "\n".join(str(cell) for cell in table.get_row_at(0))
        assert shown.split()[-len(words):] == words

    play(world, story, SIZES[1])


def test_a_dead_supervisor_is_said_and_old_values_are_grey(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await pilot.press("3")
        await until(app, pilot, "IO1/state")
        for page in played.pages.values():
            page.segment.view[64:68] = (1 << 22).to_bytes(4, "little")  # nobody has this pid
        await until(app, pilot, "supervisor dead", "left in shared memory", "first: supervisor is dead: trocar up")
        await pilot.press("1")
        await until(app, pilot, "dead ")

    play(world, story)


def test_it_goes_on_with_the_next_system_of_the_name(world: World) -> None:
    async def run() -> None:
        with robot(world.name):
            app = InspectorApp(world.name)
            pilots = app.run_test(size=SIZES[0])
            pilot = await pilots.__aenter__()
            await until(app, pilot, "supervisor runs")
        await until(app, pilot, "waiting until it is up again")
        with robot(world.name) as played:
            played.events.status("PSM1: again", "PSM1")
            await pilot.press("4")
            await until(app, pilot, "supervisor runs", "PSM1: again")
            await pilots.__aexit__(None, None, None)

    asyncio.run(run())


def test_what_is_typed_quickly_behind_a_slash_is_searched_for(world: World) -> None:
    async def story(app: InspectorApp, pilot: Pilot[None], played: ScriptedRobot) -> None:
        await until(app, pilot, "supervisor runs")
        for key in ("2", "slash", "d", "f", "enter", "4"):
            app.simulate_key(key)
        await until(app, pilot, "all of all processes")
        app.simulate_key("2")
        await until(app, pilot, 'with "df"')
        assert app.page.palette is DARK and not app.frozen_ns

    play(world, story)
