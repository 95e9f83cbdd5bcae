"""The lens of an endoscope: pedals, commands, lock, and outputs that are not as they should be."""

from __future__ import annotations

import pytest

from procs.focus.lens import AGAIN_NS, COMMANDED_NS, Lens
from procs.focus.loop import carry_out
from tests.arm.fake_io import FakeRequest

CYCLE_NS = 10_000_000


class Rig:
    """Two outputs that do as they are told unless they are stuck, and pedals."""

    def __init__(self) -> None:
        self.pins, self.pedals, self.stuck, self.known = [False, False], [False, False], False, True
        self.said: list[tuple[str, bool]] = []
        self.writes = 0
        self.now_ns = 1_000_000_000
        self.lens = Lens(self)

    def write(self, way: int, high: bool) -> None:
        self.writes += 1
        if not self.stuck:
            self.pins[way] = high

    def tell(self, event: str, on: bool) -> None:
        self.said.append((event, on))

    def step(self, cycles: int = 1) -> list[bool]:
        for _ in range(cycles):
            self.now_ns += CYCLE_NS
            self.lens.step(self.now_ns, self.pedals, self.pins if self.known else None)
        return self.pins

    def send(self, name: str, *values: float) -> str:
        """What came of a command: done, or the reason why not."""
        request = FakeRequest(name, values)
        carry_out(request, self.lens, self.now_ns)
        ((outcome, text),) = request.replies
        return text or outcome


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    assert rig.step() == [True, True], "whatever they were, the lens rests from the first cycle on"
    return rig


def test_pedals_move_the_lens_while_they_are_held(rig: Rig) -> None:
    rig.pedals = [True, False]
    assert rig.step(2000) == [False, True], "a foot may stay as long as it likes"
    rig.pedals = [False, False]
    assert rig.step() == [True, True]
    rig.pedals = [False, True]
    assert rig.step() == [True, False]
    assert rig.said == [("focusing_in", True), ("focusing_in", False), ("focusing_out", True)]


def test_it_goes_one_way_at_a_time(rig: Rig) -> None:
    rig.pedals = [True, False]
    rig.step()
    rig.pedals = [True, True]
    assert rig.step() == [False, True]
    rig.pedals = [True, False]
    assert rig.step() == [False, True], "the pedal that had no effect has none when it is let go"
    rig.pedals = [False, False]
    assert rig.step() == [True, True]


def test_a_lock_stops_it_and_holds_until_a_pedal_is_pressed_anew(rig: Rig) -> None:
    rig.pedals = [True, False]
    rig.step()
    assert rig.send("lock", 1) == "done"
    assert rig.step() == [True, True]
    assert rig.said == [("focusing_in", True), ("focusing_in", False), ("locked", True)]
    assert "the focus is locked" in rig.send("focus_out", 1)
    rig.send("lock", 0)
    assert rig.step() == [True, True], "a pedal that was held all the time does not count"
    rig.pedals = [False, False]
    rig.step()
    rig.pedals = [True, False]
    assert rig.step() == [False, True]


def test_commands_move_it_for_a_while(rig: Rig) -> None:
    assert rig.send("focus_out", 1) == "done"
    assert rig.step() == [True, False]
    assert "it is focusing out" in rig.send("focus_in", 1)
    rig.step(COMMANDED_NS // CYCLE_NS - 2)
    assert rig.pins == [True, False]
    assert rig.step(3) == [True, True], "nobody told it to stop"
    rig.send("focus_in", 1)
    rig.step()
    rig.send("focus_in", 0)
    assert rig.step() == [True, True]


@pytest.mark.parametrize("values", [(), (2.0,), (1.0, 1.0), (float("nan"),)])
def test_commands_take_on_or_off(rig: Rig, values: tuple[float, ...]) -> None:
    assert "takes 1 (on) or 0 (off)" in rig.send("focus_in", *values)
    assert rig.step() == [True, True]


def test_a_pin_that_does_not_obey_is_written_again_now_and_then(rig: Rig) -> None:
    rig.stuck = True
    writes = rig.writes
    rig.send("focus_in", 1)
    rig.step(AGAIN_NS // CYCLE_NS * 3)
    assert rig.writes - writes == 3
    rig.known = False
    rig.step(100)
    assert rig.writes - writes == 3, "nobody knows how the pins are"
    rig.known, rig.stuck = True, False
    assert rig.step() == [False, True]
