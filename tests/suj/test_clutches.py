"""Clutch buttons of Si setup arms: inputs of the arms that they carry, in those arms' ios."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.node.inputs import Input
from trocar.procs.suj.loop import brakes, hands

MS = 1_000_000


class Inputs:
    """The inputs of an io and the power of its robots, in its ring."""

    epoch = 1

    def __init__(self) -> None:
        self.values, self.there, self.stamp_ns = np.zeros(3, dtype=bool), True, MS
        self.amps_on = np.zeros(2, dtype=bool)

    def newest(self) -> bool:
        return self.there

    def field(self, name: str) -> Any:
        return {"input": self.values, "amps_on": self.amps_on}[name]


def arm(name: str, io: str, *buttons: str) -> Any:
    first, second = (*buttons, "", "")[:2]
    return SimpleNamespace(name=name, io=io, robot=f"{name}_robot",
                           inputs=SimpleNamespace(suj_clutch=first, suj_clutch_2=second))


def io_with(*brakes_of: str) -> Any:
    """An io that releases the brakes under these robots."""
    robots = ["PSM1_robot", "PSM2_robot", "ECM_robot"]
    return SimpleNamespace(
        place=lambda name: SimpleNamespace(row=robots.index(name)),
        digital_inputs=[SimpleNamespace(name=name) for name in ("other", "clutch", "clutch_2")],
        robots=[SimpleNamespace(name=name) for name in robots],
        digital_outputs=[SimpleNamespace(set_by="setup_brake", robot=robot) for robot in brakes_of])


@pytest.fixture
def rings() -> dict[str, Inputs]:
    return {"IO1": Inputs(), "IO2": Inputs()}


@pytest.fixture
def look(rings: dict[str, Inputs]) -> Callable[[int], tuple[Any, Any]]:
    ios = {"IO1": io_with("PSM1_robot"), "IO2": io_with("PSM2_robot")}
    node: Any = SimpleNamespace(
        input=lambda io, late_s: Input(rings[io], late_s),  # type: ignore[arg-type]
        document=SimpleNamespace(arms=[arm("PSM1", "IO1", "clutch", "clutch_2"), arm("PSM2", "IO2", "clutch"),
                                       arm("ECM", "IO2")], io=ios.__getitem__))
    cart: Any = SimpleNamespace(arms=[SimpleNamespace(carries=name) for name in ("ECM", "PSM1", "PSM2", "PSM3")])
    return hands(node, cart)


def test_either_button_of_a_carried_arm_lets_its_set_up_arm_go(rings: dict[str, Inputs], look: Any) -> None:
    assert look(1)[0].tolist() == [False] * 4
    rings["IO2"].values[:] = (True, False, True)
    assert look(2)[0].tolist() == [False] * 4, "not its buttons"
    for place in (1, 2):
        rings["IO1"].values[place] = True
        assert look(3)[0].tolist() == [False, True, False, False]
        rings["IO1"].values[place] = False
    rings["IO2"].values[1] = True
    assert look(4)[0].tolist() == [False, False, True, False]
    rings["IO2"].there, rings["IO2"].values[1] = False, False
    assert look(5)[0].tolist() == [False, False, True, False], "what it was last"


def test_brakes_have_the_power_of_the_carried_arm_as_long_as_its_io_lives(rings: dict[str, Inputs], look: Any) -> None:
    assert look(MS)[1].tolist() == [True, False, False, True], "others do not depend on an io"
    rings["IO1"].amps_on[0] = rings["IO2"].amps_on[1] = True
    assert look(MS)[1].tolist() == [True] * 4
    rings["IO1"].stamp_ns = 61 * MS
    assert look(61 * MS)[1].tolist() == [True, True, False, True], "this io is silent for 60 ms"


class Mailbox:
    """What an io is asked."""

    def __init__(self) -> None:
        self.commands, self.sent = self, list[tuple[str, tuple[float, ...], str]]()

    def send(self, name: str, values: tuple[float, ...], text: str) -> None:
        self.sent.append((name, values, text))


def test_brakes_are_let_go_by_the_io_that_has_them_and_by_no_other() -> None:
    ios = {"IO1": io_with("PSM1_robot"), "IO2": io_with()}
    node: Any = SimpleNamespace(
        document=SimpleNamespace(arms=[arm("PSM1", "IO1"), arm("PSM2", "IO2")], io=ios.__getitem__))
    cart: Any = SimpleNamespace(arms=[SimpleNamespace(carries=name) for name in ("PSM1", "PSM2", "PSM3")])
    mailboxes: Any = {}
    let_go = brakes(node, cart, lambda name: mailboxes.setdefault(name, Mailbox()))
    for place in range(3):
        let_go(place, True)
    let_go(0, False)
    assert list(mailboxes) == ["IO1"], "no place is taken in vain"
    assert mailboxes["IO1"].sent == [("setup_brake", (1.0,), "PSM1_robot"), ("setup_brake", (0.0,), "PSM1_robot")]
