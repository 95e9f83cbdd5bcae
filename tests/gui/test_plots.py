"""What plots are made of: every sample once, of what there is."""

from __future__ import annotations

import json
import math
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import World
from tests.gui.test_browsers import Console, play
from tests.system.robot import ROOT
from trocar.procs.config import load_system
from trocar.procs.crtk.field_paths import FieldCells
from trocar.procs.gui.validity import checked
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.rows import Field
from trocar.shm.system.directory import topic_of
from trocar.shm.time.clock import monotonic_ns

NAME = "plot:PSM1/state.position[1]"


@pytest.mark.slow
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
        assert browser.wants == () and len(console.sources._open) == len(console.sources._made) == 0

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
                assert len(console.sources._open) <= max(open_now, 8), "a few in each tick"
        assert page.last("reply")["outcome"] == "refused" and one.wants == tuple(names[:8])
        assert len(console.sources._open) == len(console.sources._made) == 8
        answer = await console.ask(one, page, "want", sources=[*names, "plot:PSM1/state.effort[0]"])
        assert "allowed are 16" in answer["text"] and len(console.sources._made) == 8
        one.handle('{"op": "want", "sources": []}')
        assert len(console.sources._open) == len(console.sources._made) == 1, "another page wants it"
        console.all.leave(other)
        assert len(console.sources._open) == len(console.sources._made) == 0

    play(world.name, story)


def plotted(console: Console, *names: str) -> Callable[[], Awaitable[list[float | None]]]:
    """What gives the last number that a page is sent of each."""
    browser, page = console.page()
    browser.handle(json.dumps({"op": "want", "sources": [f"plot:{name}" for name in names]}))

    async def newest() -> list[float | None]:
        page.heard.clear()
        for _ in names:  # a few are opened in each tick
            await console.tick()
        data = [message["data"] for message in page.heard if message["op"] == "tick"]
        return [[v for part in data for v in part.get(f"plot:{name}", {}).get("v", ())][-1] for name in names]

    return newest


def test_the_last_good_value_of_boards_that_are_away_is_no_line(world: World) -> None:
    async def story(console: Console) -> None:
        io = console.robot.io
        newest = plotted(console, *(f"IO1/state.{what}" for what in (
            "position[2]", "current[6]", "powered[0]", "fault[0]", "sample_age_ns[0]", "robot_valid[0]")))
        io.field("position")[2], io.field("current")[6], io.field("powered")[0] = 0.5, 1.5, True
        for is_there in (True, False):
            io.field("robot_valid")[0] = io.field("valid")[...] = is_there
            io.field("sample_age_ns")[0] = 0 if is_there else 6_000_000_000
            io.publish(monotonic_ns())
            found = await newest()
            assert found[:3] == ([0.5, 1.5, 1.0] if is_there else [None, None, None])
            assert found[-3:] == ([0.0, 0.0, 1.0] if is_there else [0.0, 6e9, 0.0]), "io knows that itself"

    play(world.name, story)


def test_what_an_arm_without_power_writes_is_no_line(world: World) -> None:
    async def story(console: Console) -> None:
        newest = plotted(console, *(f"PSM1/state.{what}" for what in (
            "position[0]", "measured_cp[1]", "jaw_position", "valid", "count")))
        console.robot.show_arm(0.5)
        assert await newest() == [0.5, 2.0, 0.5, 1.0, 6.0]
        console.robot.show_arm(0.0, valid=False, jaw=False)
        assert await newest() == [None, None, None, 0.0, 6.0]

    play(world.name, story)


@pytest.mark.parametrize(("name", "cell", "flag"), [
    ("SUJ/state.position", 8 + 3, ("setup_valid", 1)), ("SUJ/state.measured_cp", 3 * 7, ("base_valid", 3)),
    ("SUJ/state.primary_voltage", 9, ("", -1)), ("MTML/state.gripper_position", 0, ("gripper_valid", -1)),
    ("MTML/state.local_measured_cp", 2, ("cartesian_valid", -1)), ("MTMR_PSM1/state.mtm_measured_cp", 2, ("valid", -1)),
    ("MTMR_PSM1/state.scale", 0, ("", -1)), ("console/state.scale", 0, ("", -1)), ("IO1/gains.p_gain", 0, ("", -1))])
def test_each_number_goes_by_its_own_flag(name: str, cell: int, flag: tuple[str, int], tmp_path: Path) -> None:
    document = load_system(ROOT / "configs" / "systems" / "kinematic-full.yaml", boards="emulated").system
    assert document is not None
    instance, ring = name.split(".")[0].split("/")
    row = next((row for row in document.processes if row.name == instance), None) or document.processes[0]
    dims = {"setups": 4, "axes": 7, "drives": 7, "robots": 1, "inputs": 0, "outputs": 0, "teleops": 3}
    dtype = schema_of(topic_of(row.kind, ring), dims).dtype
    cells = FieldCells(Field(name.split(".")[1], "<f8", "", ""), np.array([cell]), (name,), (), False)
    found = checked(document, instance, ring, cells, dtype)
    assert (found.flag, found.flag_row) == flag
