"""Brakes of the set-up joints under an Si arm: they follow the clutch buttons there while the arm has power."""

from __future__ import annotations

import numpy as np
import pytest

from procs.boards.board_faults import BoardFaults
from procs.document.system import DigitalInput, DigitalOutput
from procs.fpga import registers
from tests.io.harness import Stand
from tests.io.test_real_robots import rig_of

LET_GO, HOLD = (1, registers.DIGITAL_OUTPUT, 0x100), (1, registers.DIGITAL_OUTPUT, 0x101)
BUTTONS = tuple(DigitalInput(f"PSM1_SUJ_{end}", 0, bit, False, True, True) for bit, end in enumerate(
    ("clutch", "clutch_2")))


@pytest.fixture
def stand() -> Stand:
    made = Stand(digital_inputs=BUTTONS, digital_outputs=(DigitalOutput("PSM1_SUJ_brake", 1, 0),))
    made.run(10)
    return made


def press(stand: Stand, bit: int, on: bool) -> list[tuple[int, int, int]]:
    """Press or let go of a button; returns what was written to the output."""
    stand.port.quadlets.clear()
    word = int(stand.port.live[0, 2])
    stand.port.live[0, 2] = np.uint32(word | 1 << bit if on else word & ~(1 << bit))
    stand.run(10)
    return stand.port.quadlets


def told(stand: Stand) -> list[str]:
    return [event.text for event in stand.core.reports.events if "set-up" in event.text]


def test_they_hold_at_start_whatever_was_before(stand: Stand) -> None:
    assert [q for q in stand.port.quadlets if q[1] == registers.DIGITAL_OUTPUT] == [HOLD] * 3


@pytest.mark.parametrize("bit", [0, 1])
def test_they_let_go_while_a_button_is_pressed(stand: Stand, bit: int) -> None:
    stand.power()
    assert press(stand, bit, True) == [LET_GO] * 3
    assert press(stand, bit, False) == [HOLD] * 3
    assert told(stand) == ["brakes of the set-up joints let go", "brakes of the set-up joints hold"]


def test_without_power_they_hold_and_say_why(stand: Stand) -> None:
    assert press(stand, 0, True) == []
    assert told(stand) == ["the arm needs power before the brakes of its set-up joints let go"]
    press(stand, 0, False)


def test_they_hold_when_power_goes_while_the_button_is_pressed(stand: Stand) -> None:
    stand.power()
    press(stand, 0, True)
    stand.port.quadlets.clear()
    stand.ask("power_off")
    assert stand.port.quadlets == [HOLD]
    stand.run(5)
    assert stand.port.quadlets == [HOLD] * 3


def test_they_hold_when_io_ends(stand: Stand) -> None:
    stand.power()
    press(stand, 0, True)
    stand.port.quadlets.clear()
    stand.core.farewell()
    assert stand.port.quadlets == [HOLD] * 3


@pytest.mark.slow
def test_the_button_of_a_real_si_arm_lets_them_go() -> None:
    rig = rig_of("jhu-daVinci-Si/system-PSM1")
    assert rig.do("power_on", "PSM1").outcome == "done"
    place = [i.name for i in rig.io.digital_inputs].index("PSM1_SUJ_clutch_2")
    assert not rig.record.input[place] and not rig.record.output[0]
    hand = BoardFaults(rig.world, rig.plant)
    hand.press("PSM1_SUJ_clutch_2", True)
    rig.run(0.1)
    assert rig.record.input[place] and rig.record.output[0], "an output that its controller does not show"
    hand.press("PSM1_SUJ_clutch_2", False)
    rig.run(0.1)
    assert not rig.record.output[0] and rig.errors() == []
