import numpy as np
import pytest

from tests.io.harness import IoHarness
from trocar.procs.fpga import blocks, registers


def test_one_good_cycle_forgives_over_current() -> None:
    harness = IoHarness().power()
    harness.port.current(3, 1.3)
    harness.run(100)
    harness.port.current(3, 0.0)
    harness.run(1)
    harness.port.current(3, -1.3)
    harness.run(100)
    assert harness.codes == []
    harness.run(1)
    (event,) = [e for e in harness.core.reports.events if e.kind == "error"]
    assert (event.code, event.axis) == ("current", 3)
    assert (event.value, event.limit) == pytest.approx((-1.3, 1.25), abs=1e-3)


def test_current_without_amplifier_has_a_lower_limit() -> None:
    harness = IoHarness()
    harness.port.current(0, 0.15)
    harness.run(150)
    assert harness.codes == []
    harness.port.current(0, 0.25)
    harness.run(101)
    assert harness.codes == ["current"]


def test_safety_amp_disable_trips_with_the_amplifier_it_cut() -> None:
    harness = IoHarness().control()
    harness.port.dead_amps.add((1, 1))
    harness.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)
    harness.port.live[1, blocks.STATUS] &= ~np.uint32(1 << registers.STATUS_AMP_ON_SHIFT + 1)
    harness.run(1)
    assert harness.codes == ["safety-amp-disable"]


def test_a_cut_off_from_before_does_not_bar_power_on() -> None:
    harness = IoHarness()
    harness.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)
    command = harness.ask("power_on")
    harness.run(1)
    assert harness.codes == []
    harness.port.live[1, blocks.STATUS] &= ~np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)  # as enabling does
    harness.run(10)
    assert command.outcome == "done"
    assert harness.codes == []


def test_heat_without_power_is_nobodys_business() -> None:
    harness = IoHarness()
    harness.port.live[:, blocks.TEMPERATURE] = 70 * 2 << 8 | 70 * 2
    harness.run(10)
    assert harness.codes == []


def test_potentiometers_are_compared_only_when_asked() -> None:
    harness = IoHarness()
    harness.port.pot(5, 0.5)
    harness.run(50)
    harness.ask("pot_check", 1)
    harness.ask("pot_check", 0)
    harness.run(50)
    assert harness.codes == []


def test_encoder_overflow_takes_bias_and_power() -> None:
    harness = IoHarness().control()
    harness.port.live[0, blocks.POSITION.start + 2] |= np.uint32(registers.ENCODER_OVERFLOW)
    harness.run(1)
    assert harness.codes == ["encoder-overflow"]
    assert not harness.record.biased[0]
    assert not harness.record.power_requested[0]
    assert len([q for q in harness.port.quadlets if q[1] & 0xF == registers.ENCODER_PRELOAD]) == 7
    harness.run(20)
    assert harness.codes == ["encoder-overflow"]


def test_one_bad_read_keeps_the_last_output() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(5)
    before = harness.dac().copy()
    harness.port.place(0, 0.05)
    harness.port.good = False
    harness.run(1)
    assert (harness.dac() == before).all()
    assert not harness.record.valid
    assert harness.record.position[0] == 0.0
    assert harness.record.age_ns > 0
    harness.port.good = True
    harness.run(1)
    assert harness.record.valid
    assert harness.record.pid_enabled[0]
    assert harness.record.bad_reads == 1
    assert harness.codes == []


def test_efforts_fade_while_samples_are_missing_and_are_whole_again_with_the_next() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(5)
    harness.port.good = False
    shares, before = [], harness.record.current_request.copy()
    for _ in range(12):  # 1 ms each
        harness.run(1)
        shares.append(float(harness.record.current_request[0] / before[0]))
    assert shares[:3] == [1.0] * 3 and shares[-1] == 0.0
    assert shares == sorted(shares, reverse=True) and 0.0 < shares[6] < 1.0
    harness.port.good = True
    harness.run(1)
    assert abs(harness.record.current_request[0]) > 0.5 * abs(before[0]) and harness.codes == []


def test_commands_are_heard_also_without_a_sample() -> None:
    harness = IoHarness().control()
    harness.port.good = False
    assert harness.ask("power_off", 0).outcome == "done"
    assert (harness.port.sent[-1][:, 4] & 0x000C0000 == 0x00080000).all()


def test_what_changes_while_amplifiers_are_warm_is_no_new_warning() -> None:
    harness = IoHarness().power()
    for celsius in (62, 61, 63, 62, 61):
        harness.port.live[:, blocks.TEMPERATURE] = celsius * 2 << 8 | 30 * 2
        harness.run(5)
    assert len([e for e in harness.core.reports.events if e.kind == "warning"]) == 1
