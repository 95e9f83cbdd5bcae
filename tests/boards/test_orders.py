"""Commands to the boards process are carried out or refused with a reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from procs.boards.orders import Orders
from shm.commands import COMMANDS


class Recorder:
    """Stands for world and plant: notes what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[Any, ...]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.told.append((name, *arguments))


class Asked:
    """A command as the mailbox hands it out."""

    def __init__(self, name: str, values: list[float], text: str) -> None:
        self.name, self.values, self.text, self.outcome = name, np.array(values, dtype=float), text, ""

    def done(self, text: str = "") -> None:
        self.outcome = "done"

    def refuse(self, reason: str) -> None:
        self.outcome = reason


def _ask(name: str, values: list[float], text: str = "") -> tuple[Recorder, str]:
    recorder, command = Recorder(), Asked(name, values, text)
    system = SimpleNamespace(arm=lambda name: SimpleNamespace(tools=()))
    Orders(system, recorder, recorder, recorder).carry_out(command)  # type: ignore[arg-type]
    return recorder, command.outcome


@pytest.mark.parametrize(("name", "values", "text", "told"), [
    ("press", [1], "clutch", ("press", "clutch", True)),
    ("amp_fault", [2, 1], "PSM1", ("fail_amplifier", "PSM1", 2, True)),
    ("power_loss", [0], "PSM1", ("lose_supply", "PSM1", False)),
    ("encoder_jump", [1, -40], "PSM1", ("jump_encoder", "PSM1", 1, -40)),
    ("remove_instrument", [], "PSM1", ("remove_tool", "PSM1")),
])
def test_each_order_reaches_what_it_is_for(name: str, values: list[float], text: str, told: tuple[Any, ...]) -> None:
    recorder, outcome = _ask(name, values, text)
    assert (recorder.told, outcome) == ([told], "done")


def test_replies_to_lose_are_those_of_a_bus() -> None:
    assert _ask("lose_replies", [3], "IO1")[0].told == [("buses", "IO1"), ("strike", "lost", 3, None)]


@pytest.mark.parametrize(("name", "values", "text", "reason"), [
    ("press", [], "clutch", "number 1 is missing"),
    ("amp_fault", [float("nan"), 1], "PSM1", "number 1"),
    ("insert_instrument", [], "PSM1 NEEDLE:1", "NEEDLE_1: not known to PSM1"),
    ("dance", [], "", "not possible"),
])
def test_wrong_orders_are_refused_with_the_reason(name: str, values: list[float], text: str, reason: str) -> None:
    recorder, outcome = _ask(name, values, text)
    assert reason in outcome
    assert recorder.told == []


def test_every_command_of_the_table_is_known() -> None:
    for command in COMMANDS["boards"]:
        assert "not possible" not in _ask(command.name, [0, 0, 0], "PSM1")[1]
