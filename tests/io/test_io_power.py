import contextlib
import dataclasses

import numpy as np
import pytest

from tests.io.harness import FakeCommand, IoHarness, actuator, robot, with_actuators
from trocar.procs.fpga import blocks, registers
from trocar.procs.io import io_commands


def test_nothing_is_powered_before_somebody_asks() -> None:
    harness = IoHarness()
    harness.run(50)
    assert not harness.record.powered[0]
    assert all(not sent[:, 4].any() or (sent[:, 4] & 0x000C0000 == 0x00080000).all() for sent in harness.port.sent)
    assert not any((sent[:, :4] & registers.DAC_AMP_ENABLE).any() for sent in harness.port.sent)


def test_power_on_closes_relay_then_powers_then_enables() -> None:
    harness = IoHarness(close_all_relays=False)
    command = harness.ask("power_on")
    assert command.outcome == "accepted"
    harness.run(1)
    assert (harness.port.sent[-1][:, 4] == registers.CONTROL_POWER_ON | registers.CONTROL_RELAY_ON).all()
    assert not (harness.port.sent[-1][:, :4] & registers.DAC_AMP_ENABLE).any()
    harness.run(3)
    assert command.outcome == "done"
    assert harness.record.powered[0]
    assert harness.record.amps_on[0]
    assert harness.record.amp_enabled.all()


def test_enables_are_sent_once() -> None:
    harness = IoHarness().power()
    harness.run(100)
    enables = [s for s in harness.port.sent if (s[:, :4] & registers.DAC_AMP_ENABLE).any()]
    powers = [s for s in harness.port.sent if (s[:, 4] & 0x000C0000 == 0x000C0000).any()]
    assert len(enables) == 1
    assert len(powers) == 1


def test_relays_of_all_boards_close_at_start() -> None:
    harness = IoHarness()
    harness.run(1)
    assert (harness.port.sent[0][:, 4] & registers.CONTROL_RELAY_ON == registers.CONTROL_RELAY_ON).all()
    assert not (harness.port.sent[0][:, 4] & (1 << 18)).any()


def test_lost_commands_are_repeated_within_the_grace_time() -> None:
    harness = IoHarness()
    harness.port.lose_power_on(5)
    command = harness.ask("power_on")
    harness.run_s(0.6)
    assert command.outcome == "done"


def test_power_that_does_not_come_is_a_fault_after_3_s() -> None:
    harness = IoHarness()
    harness.port.has_supply = False
    command = harness.ask("power_on")
    harness.run(100)
    harness.pass_s(2.8)
    harness.run(1)
    assert harness.codes == []
    harness.pass_s(0.2)
    harness.run(1)
    assert harness.codes == ["power-timeout"]
    assert command.outcome == "failed"
    assert not harness.record.power_requested[0]


def test_a_supply_fault_has_a_grace_time() -> None:
    harness = IoHarness().power()
    harness.port.set_status(registers.STATUS_MV_FAULT)
    harness.run_s(0.1)
    assert harness.codes == []
    harness.run_s(0.15)
    assert harness.codes == ["power-fault"]


def test_an_old_watchdog_flag_is_cleared_by_power_on() -> None:
    harness = IoHarness()
    harness.port.set_status(registers.STATUS_WATCHDOG)
    harness.run(5)
    assert harness.record.watchdog[0]
    harness.power()
    assert harness.codes == []
    assert not harness.record.watchdog[0]


def test_an_amplifier_that_fails_is_told_with_its_axis() -> None:
    harness = IoHarness().power()
    harness.run(10)
    harness.port.dead_amps.add((1, 2))
    harness.run_s(0.1)
    errors = [e for e in harness.core.reports.events if e.kind == "error"]
    assert [(e.code, e.axis) for e in errors] == [("amplifier", 6)]


def test_amplifiers_that_do_not_come_are_a_fault_after_3_s() -> None:
    harness = IoHarness()
    harness.port.dead_amps.add((0, 1))
    harness.ask("power_on")
    harness.run(100)
    assert harness.codes == []
    harness.pass_s(3.0)
    harness.run(100)
    assert harness.codes == ["amplifier"]


def test_power_off_is_repeated_and_zero() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.5)
    harness.run(5)
    assert (harness.currents != 0x8000).any()
    assert harness.ask("power_off", 0).outcome == "done"
    harness.run(5)
    for sent in harness.port.sent[-5:]:
        assert (sent[:, 4] & 0x000C0000 == 0x00080000).all()
        assert (sent[0, :4] & 0x3000FFFF == 0x20008000).all()
    assert harness.port.sent[-1][0, 4] & registers.CONTROL_RELAY_MASK == 0


def test_relays_open_only_when_asked() -> None:
    harness = IoHarness().power()
    harness.ask("power_off", 1)
    assert (harness.port.sent[-1][:, 4] & 0x00030000 == registers.CONTROL_RELAY_OFF).all()


def test_another_power_off_does_not_take_back_that_the_relays_are_to_open() -> None:
    harness = IoHarness().power()
    harness.run(1, FakeCommand("power_off", "PSM1", 1.0), FakeCommand("power_off", "PSM1", 0.0))
    assert (harness.port.sent[-1][:, 4] & 0x00030000 == registers.CONTROL_RELAY_OFF).all()
    harness.run(2)
    assert not harness.record.relay[0]
    harness.power()
    assert harness.record.relay[0]


