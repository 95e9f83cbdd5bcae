"""What an arm wants of io travels in its setpoints: what counts, what voids it, what io answers."""

from __future__ import annotations

import pytest

from tests.cases import cases
from tests.guarded import UNAUTHORIZED, FakeCell
from tests.io.fault_rows import braked
from tests.io.harness import FakeCommand, IoHarness
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import NOTHING, Code
from trocar.procs.tables.desired_state import OFF, ON
from trocar.shm.mailbox.origins import Origin

OLD, NEW = Origin(77, 0, "trocar home"), Origin(78, 1, "trocar home")


def held(harness: IoHarness) -> IoHarness:
    """Power and joint controller, by desired states alone."""
    harness.arms[0].want(power=ON)
    harness.run(10)
    harness.arms[0].want(power=ON, pid=ON)
    harness.run(2)
    assert harness.record.amps_on[0] and harness.record.pid_enabled[0] and not harness.record.desired_void[0]
    return harness


def refusal(harness: IoHarness) -> str:
    return harness.record.desired_refused[0].decode()


def test_desired_states_power_hold_and_let_go() -> None:
    harness = held(braked())
    generation = harness.record.pid_generation[0]
    harness.arms[0].want(power=ON, pid=ON, brakes=ON, limits=OFF, tracking=ON, velocity=ON, pots=ON)
    harness.run_s(0.2)
    record = harness.record
    assert record.brakes_released[0] and record.tracking_check[0] and record.use_setpoint_velocity[0]
    assert record.pot_check[0]
    assert record.pid_generation[0] == generation and not refusal(harness) and harness.codes == []
    harness.arms[0].want(power=OFF, brakes=OFF)
    harness.run(1)
    assert not record.power_requested[0] and not record.pid_enabled[0] and not record.brakes_released[0]
    assert record.tracking_check[0], "no desired state changes nothing"


def test_generation_0_changes_nothing() -> None:
    harness = held(IoHarness())
    harness.arms[0].want(power=OFF, pid=OFF)
    harness.arms[0].wished("desired_generation")[...] = 0
    harness.run(10)
    assert harness.record.pid_enabled[0] and harness.record.amps_on[0]


@pytest.mark.parametrize("code", [3, 255])
def test_what_is_no_desired_state_changes_nothing(code: int) -> None:
    harness = held(IoHarness())
    harness.arms[0].want(power=code, pid=code)
    harness.run(10)
    assert harness.record.pid_enabled[0] and harness.record.amps_on[0]


def test_desired_states_of_a_silent_arm_change_nothing() -> None:
    harness = IoHarness()
    harness.arms[0].want(power=ON)
    harness.arms_alive = False
    harness.arms[0].stamp_ns = harness.clock.ns - 31_000_000
    harness.run(10)
    assert not harness.record.power_requested[0] and harness.record.desired_generation[0] == 0
    harness.arms_alive = True
    harness.run(1)
    assert harness.record.power_requested[0] and harness.record.desired_generation[0] == 1


def test_a_desired_state_comes_true_as_soon_as_it_can() -> None:
    harness = IoHarness()
    harness.arms[0].want(pid=ON)
    harness.run(100)
    assert refusal(harness) == "it is not powered" and not harness.record.pid_enabled[0]
    harness.arms[0].want(power=ON, pid=ON)
    harness.run(10)
    assert harness.record.pid_enabled[0] and not refusal(harness)


@cases("fault", [fault for fault in codes.FAULTS if fault.action != NOTHING])
def test_after_every_fault_the_same_desired_state_gives_nothing_back(fault: Code) -> None:
    harness = held(IoHarness())
    harness.core.reports.trip(fault, 0)
    harness.run(1)
    on = harness.record.power_requested[0]
    assert harness.record.desired_void[0] and harness.record.fault[0] == fault.number
    assert not harness.record.pid_enabled[0]
    harness.run(50)
    assert harness.record.power_requested[0] == on and not harness.record.pid_enabled[0]
    assert harness.record.fault[0] == fault.number


def test_a_desired_state_in_the_cycle_of_a_fault_is_void() -> None:
    harness = held(IoHarness())
    harness.arms[0].want(power=ON, pid=ON, fault=OFF)
    harness.core.reports.trip(codes.POWER_LOST, 0)
    harness.run(50)
    assert not harness.record.power_requested[0] and harness.record.fault[0] == codes.POWER_LOST.number


