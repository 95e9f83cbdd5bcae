"""The lift of a Classic cart at its io: it moves while that is asked for, and stops whatever becomes of who asked."""

from __future__ import annotations

import math

import pytest

from tests.guarded import FakeCell
from tests.io.harness import PERIOD_NS, FakeCommand, IoHarness
from trocar.procs.document.system import DigitalOutput
from trocar.procs.fpga import registers
from trocar.procs.io.bus.transport import PortError
from trocar.procs.tables import codes
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin

PWM, PIN = 3, 2
OUTPUTS = (
    DigitalOutput("no_mux_reset", 1, 0, low_s=1e-4, set_by="multiplexer", robot="PSM1"),
    DigitalOutput("mux_increment", 1, 1, high_s=1e-4, set_by="multiplexer", robot="PSM1"),
    DigitalOutput("disable_PWM", 1, PIN, set_by="lift", robot="PSM1"),
    DigitalOutput("control_PWM", 1, PWM, is_pwm=True, pwm_hz=40_000.0, set_by="lift", robot="PSM1"),
    DigitalOutput("PSM1_SUJ_brake", 1, 1, set_by="setup_brake", robot="PSM1"), DigitalOutput("light", 0, 1))
NEUTRAL, HALF_UP = 0.5, 0.55


@pytest.fixture
def harness() -> IoHarness:
    made = IoHarness(digital_outputs=OUTPUTS)
    made.run(10)
    made.control()
    return made


def is_off(harness: IoHarness) -> bool:
    """The pin that disables the amplifier is high, as the board has it."""
    return bool(harness.record.output[2]) and not int(harness.port.live[1, 2]) >> registers.INPUT_DOUT_SHIFT + PIN & 1


def duty(harness: IoHarness) -> float:
    counts = harness.port.registers[1, registers.axis_register(PWM, registers.PWM)]
    return round(((counts & 0xFFFF) + 2) / ((counts & 0xFFFF) + (counts >> 16) + 4), 2)


def lift(harness: IoHarness, velocity: float, origin: Origin | None = None) -> FakeCommand:
    command = FakeCommand("lift", "PSM1", velocity)
    command.origin = command.origin if origin is None else origin
    harness.run(3, command)
    return command


def test_it_moves_while_it_is_asked_for_and_stops_30_ms_after_the_last_time(harness: IoHarness) -> None:
    assert is_off(harness) and duty(harness) == NEUTRAL
    for _ in range(10):
        assert lift(harness, 0.5).outcome == "done"
        harness.run(7)
        assert not is_off(harness) and duty(harness) == HALF_UP
    harness.run(round(30e6 / PERIOD_NS) - 10)
    assert not is_off(harness)
    harness.run(5)
    assert is_off(harness) and duty(harness) == NEUTRAL


def test_nobody_has_to_be_asked_to_stop_it_but_somebody_to_move_it(harness: IoHarness) -> None:
    lift(harness, 1.0)
    assert lift(harness, 0.0, NO_ORIGIN).outcome == "done" and is_off(harness) and duty(harness) == NEUTRAL
    assert lift(harness, 1.0, NO_ORIGIN).outcome == "refused" and is_off(harness)


def test_after_a_fault_what_was_asked_for_before_does_not_move_it(harness: IoHarness) -> None:
    cell = FakeCell()
    harness.core.parts.faults[:] = [cell]
    assert lift(harness, 1.0, Origin(77, 0, "SUJ")).outcome == "done" and not is_off(harness)
    harness.core.reports.trip(codes.TRACKING, 0)
    harness.run(3)
    assert is_off(harness)
    harness.ask("clear_fault")
    assert harness.ask("pid_enable", 1).outcome == "done"
    assert lift(harness, 1.0, Origin(77, 0, "SUJ")).outcome == "refused" and is_off(harness)
    assert lift(harness, 0.0, Origin(77, 0, "SUJ")).outcome == "done"
    assert lift(harness, 1.0, Origin(78, 1, "SUJ")).outcome == "done" and not is_off(harness)


@pytest.mark.parametrize("lost", [1, 7, 40])
def test_its_stop_is_written_until_the_board_shows_it(harness: IoHarness, lost: int) -> None:
    lift(harness, 0.5)
    harness.port.lost_writes = lost
    lift(harness, 0.0)
    harness.run(2 * lost)
    assert is_off(harness) and not harness.port.lost_writes
    harness.port.quadlets.clear()
    harness.run(20)
    assert harness.port.quadlets == [], "and then no more"


def test_a_board_that_comes_back_with_another_level_is_written_to_again(harness: IoHarness) -> None:
    harness.port.live[1, 2] |= 1 << registers.INPUT_DOUT_SHIFT + PIN
    harness.run(4)
    assert is_off(harness)


