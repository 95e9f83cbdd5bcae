"""A move whose goal was clipped, or that did not arrive: on the handle, and a warning."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

from trocar.shm.mailbox.client import Reply
from trocar.tools.client.moves import Waits, move
from trocar.tools.output.errors import Clipped, Short


class FakeRemote:
    """Answers a move: accepted, then done."""

    instance = "PSM1"

    def __init__(self, text: str, end: str | None = None) -> None:
        self._text, self._end = text, text if end is None else end

    def ask(self, command: str, values: Any, text: str) -> Reply:
        return Reply(7, "accepted", self._text)

    def replies_to(self, number: int) -> list[Reply]:
        return [Reply(number, "done", self._end)]


def test_a_clipped_move_is_on_the_handle_and_warned_of() -> None:
    remote: Any = FakeRemote("clipped: insertion 5.000 → 0.240 m")
    with pytest.warns(Clipped, match=r"PSM1 move_jp was clipped: insertion 5\.000 → 0\.240 m") as caught:
        handle = move(Waits(), remote, "move_jp", (0.0, 0.0, 5.0))
    handle.wait(1.0)
    assert handle.clipped == "insertion 5.000 → 0.240 m" and len(caught) == 1


def test_a_move_within_its_limits_warns_of_nothing() -> None:
    remote: Any = FakeRemote("")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        handle = move(Waits(), remote, "move_jp", (0.0, 0.0, 0.1))
    handle.wait(1.0)
    assert handle.clipped == ""


@pytest.mark.parametrize("clipped", ["", "clipped: insertion 5.000 → 0.240 m"])
@pytest.mark.filterwarnings("ignore::trocar.tools.output.errors.Clipped")
def test_a_move_that_does_not_arrive_is_over_and_says_so_on_the_handle_and_once(clipped: str) -> None:
    remote: Any = FakeRemote(clipped, f"{clipped}; 17.2° short (pitch)".removeprefix("; "))
    handle = move(Waits(), remote, "move_jp", (0.0, 0.3, 5.0))
    with pytest.warns(Short, match=r"PSM1 move_jp is done, 17\.2° short \(pitch\)") as caught:
        handle.wait(1.0)
        handle.wait(1.0)
    assert handle.short == "17.2° short (pitch)" and len(caught) == 1