def test_a_desired_state_older_than_the_last_fault_counts_for_nothing() -> None:
    harness, cell = held(IoHarness()), FakeCell()
    harness.core.parts.faults[:] = [cell]
    harness.core.reports.trip(codes.POWER_LOST, 0)
    harness.run(1)
    assert cell.valid_from == 1
    harness.arms[0].want(OLD, power=ON)
    harness.run(10)
    assert "not authorized" in refusal(harness) and not harness.record.desired_void[0]
    assert not harness.record.power_requested[0] and harness.record.fault[0] == codes.POWER_LOST.number
    harness.arms[0].want(Origin(0, 1 << 60, ""), power=OFF, limits=OFF)
    harness.run(1)
    assert not refusal(harness), "to end something nobody needs to have asked"
    harness.arms[0].want(NEW, power=ON)
    harness.run(10)
    assert harness.record.amps_on[0] and harness.record.fault[0] == 0


@pytest.mark.parametrize(("name", "values"), [("power_off", ()), ("servo_zero", ()), ("pid_enable", (0.0,))])
def test_a_persons_command_voids_the_desired_state_states(name: str, values: tuple[float, ...]) -> None:
    harness = held(IoHarness())
    assert harness.ask(name, *values).outcome == "done"
    assert harness.record.desired_void[0] and refusal(harness) == f"test requested {name} meanwhile"
    controlled, powered = harness.record.pid_enabled[0], harness.record.power_requested[0]
    assert (controlled, powered) == (False, name != "power_off")
    harness.run(50)
    assert harness.record.pid_enabled[0] == controlled and harness.record.power_requested[0] == powered
    harness.arms[0].want(power=ON)
    harness.run(10)
    assert harness.record.amps_on[0] and not harness.record.desired_void[0]


CHECKS = {"enforce_limits": ("limits", "limits_enforced"), "tracking_check": ("tracking", "tracking_check"),
          "pot_check": ("pots", "pot_check")}


@pytest.mark.parametrize("name", CHECKS)
def test_nobody_takes_a_check_from_an_arm_that_needs_it_and_its_other_desired_states_stay(name: str) -> None:
    harness = held(IoHarness())
    desired, shown = CHECKS[name]
    harness.arms[0].want(power=ON, pid=ON, **{desired: ON})
    harness.run(2)
    asked = harness.ask(name, 0)
    assert asked.answers == [("refused", "PSM1 needs it on; disable PSM1 first")]
    assert getattr(harness.record, shown)[0] and not harness.record.desired_void[0]
    assert harness.ask(name, 1).outcome == "done" and not harness.record.desired_void[0]
    harness.arms[0].want(power=ON, pid=ON, **{desired: OFF})
    harness.run(2)
    assert harness.ask(name, 1).answers == [("refused", "PSM1 needs it off; disable PSM1 first")]


@pytest.mark.parametrize(("name", "why"), [
    *((name, "no arm") for name in CHECKS), ("tracking_check", "an arm that is silent"),
    ("pot_check", "calibration mode")])
def test_a_check_that_no_arm_needs_is_taken_away_by_an_operator_alone_who_is_named(name: str, why: str) -> None:
    harness, (desired, shown) = IoHarness(calibration_mode=why == "calibration mode"), CHECKS[name]
    harness.ask(name, 1)
    if why != "no arm":
        harness.arms[0].want(**{desired: ON})
        harness.run(2)
    if why == "an arm that is silent":
        harness.arms_alive = False
        harness.run(40)
    nobody = FakeCommand(name, "PSM1", 0.0, origin=Origin(0, 0, ""))
    harness.run(1, nobody)
    assert nobody.answers == [("refused", f"{name}: {UNAUTHORIZED}")]
    for cell, outcome in ((FakeCell(), "done"), (FakeCell(valid_from=1), "refused")):
        harness.core.parts.faults[:] = [cell]
        harness.ask(name, 1)
        off = FakeCommand(name, "PSM1", 0.0, origin=Origin(5, 0, "tune.py"))
        harness.run(1, off)
        assert off.outcome == outcome
        assert outcome == "refused" or not getattr(harness.record, shown)[0]
    safer = FakeCommand(name, "PSM1", 1.0, origin=Origin(0, 0, ""))
    harness.run(1, safer)
    assert safer.outcome == "done", "what makes it safer needs nobody"
    said = [event.text for event in harness.core.reports.events if "switched it off" in event.text]
    assert said == [f"{name} is off: tune.py switched it off"]


