import numpy as np
import pytest

from procs.fpga import blocks, registers
from tests.io.harness import Stand


def test_over_current_trips_on_the_101st_cycle() -> None:
    stand = Stand()
    stand.power()
    stand.run(2)
    stand.port.current(3, -1.3)
    stand.run(100)
    assert stand.codes == []
    stand.run(1)
    assert stand.codes == ["current"]
    event = next(e for e in stand.core.reports.events if e.kind == "error")
    assert event.axis == 3
    assert event.value == pytest.approx(-1.3, abs=1e-3)
    assert event.limit == pytest.approx(1.25)
    assert not stand.record.power_wanted[0]


def test_one_good_cycle_forgives_over_current() -> None:
    stand = Stand()
    stand.power()
    stand.port.current(3, 1.3)
    stand.run(100)
    stand.port.current(3, 0.0)
    stand.run(1)
    stand.port.current(3, 1.3)
    stand.run(100)
    assert stand.codes == []


def test_current_without_amplifier_has_a_lower_limit() -> None:
    stand = Stand()
    stand.port.current(0, 0.15)
    stand.run(150)
    assert stand.codes == []
    stand.port.current(0, 0.25)
    stand.run(101)
    assert stand.codes == ["current"]


def test_safety_amp_disable_trips() -> None:
    stand = Stand()
    stand.control()
    stand.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)
    stand.run(1)
    errors = [(e.code, e.axis) for e in stand.core.reports.events if e.kind == "error"]
    assert errors == [("safety-amp-disable", 5)]
    assert not stand.record.pid_enabled[0]


def test_safety_amp_disable_trips_with_the_amplifier_it_cut() -> None:
    stand = Stand()
    stand.control()
    stand.port.dead_amps.add((1, 1))
    stand.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)
    stand.port.live[1, blocks.STATUS] &= ~np.uint32(1 << registers.STATUS_AMP_ON_SHIFT + 1)
    stand.run(1)
    assert stand.codes == ["safety-amp-disable"]


def test_a_cut_off_from_before_does_not_bar_power_on() -> None:
    stand = Stand()
    stand.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)
    command = stand.ask("power_on")
    stand.run(1)
    assert stand.codes == []
    stand.port.live[1, blocks.STATUS] &= ~np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)  # as enabling does
    stand.run(10)
    assert command.outcome == "done"
    assert stand.codes == []


def test_warm_amplifiers_warn_every_two_minutes() -> None:
    stand = Stand()
    stand.power()
    stand.port.live[:, blocks.TEMPERATURE] = 62 * 2 << 8 | 30 * 2
    stand.run_s(2.0)
    warnings = [e for e in stand.core.reports.events if e.kind == "warning"]
    assert [w.code for w in warnings] == ["temperature-high"]
    assert warnings[0].value == 62.0
    stand.clock.ns += 120_000_000_000
    stand.run(1)
    assert len([e for e in stand.core.reports.events if e.kind == "warning"]) == 2


def test_hot_amplifiers_switch_off() -> None:
    stand = Stand()
    stand.power()
    stand.port.live[0, blocks.TEMPERATURE] = 60 << 8 | 66 * 2
    stand.run(1)
    assert stand.codes == ["temperature"]
    assert not stand.record.power_wanted[0]


def test_heat_without_power_is_nobodys_business() -> None:
    stand = Stand()
    stand.port.live[:, blocks.TEMPERATURE] = 70 * 2 << 8 | 70 * 2
    stand.run(10)
    assert stand.codes == []


def test_potentiometer_error_trips_on_the_11th_cycle() -> None:
    stand = Stand()
    stand.control()
    stand.ask("pot_check", 1)
    stand.port.pot(5, 0.06)
    stand.run(10)
    assert stand.codes == []
    stand.run(1)
    assert stand.codes == ["potentiometer"]
    assert not stand.record.pid_enabled[0]
    stand.run(50)
    assert stand.codes == ["potentiometer"]


def test_potentiometers_are_compared_only_when_asked() -> None:
    stand = Stand()
    stand.port.pot(5, 0.5)
    stand.run(50)
    stand.ask("pot_check", 1)
    stand.ask("pot_check", 0)
    stand.run(50)
    assert stand.codes == []