@pytest.mark.parametrize("broken", [False, True])
def test_farewell_leaves_everything_off_also_where_the_rest_is_broken(
        monkeypatch: pytest.MonkeyPatch, broken: bool) -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.5)
    harness.run(5)

    def breaks(*_: object) -> None:
        raise IndexError("whatever ended the loop")

    if broken:
        monkeypatch.setattr(harness.core.follow, "enable", breaks)
    with pytest.raises(IndexError) if broken else contextlib.nullcontext():
        harness.core.shutdown()
    last = harness.port.sent[-1]
    assert (last[:, 4] == registers.CONTROL_POWER_OFF | registers.CONTROL_RELAY_OFF).all()
    assert (last[0, :4] & 0xFFFF == 0x8000).all()
    assert (last[0, :4] & registers.DAC_AMP_ENABLE == 0).all()
    assert broken or not harness.record.pid_enabled[0]


def test_a_current_beyond_the_converter_keeps_its_sign() -> None:
    harness = IoHarness(robots=(with_actuators(robot("PSM1", 0), maximum_current=8.0),)).control()
    for sign, most in ((1.0, 0xFFFF), (-1.0, 0)):
        harness.send(1, in_effort=True, effort=15.0 * sign)
        harness.run(2)
        assert (abs(harness.currents - most) <= 1).all()


def shared_stand() -> IoHarness:
    """A master whose gripper is on its second board."""
    arm = robot("PSM1", 0)
    gripper = dataclasses.replace(robot("gripper", 1, 1), actuators=(actuator(1, 3, maximum_current=0.0),))
    return IoHarness(robots=(arm, gripper))


def test_a_board_stays_powered_while_another_robot_wants_it() -> None:
    harness = shared_stand().power()
    harness.power("gripper")
    harness.ask("power_off", 0, robot="gripper")
    harness.run(5)
    assert harness.record.powered[0]
    assert harness.record.amps_on[0]
    assert harness.codes == []
    harness.ask("power_off", 0)
    harness.run(2)
    assert not harness.port.live[1, 1] & registers.STATUS_POWER


def test_a_fault_takes_robots_on_the_same_board_along() -> None:
    harness = shared_stand().power()
    harness.power("gripper")
    harness.port.live[1, 3] = 70 * 2 << 8 | 70 * 2
    harness.run(2)
    assert "temperature" in harness.codes
    assert not harness.record.power_requested.any()
    assert harness.record.fault.all()


def test_asking_again_changes_nothing() -> None:
    harness = IoHarness().power()
    sent = len([s for s in harness.port.sent if (s[:, 4] & (1 << 18)).any()])
    assert harness.ask("power_on").outcome == "done"
    assert len([s for s in harness.port.sent if (s[:, 4] & (1 << 18)).any()]) == sent


def test_an_unknown_robot_is_refused() -> None:
    answer = IoHarness().ask("power_on", robot="PSM9").answers[0]
    assert answer[0] == "refused"
    assert "PSM1" in answer[1]


def test_power_asked_for_again_and_again_is_refused_in_the_end() -> None:
    harness = IoHarness()
    harness.port.has_supply = False
    asked = [harness.ask("power_on") for _ in range(io_commands.MAX_POWERING + 1)]
    assert {c.outcome for c in asked[:-1]} == {"accepted"}
    assert asked[-1].outcome == "refused"
    harness.ask("power_off")
    harness.run(1)
    assert {c.outcome for c in asked[:-1]} == {"failed"}


def test_an_io_held_up_in_the_middle_of_a_cycle_switches_everything_off_with_that_very_write() -> None:
    harness = IoHarness().control()
    harness.send(1, position=np.full(8, 0.1))
    harness.run(5)
    assert (harness.currents != 0x8000).any() and harness.port.live[0, blocks.STATUS] & registers.STATUS_POWER
    harness.held_up = True
    harness.run(1)
    assert (harness.currents == 0x8000).all()
    power = registers.STATUS_POWER | registers.STATUS_RELAY | 0xF << registers.STATUS_AMP_ON_SHIFT
    assert not (harness.port.live[:, blocks.STATUS] & power).any()


def test_the_relay_counts_as_closed_when_it_is_on_every_board() -> None:
    harness = IoHarness(close_all_relays=False).power()
    assert harness.record.relay[0]
    harness.port.live[1, blocks.STATUS] &= np.uint32(~registers.STATUS_RELAY_FEEDBACK & 0xFFFFFFFF)
    harness.run(1)
    assert not harness.record.relay[0]


def test_a_watchdog_that_is_still_set_delays_the_amplifiers() -> None:
    harness = IoHarness()
    obey = harness.port._obey

    def stuck(row: int) -> None:
        obey(row)
        harness.port.set_status(registers.STATUS_WATCHDOG)

    harness.port._obey = stuck
    harness.ask("power_on")
    harness.run(20)
    assert harness.record.watchdog[0] and not harness.record.powered[0]
    assert not any((sent[:, :4] & registers.DAC_AMP_ENABLE).any() for sent in harness.port.sent)
    harness.port._obey = obey
    harness.run_s(0.3)
    assert harness.record.powered[0] and harness.record.amps_on[0] and not harness.record.watchdog[0]
