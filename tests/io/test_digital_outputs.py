"""Digital outputs: pins as they are asked for, one-shots, PWM."""

from __future__ import annotations

import pytest

from procs.config import load_system
from procs.document.system import DigitalOutput
from procs.fpga import registers
from tests import stock
from tests.io.boards_harness import Rig
from tests.io.harness import Stand

LIGHT, LAMP = DigitalOutput("light", 0, 1), DigitalOutput("lamp", 0, 2)
PULSE = DigitalOutput("pulse", 1, 0, high_s=1e-4)
PWM = DigitalOutput("pwm", 1, 3, is_pwm=True, pwm_hz=40_000.0)
SLOW = DigitalOutput("slow", 1, 2, is_pwm=True, pwm_hz=50.0)


@pytest.fixture
def stand() -> Stand:
    made = Stand(digital_outputs=(LIGHT, LAMP, PULSE, PWM, SLOW))
    made.run(2)
    return made


@pytest.fixture
def rig() -> Rig:
    """The set-up joints of a real site: four outputs, one of them a one-shot, one a PWM."""
    loaded = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")],
                         boards="emulated")
    assert loaded.system is not None, loaded.errors
    return Rig(loaded.system)


def output(rig: Rig, name: str) -> bool:
    rig.cycle(count=2)
    return bool(rig.record.output[[o.name for o in rig.io.digital_outputs].index(name)])


def test_a_pin_is_set_and_read_back_without_touching_others(rig: Rig) -> None:
    assert rig.do("set_output", "no_mux_reset", 1).outcome == "done"
    for level in (1, 0, 1):
        assert rig.do("set_output", "disable_PWM", level).outcome == "done"
        assert (output(rig, "disable_PWM"), output(rig, "no_mux_reset")) == (bool(level), True)


def test_two_outputs_asked_for_in_one_cycle_both_change(stand: Stand) -> None:
    stand.port.quadlets.clear()
    stand.ask("set_output", 1, robot="light")
    stand.ask("set_output", 1, robot="lamp")
    stand.ask("set_output", 0, robot="light")
    assert stand.port.quadlets == [(0, registers.DIGITAL_OUTPUT, value) for value in (0x200, 0x400, 0x202)]


@pytest.mark.parametrize(("name", "bit", "level"), [("mux_increment", 1, 1), ("no_mux_reset", 0, 0)])
def test_a_one_shot_turns_back_by_itself(rig: Rig, name: str, bit: int, level: int) -> None:
    rig.do("set_output", name, 1 - level)
    assert rig.do("set_output", name, level).outcome == "done"
    assert output(rig, name) is not bool(level), "0.1 ms are over"
    counts = rig.port.read_quadlet(12, registers.axis_register(bit, registers.PWM))
    assert counts == round(1e-4 * registers.CLOCK_HZ) << (0 if level else 16), "the other level stays"


@pytest.mark.parametrize("duty", [0.1, 0.25, 0.5, 0.9])
def test_pwm_has_the_files_frequency_and_the_share_asked_for(stand: Stand, duty: float) -> None:
    stand.port.quadlets.clear()
    assert stand.ask("set_pwm", duty, robot="pwm").outcome == "done"
    (board, address, counts), (_, level, value) = stand.port.quadlets
    assert (board, address) == (1, registers.axis_register(3, registers.PWM))
    high, low = (counts & 0xFFFF) + 2, (counts >> 16) + 2  # an output turns two ticks after its count
    assert registers.CLOCK_HZ / (high + low) == pytest.approx(40_000.0, rel=1e-3)
    assert high / (high + low) == pytest.approx(duty, abs=1e-3)
    assert (level, value) == (registers.DIGITAL_OUTPUT, 0x800)


@pytest.mark.parametrize(("duty", "value"), [(0.0, 0x808), (1.0, 0x800), (1e-4, 0x808)])
def test_a_share_of_nothing_or_all_is_a_level(stand: Stand, duty: float, value: int) -> None:
    stand.port.quadlets.clear()
    assert stand.ask("set_pwm", duty, robot="pwm").outcome == "done"
    assert stand.port.quadlets == [(1, registers.axis_register(3, registers.PWM), 0),
                                   (1, registers.DIGITAL_OUTPUT, value)]


@pytest.mark.parametrize(("name", "command", "values", "words"), [
    ("dark", "set_output", (1,), "no output 'dark' here; there are: light, lamp, pulse, pwm, slow"),
    ("light", "set_pwm", (0.5,), "the file does not call it a PWM"),
    ("slow", "set_pwm", (0.5,), "PWM_frequency is 50.0 Hz; allowed: above 375"),
    ("pwm", "set_pwm", (1.5,), "duty 1.5; allowed: 0 to 1"), ("pwm", "set_pwm", (), "duty nan; allowed: 0 to 1"),
    ("pwm", "set_pwm", (float("nan"),), "duty nan; allowed: 0 to 1"),
])
def test_what_cannot_be_is_refused_with_what_is_allowed(stand: Stand, name: str, command: str,
                                                        values: tuple[float, ...], words: str) -> None:
    stand.port.quadlets.clear()
    done = stand.ask(command, *values, robot=name)
    assert done.outcome == "refused" and words in done.answers[-1][1]
    assert stand.port.quadlets == []
