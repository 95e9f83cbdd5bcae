"""A person at the terminal: asked before anything powers, believed only when the word is typed."""

from __future__ import annotations

import io
import os
import sys

import numpy as np
import pytest

from trocar.tools.commission.person import AtTerminal, Declined, Settle, Stop
from trocar.tools.output.errors import Misuse


class Typed(io.StringIO):
    """A terminal at which somebody types."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch):
    def at(text: str) -> AtTerminal:
        monkeypatch.setattr(sys, "stdin", Typed(text))
        return AtTerminal()
    return at


def test_only_the_very_word_confirms(types) -> None:
    types("PSM1\n").confirm("power!", "PSM1")
    for reported in ("yes", "psm1", ""):
        with pytest.raises(Declined, match="nothing was switched on"):
            types(f"{reported}\n").confirm("power!", "PSM1")


def test_the_end_of_input_confirms_nothing(types) -> None:
    for asked in (lambda person: person.confirm("power!", "PSM1"), lambda person: person.agrees("Did it move?"),
                  lambda person: person.chosen("Which?", (3, 4))):
        with pytest.raises(Declined, match="not confirmed: the input has ended"):
            asked(types(""))


def test_questions_are_asked_until_they_are_answered(types) -> None:
    assert types("perhaps\ny\n").agrees("Did it move?")
    assert not types("n\n").agrees("Did it move?")
    assert types("7\n3 4\n").chosen("Which?", (3, 4, 5)) == (3, 4)
    assert types("all\n").chosen("Which?", (3, 4, 5)) == (3, 4, 5)
    assert types("none\n").chosen("Which?", (3, 4, 5)) == ()


def test_something_done_by_hand_ends_with_enter(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as terminal, os.fdopen(ours, "w") as keyboard:
        monkeypatch.setattr(sys, "stdin", terminal)
        looks = 0
        for _ in AtTerminal().doing(Stop(True), "Press it."):
            looks += 1
            if looks == 3:
                keyboard.write("\n")
                keyboard.flush()
            assert looks < 100_000
        assert looks >= 3


def test_where_nobody_can_type_nothing_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("PSM1\n"))
    with pytest.raises(Misuse, match="no terminal"):
        AtTerminal()


def test_measured_joints_are_typed_in_mm_and_degrees_and_confirmed(types) -> None:
    act = Settle("SUJ", "PSM1", "SUJ_clutch_2", (0.0, 0.0, 0.0))
    typed = types("350 -90\n350 -90 x\n350 -90 nan\n350 -91, 45.5\nn\n350, -90 45.5\ny\n").measured("PSM1", act)
    assert typed == pytest.approx((0.35, -np.pi / 2, np.radians(45.5)))
    with pytest.raises(Declined, match="the input has ended"):
        types("350 -90 45\n").measured("PSM1", act)
