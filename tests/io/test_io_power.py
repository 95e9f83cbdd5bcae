import dataclasses

import numpy as np
import pytest

from procs.fpga import blocks, registers
from procs.io import commands
from tests.io.harness import Stand, actuator, robot, with_actuators


def test_nothing_is_powered_before_somebody_asks() -> None:
    stand = Stand()
    stand.run(50)
    assert not stand.record.powered[0]
    assert all(not sent[:, 4].any() or (sent[:, 4] & 0x000C0000 == 0x00080000).all() for sent in stand.port.sent)
    assert not any((sent[:, :4] & registers.DAC_AMP_ENABLE).any() for sent in stand.port.sent)


def test_power_on_closes_relay_then_powers_then_enables() -> None:
    stand = Stand(close_all_relays=False)
    command = stand.ask("power_on")
    assert command.outcome == "accepted"
    stand.run(1)
    assert (stand.port.sent[-1][:, 4] == registers.CONTROL_POWER_ON | registers.CONTROL_RELAY_ON).all()
    assert not (stand.port.sent[-1][:, :4] & registers.DAC_AMP_ENABLE).any()
    stand.run(3)
    assert command.outcome == "done"
    assert stand.record.powered[0]
    assert stand.record.amps_on[0]
    assert stand.record.amp_enabled.all()


def test_enables_are_sent_once() -> None:
    stand = Stand()
    stand.power()
    stand.run(500)
    enables = [s for s in stand.port.sent if (s[:, :4] & registers.DAC_AMP_ENABLE).any()]
    powers = [s for s in stand.port.sent if (s[:, 4] & 0x000C0000 == 0x000C0000).any()]
    assert len(enables) == 1
    assert len(powers) == 1


def test_relays_of_all_boards_close_at_start() -> None:
    stand = Stand()
    stand.run(1)
    assert (stand.port.sent[0][:, 4] & registers.CONTROL_RELAY_ON == registers.CONTROL_RELAY_ON).all()
    assert not (stand.port.sent[0][:, 4] & (1 << 18)).any()


def test_lost_commands_are_repeated_within_the_grace_time() -> None:
    stand = Stand()
    write, lost = stand.port.write_all, [5]

    def lossy() -> bool:
        if lost[0] and (stand.port.out[:, 4] & (1 << 18)).any():
            lost[0] -= 1
            stand.port.out[:, 4] = 0
            return True
        return write()

    stand.port.write_all = lossy
    command = stand.ask("power_on")
    stand.run_s(1.0)
    assert command.outcome == "done"


def test_power_that_does_not_come_is_a_fault_after_3_s() -> None:
    stand = Stand()
    stand.port.has_supply = False
    command = stand.ask("power_on")
    stand.run_s(2.9)
    assert stand.codes == []
    stand.run_s(0.2)
    assert stand.codes == ["power-timeout"]
    assert command.outcome == "failed"
    assert not stand.record.power_wanted[0]


def test_power_loss_is_told_after_the_grace_time_only() -> None:
    stand = Stand()
    stand.power()
    stand.port.has_supply = False
    stand.run_s(1.0)
    assert stand.codes == []
    stand.run_s(2.5)
    assert stand.codes[-1] == "power-lost"
    assert not stand.record.power_wanted[0]


def test_power_loss_with_a_controller_on_acts_at_once() -> None:
    stand = Stand()
    stand.control()
    stand.port.has_supply = False
    stand.run(3)
    assert stand.codes == ["power-lost"]
    assert not stand.record.pid_enabled[0]


def test_late_power_loss_is_told_at_once() -> None:
    stand = Stand()
    stand.power()
    stand.run_s(3.1)
    stand.port.has_supply = False
    stand.run(3)
    assert stand.codes == ["power-lost"]
    assert stand.record.fault[0] == 9


def test_a_supply_fault_has_a_grace_time() -> None:
    stand = Stand()
    stand.power()
    stand.port.set_status(registers.STATUS_MV_FAULT)
    stand.run_s(0.1)
    assert stand.codes == []
    stand.run_s(0.15)
    assert stand.codes == ["power-fault"]


def test_an_old_watchdog_flag_is_cleared_by_power_on() -> None:
    stand = Stand()
    stand.port.set_status(registers.STATUS_WATCHDOG)
    stand.run(5)
    assert stand.record.watchdog[0]
    stand.power()
    assert stand.codes == []
    assert not stand.record.watchdog[0]


def test_a_watchdog_that_trips_switches_off() -> None:
    stand = Stand()
    stand.control()
    stand.port.set_status(registers.STATUS_WATCHDOG)
    stand.run(2)
    assert stand.codes == ["watchdog"]
    assert not stand.record.power_wanted[0]
    assert not stand.record.pid_enabled[0]


def test_an_amplifier_that_fails_is_told_with_its_axis() -> None:
    stand = Stand()
    stand.power()
    stand.run_s(1.0)
    stand.port.dead_amps.add((1, 2))
    stand.run_s(0.1)
    errors = [e for e in stand.core.reports.events if e.kind == "error"]
    assert [(e.code, e.axis) for e in errors] == [("amplifier", 6)]


