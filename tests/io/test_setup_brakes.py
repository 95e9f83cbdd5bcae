"""Brakes of the setup joints under an Si arm: they follow the clutch buttons there while the arm has power."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.boards_harness import rig_of
from tests.io.harness import FakeCommand, IoHarness
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.document.system import DigitalInput, DigitalOutput
from trocar.procs.fpga import registers
from trocar.shm.mailbox.origins import NO_ORIGIN

LET_GO, HOLD = (1, registers.DIGITAL_OUTPUT, 0x100), (1, registers.DIGITAL_OUTPUT, 0x101)
BUTTONS = tuple(DigitalInput(f"PSM1_SUJ_{end}", 0, bit, False, True, True) for bit, end in enumerate(
    ("clutch", "clutch_2")))


@pytest.fixture
def harness() -> IoHarness:
    brake = DigitalOutput("PSM1_SUJ_brake", 1, 0, set_by="setup_brake", robot="PSM1")
    made = IoHarness(digital_inputs=BUTTONS, digital_outputs=(brake,))
    made.run(10)
    return made


def press(harness: IoHarness, bit: int, on: bool) -> list[tuple[int, int, int]]:
    """Press or let go of a button; returns what was written to the output."""
    harness.port.quadlets.clear()
    word = int(harness.port.live[0, 2])
    harness.port.live[0, 2] = np.uint32(word | 1 << bit if on else word & ~(1 << bit))
    harness.run(10)
    return harness.port.quadlets


def reported(harness: IoHarness) -> list[str]:
    return [event.text for event in harness.core.reports.events if "setup" in event.text]


def test_they_hold_at_start_whatever_was_before(harness: IoHarness) -> None:
    assert [q for q in harness.port.quadlets if q[1] == registers.DIGITAL_OUTPUT] == [HOLD] * 3


@pytest.mark.parametrize("bit", [0, 1])
def test_they_let_go_while_a_button_is_pressed(harness: IoHarness, bit: int) -> None:
    harness.power()
    assert press(harness, bit, True) == [LET_GO] * 3
    assert press(harness, bit, False) == [HOLD] * 3
    assert reported(harness) == ["brakes of the setup joints released", "brakes of the setup joints engaged"]


def test_without_power_they_hold_and_say_why(harness: IoHarness) -> None:
    assert press(harness, 0, True) == []
    assert reported(harness) == ["the arm needs power before the brakes of its setup joints are released"]
    press(harness, 0, False)


@pytest.mark.parametrize("bit", [0, 1])
def test_a_button_that_is_pressed_when_power_comes_lets_nothing_go_until_it_was_released(harness: IoHarness,
                                                                                        bit: int) -> None:
    press(harness, bit, True)
    harness.port.quadlets.clear()
    harness.power()
    harness.run_s(1.0)
    assert harness.port.quadlets == []
    warned = [event for event in harness.core.reports.events if event.code == "clutch-stuck"]
    assert len(warned) == 1 and "the button has no effect until released" in warned[0].text
    assert press(harness, 1 - bit, True) == [], "nor does the other one while it is stuck"
    press(harness, 1 - bit, False)
    assert press(harness, bit, False) == [] and press(harness, bit, True) == [LET_GO] * 3
    harness.ask("power_off")
    harness.port.quadlets.clear()
    harness.power()
    assert LET_GO not in harness.port.quadlets


def test_by_command_they_let_go_until_30_ms_after_the_last_time_and_hold_for_anybody(harness: IoHarness) -> None:
    assert harness.ask("setup_brake", 1).answers == [("refused", "its amplifiers are not on")]
    harness.power()
    harness.run(50)
    for _ in range(5):
        assert harness.ask("setup_brake", 1).outcome == "done"
        harness.run(20)
        assert harness.record.output[0]
    harness.run(20)
    assert not harness.record.output[0], "whoever asked has died"
    assert harness.ask("setup_brake", 1).outcome == "done"
    hold, let_go = (FakeCommand("setup_brake", "PSM1", on, origin=NO_ORIGIN) for on in (0.0, 1.0))
    harness.run(3, hold, let_go)
    assert (hold.outcome, let_go.outcome) == ("done", "refused") and not harness.record.output[0]


def test_a_command_that_is_repeated_since_before_power_came_lets_nothing_go_until_it_has_paused(harness: IoHarness
                                                                                                 ) -> None:
    for on in (True, False, True):
        harness.ask("power_on" if on else "power_off")
        for _ in range(60):
            harness.ask("setup_brake", 1)
            harness.run(5)
            assert not harness.record.output[0]
    assert harness.record.amps_on[0]
    harness.run(50)
    harness.ask("setup_brake", 1)
    harness.run(5)
    assert harness.record.output[0]


def test_an_amplifier_that_is_off_for_a_moment_ends_no_command(harness: IoHarness) -> None:
    harness.power()
    harness.run(50)
    for off in (False, True, False):
        harness.ask("setup_brake", 1)
        harness.port.dead_amps = {(0, 0)} if off else set()
        harness.run(5)
        assert harness.record.output[0] is not off


def test_they_hold_when_power_goes_while_the_button_is_pressed(harness: IoHarness) -> None:
    harness.power()
    press(harness, 0, True)
    harness.port.quadlets.clear()
    harness.ask("power_off")
    assert harness.port.quadlets == [HOLD]
    harness.run(5)
    assert harness.port.quadlets == [HOLD] * 3


def test_they_hold_when_io_ends(harness: IoHarness) -> None:
    harness.power()
    press(harness, 0, True)
    harness.port.quadlets.clear()
    harness.core.shutdown()
    assert harness.port.quadlets == [HOLD] * 3


@pytest.mark.slow
def test_the_button_of_a_real_si_arm_lets_them_go() -> None:
    harness = rig_of("jhu-daVinci-Si/system-PSM1")
    assert harness.do("power_on", "PSM1").outcome == "done"
    place = [i.name for i in harness.io.digital_inputs].index("PSM1_SUJ_clutch_2")
    assert not harness.record.input[place] and not harness.record.output[0]
    hand = BoardFaults(harness.world, harness.plant)
    hand.press("PSM1_SUJ_clutch_2", True)
    harness.run(0.1)
    assert harness.record.input[place] and harness.record.output[0], "an output that its controller does not show"
    hand.press("PSM1_SUJ_clutch_2", False)
    harness.run(0.1)
    assert not harness.record.output[0] and harness.errors() == []
