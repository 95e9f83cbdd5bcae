"""What plots are made of: every sample once, of what there is."""

from __future__ import annotations

import json
import math
from typing import Any

from tests.conftest import World
from tests.gui.test_browsers import Console, play

NAME = "plot:PSM1/state.position[1]"


def test_every_sample_comes_once_and_those_of_before_first(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        for k in range(5):
            console.robot.show_arm(0.1 * k)
        found: list[float] = []

        async def take() -> dict[str, Any]:
            await console.tick()
            data = page.last("tick")["data"].get(NAME, {"t": [], "v": []})
            found.extend(data["v"])
            assert len(data["t"]) == len(data["v"])
            return dict(data)

        browser.handle(json.dumps({"op": "want", "sources": [NAME]}))
        await take()
        assert [round(v, 3) for v in found] == [0.0, 0.1, 0.2, 0.3, 0.4]
        console.robot.show_arm(0.5)
        console.robot.show_arm(math.nan)
        await take()
        assert len(found) == 7 and round(found[5], 3) == 0.5 and found[6] is None
        assert (await take())["v"] == []

    play(world.name, story)


def test_what_is_no_number_cannot_be_plotted(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        for name in ("PSM1/state.position[8]", "PSM1/state.state", "PSM1/state.nothing[0]", "PSM1/state.position",
                     "PSM9/state.position[0]", "PSM1/state.position[-9]", "PSM1/control.pid", "../x.y[0]",
                     "PSM1/state", "PSM1/state.position[0:2]", "PSM1/state.position[ 0 ]", "PSM1/state.position[00]",
                     "PSM1/state.position[-1]"):
            browser.handle(json.dumps({"op": "want", "id": 1, "sources": [f"plot:{name}"]}))
            await console.tick()
            assert page.last("reply")["outcome"] == "refused", name
        assert browser.wants == () and console.sources.are_open == console.sources.are_made == 0

    play(world.name, story)


def test_what_nobody_plots_any_more_is_forgotten(world: World) -> None:
    async def story(console: Console) -> None:
        (one, page), (other, _) = console.page(), console.page()
        console.robot.show_arm(0.1)
        names = [f"plot:PSM1/state.{field}[{i}]" for field in ("position", "velocity") for i in range(8)]
        other.handle(json.dumps({"op": "want", "sources": names[:1]}))
        for wanted in (names, names[:8], [*names[:8], "plot:PSM1/state.nothing[0]"]):
            one.handle(json.dumps({"op": "want", "id": 1, "sources": wanted}))
            for open_now in range(2, len(names) + 1, 2):
                await console.tick()
                assert console.sources.are_open <= max(open_now, 8), "a few in each tick"
        assert page.last("reply")["outcome"] == "refused" and one.wants == tuple(names[:8])
        assert console.sources.are_open == console.sources.are_made == 8
        answer = await console.ask(one, page, "want", sources=[*names, "plot:PSM1/state.effort[0]"])
        assert "allowed are 16" in answer["text"] and console.sources.are_made == 8
        one.handle('{"op": "want", "sources": []}')
        assert console.sources.are_open == console.sources.are_made == 1, "another page wants it"
        console.all.leave(other)
        assert console.sources.are_open == console.sources.are_made == 0

    play(world.name, story)
