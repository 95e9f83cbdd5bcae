import numpy as np
import pytest

from tests.cases import cases
from tests.io.harness import FakePort, IoHarness, document
from trocar.procs.fpga import registers
from trocar.procs.io.robots import Robots
from trocar.procs.io.start import prepare


def test_encoders_take_the_value_of_constant_potentiometers() -> None:
    harness = IoHarness(preset=False)
    for axis in range(7):
        harness.port.pot(axis, 1.5)
    generation = int(harness.record.bias_generation[0])
    command = harness.ask("bias_encoders", 200)
    assert command.outcome == "accepted"
    harness.run(100)
    assert harness.record.biasing[0]
    assert not harness.record.biased[0]
    harness.run(110)
    assert command.outcome == "done"
    assert harness.record.biased[0]
    assert not harness.record.biasing[0]
    assert harness.record.bias_generation[0] == generation + 1
    np.testing.assert_allclose(harness.record.position, harness.record.pot_position, atol=1e-5)
    np.testing.assert_allclose(harness.record.position, 1.5, atol=5e-5)


def test_motion_during_the_bias_does_no_harm() -> None:
    harness = IoHarness(preset=False)
    command = harness.ask("bias_encoders", 100)
    for k in range(1, 99):
        for axis in range(7):
            harness.port.place(axis, 1e-3 * k)
            harness.port.pot(axis, 0.5 + 1e-3 * k)
        harness.run(1)
    harness.run(10)
    assert command.outcome == "done"
    np.testing.assert_allclose(harness.record.position, 0.598, atol=1e-4)


def test_preset_encoders_are_accepted_when_asked() -> None:
    harness = IoHarness(preset=True)
    generation = int(harness.record.bias_generation[0])
    assert harness.ask("bias_encoders", -1970).outcome == "done"
    assert harness.record.bias_generation[0] == generation + 1
    assert harness.port.quadlets == []


def test_encoders_that_failed_to_be_set_are_preset_no_more() -> None:
    harness = IoHarness(preset=True)
    harness.port.pot(2, 0.7)
    harness.port.lost_writes = 1000
    command = harness.ask("bias_encoders", 10)
    harness.run(30)
    assert command.outcome == "failed" and not harness.record.biased[0]
    assert harness.codes == ["bias-failed"]
    assert harness.ask("bias_encoders", -10).outcome == "accepted", "not done at once: they are set anew"
    harness.port.lost_writes = 0
    harness.run(30)
    assert harness.record.biased[0]
    assert harness.record.position[2] == pytest.approx(0.7, abs=1e-4)


def test_a_lost_preload_is_written_again() -> None:
    harness = IoHarness(preset=False)
    harness.port.pot(2, 0.7)
    harness.port.lost_writes = 7
    command = harness.ask("bias_encoders", 10)
    harness.run(20)
    assert command.outcome == "done"
    assert harness.record.position[2] == pytest.approx(0.7, abs=1e-4)


def test_an_axis_that_is_left_out_is_set_by_itself() -> None:
    harness = IoHarness(preset=False)
    record = harness.record
    for axis in range(7):
        harness.port.pot(axis, 0.5)
    harness.ask("bias_encoders", 10, 6)
    harness.run(20)
    generation = int(record.bias_generation[0])
    assert record.biased[0] and record.encoder_set.tolist() == [True] * 6 + [False]
    assert record.position[6] == 0.0 and record.encoder_bits[6] == 0, "nobody has set it"
    command = harness.ask("set_encoder", 6, -1.6)
    assert command.outcome == "accepted" and record.biasing[0]
    harness.run(5)
    assert command.outcome == "done" and record.encoder_set.all() and record.biased[0] and not record.biasing[0]
    assert record.bias_generation[0] == generation + 1, "positions mean something else now: what was homed is not"
    assert record.position[6] == pytest.approx(-1.6, abs=1e-4)
    np.testing.assert_allclose(record.position[:6], 0.5, atol=1e-4)


def test_encoders_of_which_one_was_left_out_are_not_taken_for_preset() -> None:
    harness = IoHarness(preset=False)
    harness.ask("bias_encoders", 10, 6)
    harness.run(20)
    assert harness.ask("bias_encoders", -10, 6).outcome == "accepted", "not done at once"


@cases(("values", "reason"), [
    ((6,), "1 given"), ((7, 0.0), "axis 7; allowed: 0 to 6"), ((0.5, 0.0), "axis 0.5"), ((-1, 0.0), "axis -1"),
    ((6, np.nan), "allowed: finite numbers"), ((6, np.inf), "allowed: finite numbers"),
    ((6, -480.0), "-480 is outside the position limits of axis 6, -1.5 to 1.5"),
])
def test_an_encoder_is_not_set_to_what_makes_no_sense(values: tuple[float, ...], reason: str) -> None:
    harness = IoHarness()
    command = harness.ask("set_encoder", *values)
    assert command.outcome == "refused" and reason in command.answers[0][1]
    assert harness.record.encoder_set.all() and harness.port.quadlets == []