def test_amplifiers_that_do_not_come_are_a_fault_after_3_s() -> None:
    stand = Stand()
    stand.port.dead_amps.add((0, 1))
    stand.ask("power_on")
    stand.run_s(3.1)
    assert stand.codes == ["amplifier"]


def test_power_off_is_repeated_and_zero() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.5)
    stand.run(5)
    assert (stand.currents != 0x8000).any()
    assert stand.ask("power_off", 0).outcome == "done"
    stand.run(5)
    for sent in stand.port.sent[-5:]:
        assert (sent[:, 4] & 0x000C0000 == 0x00080000).all()
        assert (sent[0, :4] & 0x3000FFFF == 0x20008000).all()
    assert stand.port.sent[-1][0, 4] & registers.CONTROL_RELAY_MASK == 0


def test_relays_open_only_when_asked() -> None:
    stand = Stand()
    stand.power()
    stand.ask("power_off", 1)
    assert (stand.port.sent[-1][:, 4] & 0x00030000 == registers.CONTROL_RELAY_OFF).all()


def test_farewell_leaves_everything_off() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.5)
    stand.run(5)
    stand.core.farewell()
    last = stand.port.sent[-1]
    assert (last[:, 4] == registers.CONTROL_POWER_OFF | registers.CONTROL_RELAY_OFF).all()
    assert (last[0, :4] & 0xFFFF == 0x8000).all()
    assert (last[0, :4] & registers.DAC_AMP_ENABLE == 0).all()
    assert not stand.record.pid_enabled[0]


def test_farewell_switches_off_although_the_rest_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.5)
    stand.run(5)

    def broken(*_: object) -> None:
        raise IndexError("whatever ended the loop")

    monkeypatch.setattr(stand.core._follow, "enable", broken)
    with pytest.raises(IndexError):
        stand.core.farewell()
    last = stand.port.sent[-1]
    assert (last[:, 4] == registers.CONTROL_POWER_OFF | registers.CONTROL_RELAY_OFF).all()
    assert (last[0, :4] & 0xFFFF == 0x8000).all()
    assert (last[0, :4] & registers.DAC_AMP_ENABLE == 0).all()


def test_a_current_beyond_the_converter_keeps_its_sign() -> None:
    stand = Stand(robots=(with_actuators(robot("PSM1", 0), maximum_current=8.0),))
    stand.control()
    for sign, most in ((1.0, 0xFFFF), (-1.0, 0)):
        stand.send(1, in_effort=True, effort=15.0 * sign)
        stand.run(2)
        assert (abs(stand.currents - most) <= 1).all()


def shared_stand() -> Stand:
    """A master whose gripper is on its second board."""
    arm = robot("PSM1", 0)
    gripper = dataclasses.replace(robot("gripper", 1, 1), actuators=(actuator(1, 3, maximum_current=0.0),))
    return Stand(robots=(arm, gripper))


def test_a_board_stays_powered_while_another_robot_wants_it() -> None:
    stand = shared_stand()
    stand.power()
    stand.power("gripper")
    stand.ask("power_off", 0, robot="gripper")
    stand.run(5)
    assert stand.record.powered[0]
    assert stand.record.amps_on[0]
    assert stand.codes == []
    stand.ask("power_off", 0)
    stand.run(2)
    assert not stand.port.live[1, 1] & registers.STATUS_POWER


def test_a_fault_takes_robots_on_the_same_board_along() -> None:
    stand = shared_stand()
    stand.power()
    stand.power("gripper")
    stand.port.live[1, 3] = 70 * 2 << 8 | 70 * 2
    stand.run(2)
    assert "temperature" in stand.codes
    assert not stand.record.power_wanted.any()
    assert stand.record.fault.all()


def test_asking_again_changes_nothing() -> None:
    stand = Stand()
    stand.power()
    sent = len([s for s in stand.port.sent if (s[:, 4] & (1 << 18)).any()])
    assert stand.ask("power_on").outcome == "done"
    assert len([s for s in stand.port.sent if (s[:, 4] & (1 << 18)).any()]) == sent


def test_an_unknown_robot_is_refused() -> None:
    answer = Stand().ask("power_on", robot="PSM9").answers[0]
    assert answer[0] == "refused"
    assert "PSM1" in answer[1]


def test_power_asked_for_again_and_again_is_refused_in_the_end() -> None:
    stand = Stand()
    stand.port.has_supply = False
    asked = [stand.ask("power_on") for _ in range(commands.MOST_POWERING + 1)]
    assert {c.outcome for c in asked[:-1]} == {"accepted"}
    assert asked[-1].outcome == "refused"
    stand.ask("power_off")
    stand.run(1)
    assert {c.outcome for c in asked[:-1]} == {"failed"}


def test_an_io_held_up_in_the_middle_of_a_cycle_switches_everything_off_with_that_very_write() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=np.full(8, 0.1))
    stand.run(5)
    assert (stand.currents != 0x8000).any() and stand.port.live[0, blocks.STATUS] & registers.STATUS_POWER
    stand.held_up = True
    stand.run(1)
    assert (stand.currents == 0x8000).all()
    power = registers.STATUS_POWER | registers.STATUS_RELAY | 0xF << registers.STATUS_AMP_ON_SHIFT
    assert not (stand.port.live[:, blocks.STATUS] & power).any()
