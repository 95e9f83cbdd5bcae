"""Functions of a script are called when something has happened, in calls of that script."""

from __future__ import annotations

from typing import Any

import pytest

from tests.conftest import World
from tests.tools.robot import robot
from trocar.tools.client.callbacks import Callbacks
from trocar.tools.client.moves import Waits
from trocar.tools.client.shared import SharedEvents
from trocar.tools.output.errors import Problem


def test_they_run_when_the_script_looks_and_not_before(world: World) -> None:
    with robot(world.name) as scripted:
        scripted.events.status("before", "PSM1")
        seen: list[Any] = []
        callbacks = Callbacks(SharedEvents(world.name, "PSM1"))
        assert callbacks.run() == 0
        callbacks.set("status", seen.append)
        callbacks.set("operating_state", seen.append)
        scripted.events.status("one", "PSM1")
        scripted.events.emit("operating_state", state="ENABLED")
        scripted.events.status("two", "PSM1")
        assert not seen
        assert callbacks.run() == 3
        assert [event.get("text", event.get("state")) for event in seen] == ["PSM1: one", "ENABLED", "PSM1: two"]
        callbacks.set("status", None)
        scripted.events.status("three", "PSM1")
        assert callbacks.run() == 0
        with pytest.raises(Problem, match="no event sttus; did you mean status"):
            callbacks.set("sttus", seen.append)
        callbacks.close()


def test_one_that_fails_leaves_the_others_for_the_next_look(world: World) -> None:
    with robot(world.name) as scripted:
        seen: list[Any] = []
        callbacks = Callbacks(SharedEvents(world.name, "PSM1"))

        def called(event: Any) -> None:
            seen.append(event["text"])
            if len(seen) == 1:
                raise ArithmeticError

        callbacks.set("status", called)
        for text in ("one", "two"):
            scripted.events.status(text, "PSM1")
        with pytest.raises(ArithmeticError):
            callbacks.run()
        assert callbacks.run() == 1 and seen == ["PSM1: one", "PSM1: two"]
        callbacks.close()


def test_they_run_in_the_waits_of_their_object_and_may_wait_themselves(world: World) -> None:
    with robot(world.name) as scripted:
        seen: list[str] = []
        callbacks = Callbacks(SharedEvents(world.name, "PSM1"))
        waits = Waits(None, callbacks)

        def called(event: Any) -> None:
            seen.append(event["text"])
            if len(seen) == 1:
                scripted.events.status("two", "PSM1")
                waits.until(lambda: len(seen) == 2, 10, "the second one")

        callbacks.set("status", called)
        scripted.events.status("one", "PSM1")
        waits.until(lambda: len(seen) == 2, 10, "both")
        assert seen == ["PSM1: one", "PSM1: two"]
        callbacks.close()


def test_fields_of_a_console_s_record_are_told_when_they_change(world: World) -> None:
    with robot(world.name):
        row = {"stamp_ns": 1, "clutch": False, "scale": 0.2}
        seen: list[Any] = []
        callbacks = Callbacks(SharedEvents(world.name, "PSM1"), lambda: row)
        callbacks.set("clutch", seen.append)
        assert callbacks.run() == 0
        row |= {"stamp_ns": 2, "clutch": True, "scale": 0.3}
        assert callbacks.run(1.0) == 1 and callbacks.run() == 0
        assert seen == [{"stamp_ns": 2, "clutch": True}]
        callbacks.close()