def test_an_encoder_is_not_set_under_the_joint_controller() -> None:
    harness = IoHarness().control()
    assert "joint controller is on" in harness.ask("set_encoder", 6, 0.1).answers[0][1]
    harness.ask("pid_enable", 0)
    setting = harness.ask("set_encoder", 6, 0.1)
    assert "under way" in harness.ask("pid_enable", 1).answers[0][1]
    harness.run(5)
    assert setting.outcome == "done" and harness.ask("pid_enable", 1).outcome == "done"


def test_an_encoder_of_an_axis_that_applies_efforts_is_set_while_the_others_hold() -> None:
    harness = IoHarness().control()
    record = harness.record
    harness.send(1, in_effort=[False] * 6 + [True] * 2, position=0.0, effort=0.0)
    harness.run(3)
    assert record.effort_mode.tolist() == [False] * 6 + [True]
    assert "joint controller is on" in harness.ask("set_encoder", 5, 0.1).answers[0][1]
    setting = harness.ask("set_encoder", 6, 0.7)
    harness.run(6)
    assert setting.outcome == "done" and record.pid_enabled[0] and harness.codes == []
    assert record.position[6] == pytest.approx(0.7, abs=1e-4)
    np.testing.assert_allclose(record.setpoint_position, [0.0] * 6 + [0.7], atol=1e-4)


@pytest.mark.parametrize("cycles_before", range(2, 6))
def test_an_arm_that_goes_silent_while_an_encoder_is_set_does_not_make_it_jump(cycles_before: int) -> None:
    harness = IoHarness().control()
    harness.ask("tracking_check", 1)
    record = harness.record
    harness.send(1, in_effort=[False] * 6 + [True] * 2, position=0.0, effort=0.0)
    harness.run(3)
    harness.arms_alive = False
    harness.run(31 - cycles_before)  # held after 30 ms
    assert not record.holding[0] and harness.ask("set_encoder", 6, 1.2).outcome == "accepted"
    errors = []
    for _ in range(10):
        harness.run(1)
        errors.append(abs(float(record.position_error[6])))
    assert max(errors) < 1e-3 and record.holding[0]
    assert record.pid_enabled[0] and harness.codes == [] and record.encoder_set[6]
    assert record.position[6] == pytest.approx(1.2, abs=1e-4) == record.setpoint_position[6]


def test_an_encoder_that_takes_nothing_leaves_nothing_to_trust() -> None:
    harness = IoHarness()
    harness.port.lost_writes = 1000
    command = harness.ask("set_encoder", 6, 1.0)
    harness.run(20)
    assert command.outcome == "failed" and harness.codes == ["bias-failed"]
    assert not harness.record.biased[0] and not harness.record.encoder_set[6]


def test_bias_is_refused_where_it_makes_no_sense() -> None:
    harness = IoHarness()
    assert harness.ask("bias_encoders", 0).outcome == "refused"
    assert harness.ask("bias_encoders", np.nan).outcome == "refused"
    assert "axis 7; allowed: 0 to 6" in harness.ask("bias_encoders", 10, 7).answers[0][1]
    assert "all of them are left out" in harness.ask("bias_encoders", 10, *range(7)).answers[0][1]
    harness.control()
    assert "joint controller" in harness.ask("bias_encoders", 100).answers[0][1]
    harness.ask("pid_enable", 0)
    harness.ask("bias_encoders", 100)
    assert "under way" in harness.ask("bias_encoders", 100).answers[0][1]


def test_generations_go_on_after_a_restart() -> None:
    harness = IoHarness(preset=False)
    harness.record.bias_generation[...] = 7
    harness.record.pid_generation[...] = 5
    harness.record.powered[...] = True
    harness.record.restart()
    assert harness.record.bias_generation[0] == 8
    assert harness.record.pid_generation[0] == 6
    assert not harness.record.powered[0]


def test_start_switches_power_off_and_reads_preloads() -> None:
    robots, port = Robots(document(2)), FakePort((0, 1, 2, 3))
    for board in (2, 3):
        for axis in range(4):
            port.registers[board, registers.axis_register(axis, registers.ENCODER_PRELOAD)] = 0x800123
    assert prepare(robots, port).tolist() == [False] * 7 + [True] * 7
    assert port.quadlets[0] == (0x3F, registers.STATUS, 0x00080F00)
