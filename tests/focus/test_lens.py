"""The lens of an endoscope: pedals, commands, lock, and outputs that are not as they should be."""

from __future__ import annotations

import pytest

from tests.arm.fake_requests import FakeRequest
from trocar.procs.focus.lens import AGAIN_NS, COMMANDED_NS, Lens
from trocar.procs.focus.loop import execute
from trocar.procs.node.requests import carry_out

CYCLE_NS = 10_000_000


class LensHarness:
    """Two outputs that do as they are told unless they are stuck, and pedals."""

    def __init__(self) -> None:
        self.pins, self.pedals, self.stuck, self.known = [False, False], [False, False], False, True
        self.reported: list[tuple[str, bool]] = []
        self.writes = 0
        self.now_ns = 1_000_000_000
        self.lens = Lens(self)

    def write(self, way: int, high: bool) -> None:
        self.writes += 1
        if not self.stuck:
            self.pins[way] = high

    def report(self, event: str, on: bool) -> None:
        self.reported.append((event, on))

    def step(self, cycles: int = 1) -> list[bool]:
        for _ in range(cycles):
            self.now_ns += CYCLE_NS
            self.lens.step(self.now_ns, self.pedals, self.pins if self.known else None)
        return self.pins

    def send(self, name: str, *values: float) -> str:
        """What came of a command: done, or the reason why not."""
        request = FakeRequest(name, values)
        carry_out(request, lambda each: execute(each, self.lens, self.now_ns))
        ((outcome, text),) = request.replies
        return text or outcome


@pytest.fixture
def harness() -> LensHarness:
    harness = LensHarness()
    assert harness.step() == [True, True], "whatever they were, the lens rests from the first cycle on"
    return harness


def test_pedals_move_the_lens_while_they_are_held(harness: LensHarness) -> None:
    harness.pedals = [True, False]
    assert harness.step(2000) == [False, True], "a foot may stay as long as it likes"
    harness.pedals = [False, False]
    assert harness.step() == [True, True]
    harness.pedals = [False, True]
    assert harness.step() == [True, False]
    assert harness.reported == [("focusing_in", True), ("focusing_in", False), ("focusing_out", True)]


def test_it_goes_one_way_at_a_time(harness: LensHarness) -> None:
    harness.pedals = [True, False]
    harness.step()
    harness.pedals = [True, True]
    assert harness.step() == [False, True]
    harness.pedals = [True, False]
    assert harness.step() == [False, True], "the pedal that had no effect has none when it is let go"
    harness.pedals = [False, False]
    assert harness.step() == [True, True]


def test_a_lock_stops_it_and_holds_until_a_pedal_is_pressed_anew(harness: LensHarness) -> None:
    harness.pedals = [True, False]
    harness.step()
    assert harness.send("lock", 1) == "done"
    assert harness.step() == [True, True]
    assert harness.reported == [("focusing_in", True), ("focusing_in", False), ("locked", True)]
    assert "the focus is locked" in harness.send("focus_out", 1)
    harness.send("lock", 0)
    assert harness.step() == [True, True], "a pedal that was held all the time does not count"
    harness.pedals = [False, False]
    harness.step()
    harness.pedals = [True, False]
    assert harness.step() == [False, True]


def test_commands_move_it_for_a_while(harness: LensHarness) -> None:
    assert harness.send("focus_out", 1) == "done"
    assert harness.step() == [True, False]
    assert "it is focusing out" in harness.send("focus_in", 1)
    harness.step(COMMANDED_NS // CYCLE_NS - 2)
    assert harness.pins == [True, False]
    assert harness.step(3) == [True, True], "nobody told it to stop"
    harness.send("focus_in", 1)
    harness.step()
    harness.send("focus_in", 0)
    assert harness.step() == [True, True]


@pytest.mark.parametrize("values", [(), (2.0,), (1.0, 1.0), (float("nan"),)])
def test_commands_take_on_or_off(harness: LensHarness, values: tuple[float, ...]) -> None:
    assert "0|1" in harness.send("focus_in", *values)
    assert harness.step() == [True, True]


def test_a_pin_that_does_not_obey_is_written_again_now_and_then(harness: LensHarness) -> None:
    harness.stuck = True
    writes = harness.writes
    harness.send("focus_in", 1)
    harness.step(AGAIN_NS // CYCLE_NS * 3)
    assert harness.writes - writes == 3
    harness.known = False
    harness.step(100)
    assert harness.writes - writes == 3, "nobody knows how the pins are"
    harness.known, harness.stuck = True, False
    assert harness.step() == [False, True]