@pytest.mark.parametrize("ends", ["pid_enable", "servo_zero", "power_off"])
def test_it_stops_with_the_currents_of_its_setup_joints(harness: IoHarness, ends: str) -> None:
    lift(harness, 0.5)
    harness.ask(ends, *((0,) if ends == "pid_enable" else ()))
    harness.run(2)
    assert is_off(harness) and duty(harness) == NEUTRAL
    done = lift(harness, 0.5)
    assert (done.outcome, done.answers[-1][1]) == ("refused", "its setup joints are not enabled") and is_off(harness)


def test_it_stops_when_setpoints_stop_and_stays_so_when_they_are_back(harness: IoHarness) -> None:
    lift(harness, 0.5)
    harness.arms_alive = False
    for _ in range(5):
        harness.run(10, FakeCommand("lift", "PSM1", 0.5))
    assert is_off(harness)
    harness.arms_alive = True
    harness.run(50)
    assert is_off(harness)


@pytest.mark.parametrize("velocity", [1.01, -2.0, math.nan, math.inf])
def test_other_velocities_than_from_minus_1_to_1_are_refused(harness: IoHarness, velocity: float) -> None:
    done = lift(harness, velocity)
    assert done.outcome == "refused" and "allowed: [-1, 1]" in done.answers[-1][1] and is_off(harness)


def test_it_rests_when_io_ends_and_when_it_begins(harness: IoHarness) -> None:
    lift(harness, 0.5)
    harness.core.shutdown()
    assert not int(harness.port.live[1, 2]) >> registers.INPUT_DOUT_SHIFT + PIN & 1 and duty(harness) == NEUTRAL


@pytest.mark.parametrize(("command", "name", "use"), [
    ("set_output", "PSM1_SUJ_brake", "setup_brake PSM1"), ("set_output", "disable_PWM", "lift PSM1"),
    ("set_output", "control_PWM", "lift PSM1"), ("set_pwm", "control_PWM", "lift PSM1"),
    ("set_output", "mux_increment", "multiplexer PSM1"), ("set_output", "no_mux_reset", "multiplexer PSM1")])
def test_outputs_that_io_sets_by_itself_cannot_be_set_from_outside(harness: IoHarness, command: str, name: str,
                                                                   use: str) -> None:
    harness.port.quadlets.clear()
    for value in (0.0, 1.0):
        done = harness.ask(command, value, robot=name)
        harness.run(5)
        assert done.outcome == "refused" and use in done.answers[-1][1] and harness.port.quadlets == []
    assert harness.ask("set_output", 1, robot="light").outcome == "done"


def test_in_calibration_mode_all_outputs_can_be_set() -> None:
    harness = IoHarness(digital_outputs=OUTPUTS, calibration_mode=True)
    harness.run(10)
    assert harness.ask("set_output", 1, robot="PSM1_SUJ_brake").outcome == "done"
    assert harness.ask("set_output", 0, robot="disable_PWM").outcome == "done"
    assert harness.ask("set_pwm", 0.25, robot="control_PWM").outcome == "done"
    harness.run(2)
    assert harness.record.output[4] and not harness.record.output[2] and duty(harness) == 0.25


def test_the_multiplexer_goes_on_and_back_for_anybody(harness: IoHarness) -> None:
    for on, written in ((1.0, [(1, registers.DIGITAL_OUTPUT, 0x200)]),
                        (0.0, [(1, registers.DIGITAL_OUTPUT, 0x202), (1, registers.DIGITAL_OUTPUT, 0x101)])):
        harness.port.quadlets.clear()
        command = FakeCommand("multiplexer", "PSM1", on, origin=NO_ORIGIN)
        harness.run(1, command)
        assert (command.outcome, harness.port.quadlets) == ("done", written)


@pytest.mark.parametrize(("name", "part"), [
    ("lift", "lift"), ("multiplexer", "multiplexer"), ("setup_brake", "brakes")])
def test_a_robot_without_them_says_so(name: str, part: str) -> None:
    done = IoHarness().ask(name, 0)
    assert done.outcome == "refused" and part in done.answers[-1][1]


def test_a_board_that_cannot_be_written_to_refuses_and_ends_nothing(harness: IoHarness,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(board: int, address: int, value: int) -> None:
        raise PortError("write", "here", "the cable is out")

    lift(harness, 0.5)
    monkeypatch.setattr(harness.port, "write_quadlet", fails)
    for name, value, robot in (("multiplexer", 1, "PSM1"), ("set_output", 1, "light")):
        done = harness.ask(name, value, robot=robot)
        assert done.outcome == "refused" and "the cable is out" in done.answers[-1][1]
    assert lift(harness, 0.0).outcome == "done"
    harness.run(20)
    said = [event.text for event in harness.core.reports.events if "the cable is out" in event.text]
    assert len(said) == 2, "each output's once"
    monkeypatch.undo()
    harness.run(4)
    assert is_off(harness) and duty(harness) == NEUTRAL