def test_an_arms_own_mode_takes_its_checks_away_with_nobody_behind_it() -> None:
    """A hand at the clutch of an arm whose process has been restarted."""
    harness = held(IoHarness())
    harness.arms[0].want(power=ON, pid=ON, tracking=ON)
    harness.run(2)
    harness.arms[0].want(Origin(0, 0, ""), tracking=OFF)
    harness.run(2)
    assert not harness.record.tracking_check[0] and refusal(harness) == ""


def test_a_persons_command_wins_over_a_desired_state_of_the_same_cycle() -> None:
    harness = held(IoHarness())
    harness.arms[0].want(power=ON, pid=ON)
    harness.ask("power_off")
    harness.run(50)
    assert not harness.record.power_requested[0] and harness.record.desired_generation[0] == 3


def test_a_desired_state_that_came_of_an_older_command_than_a_persons_power_off_gives_no_power() -> None:
    """An arm held up between what it decided and what it published: its desired state comes after the power-off."""
    harness, cell = held(IoHarness()), FakeCell()
    harness.core.parts.faults[:] = [cell]
    assert harness.ask("power_off").outcome == "done"
    harness.arms[0].want(OLD, power=ON)
    harness.run(10)
    assert "not authorized" in refusal(harness) and "trocar home" in refusal(harness)
    assert not harness.record.power_requested[0]
    harness.arms[0].want(Origin(cell.exempt_origin, 0, "test"), power=ON)
    harness.run(10)
    assert harness.record.power_requested[0], "the command that the power-off was a part of goes on"


def test_a_desired_state_of_nobody_gives_no_power() -> None:
    harness = IoHarness()
    harness.arms[0].want(Origin(0, 1 << 60, ""), power=ON, limits=OFF)
    harness.run(10)
    assert "not authorized" in refusal(harness)
    assert not harness.record.power_requested[0]


def test_other_commands_and_refused_ones_leave_the_desired_state_states() -> None:
    harness = IoHarness()
    harness.arms[0].want(power=ON, pid=ON)
    assert harness.ask("clear_faults").outcome == harness.ask("pid_enable", 2).outcome == "refused"
    harness.ask("set_gains")
    harness.run(10)
    assert harness.record.pid_enabled[0] and not harness.record.desired_void[0]


def test_one_robots_desired_states_are_not_anothers() -> None:
    harness = IoHarness(2)
    for arm in harness.arms:
        arm.want(power=ON)
    harness.run(10)
    harness.ask("power_off", robot="PSM2")
    assert list(harness.record.desired_void) == [False, True] and list(harness.record.power_requested) == [True, False]


def test_power_that_does_not_come_is_not_tried_again_by_the_same_desired_state() -> None:
    harness = IoHarness()
    harness.port.has_supply = False
    harness.arms[0].want(power=ON)
    harness.run(10)
    harness.pass_s(3.5)
    harness.run(50)
    assert harness.record.fault[0] == codes.POWER_TIMEOUT.number and harness.record.desired_void[0]
    assert not harness.record.power_requested[0] and harness.codes == ["power-timeout"]
    harness.port.has_supply = True
    harness.arms[0].want(power=OFF, fault=OFF)
    harness.run(1)
    harness.arms[0].want(power=ON)
    harness.run(10)
    assert harness.record.amps_on[0]


def test_what_became_of_desired_states_is_told_once_with_the_person_behind() -> None:
    harness, reported = braked(), []
    harness.core.parts.desired._report = lambda asked, *what: reported.append((asked.name, asked.origin, *what))
    harness.arms[0].want(NEW, pid=ON)
    harness.run(50)
    harness.arms[0].want(NEW, power=ON)
    harness.run(50)
    assert reported == [("pid_enable", NEW, "refused", "it is not powered"), ("power_on", NEW, "accepted", ""),
                        ("power_on", NEW, "done", "")]
    reported.clear()
    harness.arms[0].want(NEW, pid=ON, brakes=ON)
    harness.run_s(0.2)
    assert [row[0] for row in reported] == ["pid_enable", "brake_release"] and harness.record.brakes_released[0]


def test_a_new_io_begins_with_nothing_seen() -> None:
    harness = held(IoHarness())
    harness.record.restart()
    record = harness.record
    assert not record.desired_generation[0] and not record.desired_void[0] and refusal(harness) == ""


def test_a_command_of_the_arm_with_an_outcome_voids_nothing() -> None:
    harness = IoHarness()
    harness.arms[0].want(power=ON)
    harness.run(10)
    harness.run(1, FakeCommand("bias_encoders", "PSM1", 10.0))
    assert not harness.record.desired_void[0]
