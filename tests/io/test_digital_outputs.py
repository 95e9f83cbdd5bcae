"""Digital outputs: pins as they are asked for, one-shots, PWM."""

from __future__ import annotations

import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from tests.io.harness import IoHarness
from trocar.procs.document.system import DigitalOutput
from trocar.procs.fpga import registers

LIGHT, LAMP = DigitalOutput("light", 0, 1), DigitalOutput("lamp", 0, 2)
PULSE = DigitalOutput("pulse", 1, 0, high_s=1e-4)
PWM = DigitalOutput("pwm", 1, 3, is_pwm=True, pwm_hz=40_000.0)
SLOW = DigitalOutput("slow", 1, 2, is_pwm=True, pwm_hz=50.0)


@pytest.fixture
def harness() -> IoHarness:
    made = IoHarness(digital_outputs=(LIGHT, LAMP, PULSE, PWM, SLOW))
    made.run(2)
    return made


@pytest.fixture
def boards_harness() -> BoardsHarness:
    """The setup joints of a real site: four outputs, one of them a one-shot, one a PWM."""
    return rig_of("jhu-daVinci/system-SUJ")


def output(boards_harness: BoardsHarness, name: str) -> bool:
    boards_harness.cycle(count=2)
    return bool(boards_harness.record.output[[o.name for o in boards_harness.io.digital_outputs].index(name)])


def test_a_pin_is_set_and_read_back_without_touching_others(boards_harness: BoardsHarness) -> None:
    assert boards_harness.do("set_output", "no_mux_reset", 1).outcome == "done"
    for level in (1, 0, 1):
        assert boards_harness.do("set_output", "disable_PWM", level).outcome == "done"
        assert (output(boards_harness, "disable_PWM"), output(boards_harness, "no_mux_reset")) == (bool(level), True)


def test_two_outputs_asked_for_in_one_cycle_both_change(harness: IoHarness) -> None:
    harness.port.quadlets.clear()
    harness.ask("set_output", 1, robot="light")
    harness.ask("set_output", 1, robot="lamp")
    harness.ask("set_output", 0, robot="light")
    assert harness.port.quadlets == [(0, registers.DIGITAL_OUTPUT, value) for value in (0x200, 0x400, 0x202)]


@pytest.mark.parametrize(("name", "bit", "level"), [("mux_increment", 1, 1), ("no_mux_reset", 0, 0)])
def test_a_one_shot_turns_back_by_itself(boards_harness: BoardsHarness, name: str, bit: int, level: int) -> None:
    boards_harness.do("set_output", name, 1 - level)
    assert boards_harness.do("set_output", name, level).outcome == "done"
    assert output(boards_harness, name) is not bool(level), "0.1 ms are over"
    counts = boards_harness.port.read_quadlet(12, registers.axis_register(bit, registers.PWM))
    assert counts == round(1e-4 * registers.CLOCK_HZ) << (0 if level else 16), "the other level stays"


@pytest.mark.parametrize("duty", [0.1, 0.25, 0.5, 0.9])
def test_pwm_has_the_files_frequency_and_the_share_asked_for(harness: IoHarness, duty: float) -> None:
    harness.port.quadlets.clear()
    assert harness.ask("set_pwm", duty, robot="pwm").outcome == "done"
    (board, address, counts), (_, level, value) = harness.port.quadlets
    assert (board, address) == (1, registers.axis_register(3, registers.PWM))
    high, low = (counts & 0xFFFF) + 2, (counts >> 16) + 2  # an output turns two ticks after its count
    assert registers.CLOCK_HZ / (high + low) == pytest.approx(40_000.0, rel=1e-3)
    assert high / (high + low) == pytest.approx(duty, abs=1e-3)
    assert (level, value) == (registers.DIGITAL_OUTPUT, 0x800)


@pytest.mark.parametrize(("duty", "value"), [(0.0, 0x808), (1.0, 0x800), (1e-4, 0x808)])
def test_a_share_of_nothing_or_all_is_a_level(harness: IoHarness, duty: float, value: int) -> None:
    harness.port.quadlets.clear()
    assert harness.ask("set_pwm", duty, robot="pwm").outcome == "done"
    assert harness.port.quadlets == [(1, registers.axis_register(3, registers.PWM), 0),
                                     (1, registers.DIGITAL_OUTPUT, value)]


@pytest.mark.parametrize(("name", "command", "values", "words"), [
    ("dark", "set_output", (1,), "no output 'dark' here; there are: light, lamp, pulse, pwm, slow"),
    ("light", "set_pwm", (0.5,), "the file does not declare it as a PWM output"),
    ("slow", "set_pwm", (0.5,), "PWM_frequency is 50.0 Hz; allowed: above 375"),
    ("pwm", "set_pwm", (1.5,), "duty 1.5; allowed: [0, 1]"),
    ("pwm", "set_pwm", (), "takes duty [0, 1]; none was given"),
    ("pwm", "set_pwm", (float("nan"),), "duty nan; allowed: [0, 1]"),
])
def test_what_cannot_be_is_refused_with_what_is_allowed(harness: IoHarness, name: str, command: str,
                                                        values: tuple[float, ...], words: str) -> None:
    harness.port.quadlets.clear()
    done = harness.ask(command, *values, robot=name)
    assert done.outcome == "refused" and words in done.answers[-1][1]
    assert harness.port.quadlets == []


def test_a_board_that_returns_gets_its_one_shots_again(harness: IoHarness) -> None:
    harness.port.good = False
    harness.run_s(0.1)
    for board in (0, 1):
        harness.port.power_cycle(board)
    harness.port.good = True
    harness.run(2)
    counts = harness.port.registers[1, registers.axis_register(0, registers.PWM)]
    assert counts == round(1e-4 * registers.CLOCK_HZ)
