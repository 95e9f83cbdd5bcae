"""Clutch buttons of Si setup arms: inputs of the arms that they carry, in those arms' ios."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from trocar.procs.suj.loop import brakes, clutches


class Inputs:
    """The inputs of an io, in its ring."""

    def __init__(self) -> None:
        self.values, self.there = np.zeros(3, dtype=bool), True

    def newest(self) -> bool:
        return self.there

    def field(self, name: str) -> Any:
        assert name == "input"
        return self.values


def arm(name: str, io: str, *buttons: str) -> Any:
    first, second = (*buttons, "", "")[:2]
    return SimpleNamespace(name=name, io=io, inputs=SimpleNamespace(suj_clutch=first, suj_clutch_2=second))


def test_either_button_of_a_carried_arm_lets_its_set_up_arm_go() -> None:
    rings = {"IO1": Inputs(), "IO2": Inputs()}
    inputs = [SimpleNamespace(name=name) for name in ("other", "clutch", "clutch_2")]
    node: Any = SimpleNamespace(
        reads=lambda io, topic: rings[io],
        document=SimpleNamespace(arms=[arm("PSM1", "IO1", "clutch", "clutch_2"), arm("PSM2", "IO2", "clutch"),
                                       arm("ECM", "IO2")],
                                 io=lambda name: SimpleNamespace(digital_inputs=inputs)))
    cart: Any = SimpleNamespace(arms=[SimpleNamespace(carries=name) for name in ("ECM", "PSM1", "PSM2", "PSM3")])
    look = clutches(node, cart)
    assert look(1).tolist() == [False] * 4
    rings["IO2"].values[:] = (True, False, True)
    assert look(2).tolist() == [False] * 4, "not its buttons"
    for place in (1, 2):
        rings["IO1"].values[place] = True
        assert look(3).tolist() == [False, True, False, False]
        rings["IO1"].values[place] = False
    rings["IO2"].values[1] = True
    assert look(4).tolist() == [False, False, True, False]
    rings["IO2"].there, rings["IO2"].values[1] = False, False
    assert look(5).tolist() == [False, False, True, False], "what it was last"


class Mailbox:
    """What an io is asked."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, tuple[float, ...], str]] = []

    def send(self, name: str, values: tuple[float, ...], text: str) -> None:
        self.sent.append((name, values, text))


def test_brakes_are_let_go_by_the_io_that_has_them_and_by_no_other() -> None:
    def io(*rows: tuple[str, str]) -> Any:
        return SimpleNamespace(digital_outputs=[SimpleNamespace(set_by=set_by, robot=robot) for set_by, robot in rows])

    ios = {"IO1": io(("", ""), ("setup_brake", "PSM1_robot")), "IO2": io(("lift", "PSM2"))}
    arms = [SimpleNamespace(name=name, io=place, robot=robot) for name, place, robot in (
        ("PSM1", "IO1", "PSM1_robot"), ("PSM2", "IO2", "PSM2"))]
    node: Any = SimpleNamespace(document=SimpleNamespace(arms=arms, io=ios.__getitem__))
    cart: Any = SimpleNamespace(arms=[SimpleNamespace(carries=name) for name in ("PSM1", "PSM2", "PSM3")])
    mailboxes: Any = {}
    let_go = brakes(node, cart, lambda name: mailboxes.setdefault(name, Mailbox()))
    for place in range(3):
        let_go(place, True)
    let_go(0, False)
    assert list(mailboxes) == ["IO1"], "no place is taken in vain"
    assert mailboxes["IO1"].sent == [("setup_brake", (1.0,), "PSM1_robot"), ("setup_brake", (0.0,), "PSM1_robot")]
