"""Commands to the boards process are carried out or refused with a reason."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.boards.rails import START, Rails, two_buses
from tests.cases import cases
from tests.command_rows import row_named
from trocar.procs.boards.board_commands import BoardCommands
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.packet_faults import KINDS
from trocar.procs.boards.robots.hand import Grip, Hands
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import listed
from trocar.tools.verbs.send import parsed

NAN, INF = float("nan"), float("inf")


class Recorder:
    """Stands for what orders act on: notes what it is told."""

    def __init__(self) -> None:
        self.reported: list[tuple[Any, ...]] = []

    def buses(self, name: str) -> str:
        return f"buses {name}"

    def __getattr__(self, name: str) -> Any:
        def note(*arguments: Any, **named: Any) -> None:
            plain = (a.tolist() if isinstance(a, np.ndarray) else a for a in (*arguments, *named.items()))
            self.reported.append((name, *plain))

        return note


class Asked:
    """A command as the mailbox hands it out."""

    def __init__(self, name: str, values: list[float], text: str) -> None:
        self.name, self.values, self.text, self.outcome = name, np.array(values, dtype=float), text, ""
        self.command = row_named(name, "boards")

    def done(self, text: str = "") -> None:
        self.outcome = "done"

    def refuse(self, reason: str) -> None:
        self.outcome = reason


def _ask(name: str, values: list[float], text: str = "") -> tuple[list[tuple[Any, ...]], str]:
    recorder, command = Recorder(), Asked(name, values, text)
    BoardCommands(recorder, recorder, recorder, recorder).carry_out(command)  # type: ignore[arg-type]
    return recorder.reported, command.outcome


GOOD = [
    ("press", [1], "clutch", ("press", "clutch", True)),
    ("emergency_stop", [0], "", ("stop", False, "")),
    ("insert_instrument", [], "PSM1 NEEDLE:400006", ("insert", "PSM1", "NEEDLE:400006")),
    ("remove_instrument", [], "PSM1", ("remove", "PSM1")),
    ("apply_effort", [1, -2.5], "PSM1", ("push", "PSM1", [1.0, -2.5])),
    ("set_position", [0.5], "MTML_gripper", ("place", "MTML_gripper", [0.5])),
    ("move_by_hand", [0.1, 0.2, 0.1, 0.0], "ECM", ("place", "ECM", [0.1, 0.2, 0.1, 0.0], ("by_hand", True))),
    ("support", [1], "MTML", ("support", "MTML", True)),
    ("pull_tip", [0.1, 0, 0, 0, 0, 0, 1], "MTML", ("hold", "MTML", [0.1, 0, 0, 0, 0, 0, 1], None)),
    ("pull_tip", [0, 0, 0, 0, 0, 0, 1, 400, 0.8], "MTML", ("hold", "MTML", [0, 0, 0, 0, 0, 0, 1], Grip.of(400, 0.8))),
    ("release_tip", [], "MTML", ("release", "MTML")),
    ("amp_fault", [2, 1], "PSM1", ("fail_amplifier", "PSM1", 2, True)),
    ("power_loss", [0], "PSM1", ("lose_supply", "PSM1", False)),
    ("encoder_jump", [1, -40], "PSM1", ("jump_encoder", "PSM1", 1, -40)),
    ("current_error", [1, -0.6], "PSM1", ("shift_current", "PSM1", 1, -0.6)),
    ("pot_drift", [1, 0.01], "PSM1", ("drift", "PSM1", 1, 0.01, None)),
    ("pot_drift", [1, 0, 0], "PSM1", ("drift", "PSM1", 1, 0.0, 0.0)),
    ("pot_dead", [1, 1], "PSM1", ("kill_pot", "PSM1", 1, True)),
    ("encoder_scale", [1, -1], "PSM1", ("scale_encoder", "PSM1", 1, -1.0)),
    ("swap_motors", [1, 2], "PSM1", ("swap_motors", "PSM1", 1, 2)),
    ("jam", [1, 0], "PSM1", ("jam", "PSM1", 1, False)),
    ("unplug_board", [7], "IO1", ("take_away", 7, True, "IO1")),
    ("plug_board", [7], "IO1", ("take_away", 7, False, "IO1")),
    ("bus_reset", [], "", ("reset_bus", "")),
    ("drop_block", [7, 3], "", ("withhold", 7, 3, "")),
    ("spoil_sequence", [7, 3], "IO1", ("spoil_sequence", 7, 3, "IO1")),
    ("temperature", [7, 66], "", ("heat", 7, 66.0, 66.0, "")),
    ("temperature", [7, 66, 40.5], "", ("heat", 7, 66.0, 40.5, "")),
    ("lose_replies", [3], "IO1", ("strike", "lost", "buses IO1", ("count", 3))),
    ("duplicate_replies", [3], "", ("strike", "duplicated", "buses ", ("count", 3))),
    ("drop_replies", [3], "", ("strike", "dropped", "buses ", ("count", 3))),
    ("corrupt_tl", [3], "", ("strike", "mislabelled", "buses ", ("count", 3))),
    ("delay_replies", [3, 0.005], "", ("strike", "late", "buses ", ("count", 3), ("delay_ns", 5_000_000))),
    ("reply_rate", [0.1], "lost", ("strike", "lost", "buses ", ("rate", 0.1), ("delay_ns", 0))),
    ("reply_rate", [0.1, 0.002], "late IO1", ("strike", "late", "buses IO1", ("rate", 0.1), ("delay_ns", 2_000_000))),
    ("packet_loss", [0.01], "IO1", ("lose_packets", 0.01, "buses IO1")),
    ("clear_packet_faults", [], "", ("end",)),
]


@cases(("name", "values", "text", "reported"), GOOD)
def test_each_order_reaches_what_it_is_for(name: str, values: list[float], text: str,
                                           reported: tuple[Any, ...]) -> None:
    assert _ask(name, values, text) == ([reported], "done")


def test_every_command_of_the_table_is_among_them() -> None:
    assert {name for name, *_ in GOOD} == {command.name for command in COMMANDS["boards"]}


def test_every_command_has_an_example_that_works() -> None:
    rows = {command.name: listed(command) for command in COMMANDS["boards"]}
    page = (Path(__file__).resolve().parents[2] / "docs" / "emulated-boards.md").read_text(encoding="utf-8")
    shown = set()
    for line in re.findall(r"`trocar send boards ([^`]*)`", page):
        name, *words = line.split()
        values, text = parsed(rows[name], words)
        shown.add(name)
        assert _ask(name, values, text)[1] == "done", line
    assert shown == rows.keys()


@cases(("name", "values", "text", "reason"), [
    ("press", [], "clutch", "takes on"),
    ("press", [2], "clutch", "on 2; allowed"),
    ("press", [0.5], "clutch", "on 0.5; allowed"),
    ("bus_reset", [1], "", "takes no numbers"),
    ("pull_tip", [0, 0, 0, 0, 0, 0], "MTML", "6 given"),
    ("pull_tip", [0, 0, 0, 0, 0, 0, 1, 9999, 1], "MTML", "stiffness is 9999; allowed: 0 to 5000"),
    ("amp_fault", [NAN, 1], "PSM1", "axis nan"),
    ("amp_fault", [-1, 1], "PSM1", "axis -1; allowed"),
    ("encoder_jump", [1, 2**23 + 1], "PSM1", "counts 8388609; allowed"),
    ("current_error", [0, INF], "PSM1", "current inf; allowed: finite"),
    ("temperature", [7, 1, 2, 3], "", "4 given"),
    ("unplug_board", [16], "IO1", "board 16; allowed"),
    ("lose_replies", [-1], "", "count -1; allowed"),
    ("delay_replies", [1], "", "1 given"),
    ("delay_replies", [1, 61], "", "delay 61; allowed"),
    ("packet_loss", [1.01], "", "rate 1.01; allowed"),
    ("packet_loss", [NAN], "", "rate nan; allowed"),
    ("reply_rate", [0.1], "torn IO1", f"torn: no such fault of replies; there are {', '.join(KINDS)}"),
    ("reply_rate", [0.1], "", "no kind"),
    ("reply_rate", [0.1], "late", "late: 1 numbers"),
    ("reply_rate", [0.1, 0.1], "lost", "lost: 2 numbers"),
    ("dance", [], "", "not possible"),
])
def test_wrong_orders_are_refused_with_the_reason(name: str, values: list[float], text: str, reason: str) -> None:
    reported, outcome = _ask(name, values, text)
    assert reported == []
    with pytest.raises(ValueError, match=reason):
        raise ValueError(outcome)


@cases(("name", "values", "text", "reason"), [
    ("press", [1], "camera", "camera: no such input; there are clutch, limit"),
    ("power_loss", [1], "ECM2", "ECM2: no such robot; there are PSM1, ECM"),
    ("amp_fault", [5, 1], "PSM1", "PSM1: axis 5; allowed: 0 to 4"),
    ("set_position", [1], "PSM1", "PSM1: 1 positions; allowed: 5 from -10 to 10"),
    ("unplug_board", [3], "", "board 3: specify its bus; there are IO1, IO2"),
    ("pull_tip", [0, 0, 0, 0, 0, 0, 1], "MTML", "MTML: no arm to hold; there are PSM1"),
    ("pull_tip", [0, 0, NAN, 0, 0, 0, 1], "PSM1", "x y z qx qy qz qw nan; allowed: finite numbers"),
    ("release_tip", [], "", "no name: no arm to hold; there are PSM1"),
    ("lose_replies", [1], "IO3", "IO3: no such bus; there are IO1, IO2"),
])
def test_who_is_not_there_is_answered_with_who_is(name: str, values: list[float], text: str, reason: str) -> None:
    plant = Rails(7)
    world = Emulation(two_buses(), plant, START)
    board_faults = BoardFaults(world, plant)  # type: ignore[arg-type]  # a plant as far as it goes
    command = Asked(name, values, text)
    BoardCommands(board_faults, Recorder(), Hands(plant, ("PSM1",)), world.packet_faults).carry_out(command)  # type: ignore[arg-type]
    assert command.outcome == reason