def test_encoder_overflow_takes_bias_and_power() -> None:
    stand = Stand()
    stand.control()
    stand.port.live[0, blocks.POSITION.start + 2] |= np.uint32(registers.ENCODER_OVERFLOW)
    stand.run(1)
    assert stand.codes == ["encoder-overflow"]
    assert not stand.record.biased[0]
    assert not stand.record.power_wanted[0]
    assert len([q for q in stand.port.quadlets if q[1] & 0xF == registers.ENCODER_PRELOAD]) == 7
    stand.run(20)
    assert stand.codes == ["encoder-overflow"]


def test_faults_of_one_cycle_are_all_told() -> None:
    stand = Stand()
    stand.control()
    stand.port.set_status(registers.STATUS_WATCHDOG)
    stand.port.live[0, blocks.TEMPERATURE] = 70 * 2
    stand.port.live[0, blocks.POSITION.start] |= np.uint32(registers.ENCODER_OVERFLOW)
    stand.run(1)
    assert set(stand.codes) == {"watchdog", "temperature", "encoder-overflow"}
    assert stand.record.fault[0] == 12


def test_a_latched_fault_bars_the_controller_until_power_on() -> None:
    stand = Stand()
    stand.control()
    stand.port.live[0, blocks.TEMPERATURE] = 70 * 2
    stand.run(1)
    stand.port.live[0, blocks.TEMPERATURE] = 30 * 2
    assert stand.ask("pid_enable", 1).outcome == "refused"
    assert stand.record.fault[0] == 5
    stand.control()
    assert stand.record.fault[0] == 0


def test_one_bad_read_keeps_the_last_output() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(5)
    before = stand.dac().copy()
    stand.port.place(0, 0.05)
    stand.port.good = False
    stand.run(1)
    assert (stand.dac() == before).all()
    assert not stand.record.valid
    assert stand.record.position[0] == 0.0
    assert stand.record.age_ns > 0
    stand.port.good = True
    stand.run(1)
    assert stand.record.valid
    assert stand.record.pid_enabled[0]
    assert stand.record.bad_reads == 1
    assert stand.codes == []


def test_efforts_fade_while_samples_are_missing_and_are_whole_again_with_the_next() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(5)
    stand.port.good = False
    shares, before = [], stand.record.current_request.copy()
    for _ in range(12):  # 1 ms each
        stand.run(1)
        shares.append(float(stand.record.current_request[0] / before[0]))
    assert shares[:3] == [1.0] * 3 and shares[-1] == 0.0
    assert shares == sorted(shares, reverse=True) and 0.0 < shares[6] < 1.0
    stand.port.good = True
    stand.run(1)
    assert abs(stand.record.current_request[0]) > 0.5 * abs(before[0]) and stand.codes == []


def test_bad_reads_for_the_watchdog_time_are_a_fault() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(5)
    stand.port.good = False
    stand.run(30)
    assert stand.record.pid_enabled[0]
    stand.run(2)
    assert stand.codes == ["bad-reads"]
    assert "PSM1, boards 0, 1: " in next(e.text for e in stand.core.reports.events if e.kind == "error")
    assert not stand.record.pid_enabled[0]
    assert not stand.record.power_wanted[0]
    assert (stand.dac() & 0xFFFF == 0x8000).all()
    sent = len(stand.port.sent)
    stand.run(1000)
    assert len(stand.port.sent) == sent + 1000
    assert stand.codes == ["bad-reads"]
    warnings = [e for e in stand.core.reports.events if e.kind == "warning"]
    assert 1 <= len(warnings) <= 3
    stand.port.good = True
    stand.run(2)
    assert stand.record.valid
    assert stand.record.fault[0] == 1


def test_commands_are_heard_also_without_a_sample() -> None:
    stand = Stand()
    stand.control()
    stand.port.good = False
    assert stand.ask("power_off", 0).outcome == "done"
    assert (stand.port.sent[-1][:, 4] & 0x000C0000 == 0x00080000).all()
