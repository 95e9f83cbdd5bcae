"""Setpoints of an arm: followed, clipped, held where it is silent, and never anything that a motor must not get."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.io.harness import PERIOD_NS, IoHarness, actuator, gains, robot
from trocar.procs.document.system import PidConfig

TIMEOUT = 30_000_000 // PERIOD_NS


def test_enabling_holds_where_the_robot_is() -> None:
    harness = IoHarness()
    for axis in range(7):
        harness.port.place(axis, 0.1 * axis)
    harness.control()
    harness.run(5)
    np.testing.assert_allclose(harness.record.setpoint_position, 0.1 * np.arange(7), atol=1e-12)
    assert (harness.currents == 0x8000).all()
    assert harness.record.pid_generation[0] == 2


def test_set_points_are_followed_in_the_same_cycle() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(1)
    assert (harness.record.setpoint_position == 0.1).all()
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.1)
    expected = int(0.05 * 5242.88 + 32768)
    assert (harness.currents == expected).all()
    np.testing.assert_allclose(harness.record.current_request, 0.05)


def test_set_points_for_another_bias_or_enable_are_ignored() -> None:
    for name in ("bias_generation", "pid_generation"):
        harness = IoHarness().control()
        harness.arms_alive = False
        harness.send(1, position=0.1)
        arm = harness.arms[0]
        arm.bias_generation[...] = harness.record.bias_generation[0]
        arm.pid_generation[...] = harness.record.pid_generation[0]
        getattr(arm, name)[...] += 1
        arm.stamp_ns = harness.clock.ns
        harness.run(3)
        assert (harness.record.setpoint_position == 0.0).all()
        assert not harness.record.holding[0]


def test_set_points_are_clipped_to_the_limits_when_asked() -> None:
    harness = IoHarness().control()
    harness.send(1, position=2.0)
    harness.run(2)
    assert (harness.record.setpoint_position == 2.0).all()
    assert not harness.record.at_limit.any()
    harness.ask("enforce_limits", 1)
    harness.run(1)
    assert (harness.record.setpoint_position == 1.5).all()
    assert harness.record.at_limit.all()
    harness.send(1, position=-1.0)
    harness.run(1)
    assert not harness.record.at_limit.any()


def test_limits_that_are_all_zero_are_refused() -> None:
    encoder = actuator(0, 0).encoder
    assert encoder is not None
    flat = type(encoder)(encoder.bits_to_position, 0.0, 0.0, "FIRMWARE")
    arm = robot("PSM1", 0)
    arm = type(arm)("PSM1", "1", "QLA1", tuple(actuator(i // 4, i % 4, encoder=flat) for i in range(7)))
    assert IoHarness(robots=(arm,)).ask("enforce_limits", 1).outcome == "refused"


def test_a_silent_arm_is_held_after_30_ms() -> None:
    harness = IoHarness().control()
    harness.ask("use_setpoint_v", 1)
    harness.send(1, position=0.1, velocity=1.0, feed_forward=0.05)
    harness.arms[0].has_velocity[...] = True
    harness.run(2)
    harness.arms_alive = False
    harness.run(TIMEOUT - 1)
    assert not harness.record.holding[0]
    harness.run(2)
    assert harness.record.holding[0]
    assert (harness.record.setpoint_position == 0.1).all()
    assert (harness.record.setpoint_velocity == 0.0).all()
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.15)
    assert harness.record.setpoint_age_ns[0] > 30_000_000
    harness.arms_alive = True
    harness.run(1)
    assert not harness.record.holding[0]
    assert harness.codes == []


@pytest.mark.parametrize("stamp", [-(2**63), -1])
def test_a_set_point_from_before_time_began_is_none(stamp: int) -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(2)
    harness.arms_alive = False
    harness.arms[0].stamp_ns = stamp
    harness.run(2)
    assert harness.record.setpoint_age_ns[0] == -1
    assert (harness.record.setpoint_position == 0.1).all()


def test_an_arm_that_asks_for_nothing_is_not_silent() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(1)
    harness.send(0)
    harness.run(100)
    assert not harness.record.holding[0]
    assert (harness.record.setpoint_position == 0.1).all()


MIXED = np.array([True, True, True, False, False, False, False, False])


def test_some_actuators_apply_efforts_while_the_others_follow() -> None:
    harness = IoHarness().control()
    harness.send(1, in_effort=MIXED, position=0.1, effort=0.7, feed_forward=0.05)
    harness.run(1)
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.75] * 3 + [0.15] * 4)
    np.testing.assert_allclose(harness.record.setpoint_position, [0.0] * 3 + [0.1] * 4)
    assert (harness.record.effort_mode == MIXED[:7]).all()
    harness.send(1, in_effort=~MIXED)
    harness.run(1)
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.15] * 3 + [0.75] * 4)


def test_an_actuator_back_from_effort_begins_where_the_set_point_is() -> None:
    harness = IoHarness(pids=(PidConfig("PSM1", "PSM1",
                                        tuple(gains(i_gain=1.0, i_limit=1.0, p_gain=0.0) for _ in range(7))),
                        ))
    harness.control()
    harness.send(1, in_effort=True, position=-1.0)  # nobody looks at it, so nothing winds up
    for axis in range(7):
        harness.port.place(axis, 0.3)
    harness.run(50)
    np.testing.assert_allclose(harness.record.setpoint_position, 0.3, atol=1e-5)
    harness.send(1, in_effort=False, position=0.3)
    harness.run(1)
    assert (harness.record.setpoint_position == 0.3).all()
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.0, atol=1e-4)


def test_without_an_arm_only_actuators_in_effort_mode_stay_where_they_are() -> None:
    harness = IoHarness().control()
    harness.ask("enforce_limits", 1)
    harness.send(1, in_effort=MIXED, position=2.0)
    for axis in range(7):
        harness.port.place(axis, 0.3)
    harness.run(2)
    harness.arms_alive = False
    harness.run(TIMEOUT + 1)
    assert harness.record.holding[0] and not harness.record.effort_mode.any()
    np.testing.assert_allclose(harness.record.setpoint_position, [0.3] * 3 + [1.5] * 4, atol=1e-5)


@pytest.mark.parametrize("row", ["position", "velocity", "effort"])
def test_what_is_not_looked_at_may_be_anything(row: str) -> None:
    harness = IoHarness().control()
    harness.ask("use_setpoint_v", 1)
    harness.arms[0].has_velocity[...] = True
    harness.send(1, in_effort=MIXED, position=0.1, effort=0.7)
    getattr(harness.arms[0], row)[MIXED if row != "effort" else ~MIXED] = np.nan
    harness.run(2)
    assert harness.codes == [] and harness.record.pid_enabled[0]
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.7] * 3 + [0.1] * 4)
    harness.arms_alive = False
    harness.run(TIMEOUT + 1)
    assert harness.codes == [] and harness.record.holding[0] and np.isfinite(harness.record.setpoint_effort).all()


def test_a_lost_arm_is_an_error_but_holds() -> None:
    harness = IoHarness().control()
    harness.send(1, position=0.1)
    harness.run(2)
    harness.arms_alive = False
    harness.run(50)
    harness.pass_s(2.8)
    harness.run(1)
    assert harness.codes == []
    harness.pass_s(5.0)
    harness.run(2)
    assert harness.codes == ["arm-lost"]
    assert harness.record.pid_enabled[0]
    assert harness.record.fault[0] == 0
    assert (harness.record.setpoint_position == 0.1).all()


def test_an_arm_that_never_came_is_waited_for_from_the_enable() -> None:
    harness = IoHarness()
    harness.arms_alive = False
    harness.run(10)
    harness.pass_s(4.0)
    harness.control()
    harness.run(50)
    harness.pass_s(2.0)
    harness.run(1)
    assert harness.codes == [] and harness.record.holding[0]
    harness.pass_s(1.0)
    harness.run(1)
    assert harness.codes == ["arm-lost"]


def test_a_tracking_error_stops_the_controller_not_the_power() -> None:
    harness = IoHarness().control()
    harness.ask("tracking_check", 1)
    harness.send(1, position=0.2)
    harness.run(2)
    assert harness.codes == []
    harness.arms[0].position[4] = 0.21
    harness.run(1)
    event = next(e for e in harness.core.reports.events if e.kind == "error")
    assert (event.code, event.axis, event.limit) == ("tracking", 4, 0.2)
    assert event.value == pytest.approx(0.21)
    assert not harness.record.pid_enabled[0]
    assert harness.record.power_requested[0]
    assert (harness.currents == 0x8000).all()
    assert (harness.dac() & 0xFFFF == 0x8000).all()


def test_a_joint_that_is_blocked_far_before_its_limit_trips_while_its_setpoint_is_clipped_there() -> None:
    harness = IoHarness().control()
    harness.ask("enforce_limits", 1)
    harness.ask("tracking_check", 1)
    for k in range(1, 101):
        harness.send(1, position=[0.02 * k, *(0.0,) * 7])  # to 2 rad; its limit is 1.5
        harness.port.place(0, min(0.02 * k, 1.1))
        harness.run(1)
        if harness.codes:
            break
    assert harness.codes == ["tracking"] and 1.3 < 0.02 * k < 1.4
    harness = IoHarness()
    harness.port.place(0, 1.1)
    harness.control()
    harness.ask("enforce_limits", 1)
    harness.send(1, position=[2.0, *(0.0,) * 7])
    harness.run(2)
    assert harness.record.at_limit[0] and harness.codes == []
    harness.ask("tracking_check", 1)
    assert harness.codes == ["tracking"] and not harness.record.pid_enabled[0]


def test_a_joint_that_is_beyond_its_limit_may_come_back_from_there() -> None:
    harness = IoHarness()
    harness.port.place(0, 1.9)
    harness.port.place(1, -1.9)
    harness.control()
    harness.ask("enforce_limits", 1)
    harness.ask("tracking_check", 1)
    harness.send(1, position=[1.9, -1.9, *(0.0,) * 6])
    harness.run(5)
    assert harness.codes == [] and harness.record.at_limit.tolist()[:3] == [True, True, False]
    harness.send(1, position=[-1.9, -1.9, *(0.0,) * 6])  # to the other end at once, from within
    harness.port.place(0, 1.4)
    harness.run(1)
    assert harness.codes == ["tracking"]


SPEEDS = (1.0,) * 6 + (50.0,)  # rad/s
STEP = 1 / 1500  # rad a cycle


def bounded() -> IoHarness:
    rows = tuple(gains() for _ in range(7))
    harness = IoHarness(pids=(PidConfig("PSM1", "PSM1", rows, max_speeds=SPEEDS),)).control()
    harness.ask("tracking_check", 1)
    return harness


def test_a_wild_setpoint_goes_no_further_than_motors_do_in_that_time() -> None:
    harness = bounded()
    harness.send(1, position=0.0)
    harness.run(1)
    harness.send(1, position=[9.0, -9.0, 0.0005, 0.0, 0.0, 0.0, 0.01, 0.0])
    harness.run(1)
    assert harness.record.setpoint_position.tolist() == pytest.approx([STEP, -STEP, 0.0005, 0.0, 0.0, 0.0, 0.01])
    harness.send(1, position=0.0)
    harness.run(1)
    assert harness.codes == [] and not harness.record.setpoint_position.any() and not harness.record.at_limit.any()


def test_a_setpoint_that_was_slowed_arrives_without_another_record() -> None:
    harness = bounded()
    harness.send(1, position=[0.01, *(0.0,) * 7])
    harness.run(1)
    harness.arms_alive = False
    seen = []
    for _ in range(20):
        harness.run(1)
        seen.append(float(harness.record.setpoint_position[0]))
    assert np.diff([STEP, *seen]).max() == pytest.approx(STEP) and seen[-1] == 0.01


def test_where_io_itself_puts_a_setpoint_it_is_at_once() -> None:
    harness = bounded()
    harness.send(1, in_effort=True, position=0.0, effort=0.0)
    harness.run(3)
    for axis in range(7):
        harness.port.place(axis, 0.1)
    harness.run(1)
    harness.arms_alive = False
    harness.run(TIMEOUT + 1)
    assert harness.record.holding[0] and harness.codes == []
    np.testing.assert_allclose(harness.record.setpoint_position, 0.1, atol=1e-4)


def test_velocity_feed_needs_leave() -> None:
    assert IoHarness(pids=()).ask("use_setpoint_v", 1).outcome == "done"
    axes = tuple(gains(p_gain=0.0, d_gain=1.0) for _ in range(7))
    harness = IoHarness(pids=(PidConfig("PSM1", "PSM1", axes),)).control()
    harness.send(1, velocity=0.5)
    harness.arms[0].has_velocity[...] = True
    for on, effort in ((0, 0.0), (1, 0.5)):
        harness.ask("use_setpoint_v", on)
        harness.run(1)
        np.testing.assert_allclose(harness.record.setpoint_effort, effort)
    harness.arms[0].has_velocity[...] = False
    harness.run(1)
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.0)


def test_the_controller_needs_power_and_bias() -> None:
    harness = IoHarness(preset=False)
    assert harness.ask("pid_enable", 1).answers == [("refused", "it is not powered")]
    harness.power()
    assert harness.ask("pid_enable", 1).answers == [("refused", "its encoders are not biased")]
    assert harness.ask("pid_enable", 2).outcome == "refused"
    assert harness.ask("pid_enable").outcome == "refused"


def test_robots_do_not_disturb_each_other() -> None:
    harness = IoHarness(2)
    harness.control("PSM1")
    harness.control("PSM2")
    harness.ask("tracking_check", 1, robot="PSM2")
    harness.send(1, arm=0, position=0.1)
    harness.send(1, arm=1, position=0.3)
    harness.run(1)
    assert harness.record.pid_enabled.tolist() == [True, False]
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.1] * 7 + [0.0] * 7)


ROWS = ("position", "velocity", "effort", "feed_forward")
LOOKED_AT = [(False, "position"), (False, "velocity"), (False, "feed_forward"),
             (True, "effort"), (True, "feed_forward")]


@given(st.sampled_from([np.nan, np.inf, -np.inf]), st.sampled_from(LOOKED_AT), st.integers(0, 6))
@examples(60)
def test_what_is_not_a_number_never_reaches_the_motors(value: float, field: tuple[bool, str], axis: int) -> None:
    in_effort, row = field
    harness = IoHarness().control()
    harness.ask("use_setpoint_v", 1)
    harness.arms[0].has_velocity[...] = True
    harness.send(1, in_effort=in_effort, position=0.1)
    harness.run(1)
    getattr(harness.arms[0], row)[axis] = value
    sent = len(harness.port.sent)
    harness.run(5)
    assert all((out.reshape(-1)[[0, 1, 2, 3, 5, 6, 7]] & 0xFFFF == 0x8000).all() for out in harness.port.sent[sent:])
    assert harness.codes == ["not-finite"]
    assert not harness.record.pid_enabled[0]
    assert (harness.currents == 0x8000).all()
    for name in ("setpoint_position", "setpoint_velocity", "setpoint_effort", "current_request"):
        assert np.isfinite(getattr(harness.record, name)).all()
    getattr(harness.arms[0], row)[axis] = 0.1
    harness.ask("clear_fault")
    assert harness.ask("pid_enable", 1).outcome == "done"
    harness.run(2)
    assert harness.record.pid_enabled[0]


@given(st.lists(st.floats(-1e300, 1e300), min_size=7, max_size=7), st.booleans())
@examples(60)
def test_currents_stay_within_the_motors_limits(values: list[float], in_effort: bool) -> None:
    harness = IoHarness().control()
    for row in ROWS:
        getattr(harness.arms[0], row)[:7] = values
    harness.send(1, in_effort=in_effort)
    harness.run(2)
    assert (np.abs(harness.record.current_request) <= 1.0).all()
    assert ((harness.currents >= 32768 - 5243) & (harness.currents <= 32768 + 5243)).all()
