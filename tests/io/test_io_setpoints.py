import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procs.document.system import PidConfig
from tests.io.harness import PERIOD_NS, Stand, actuator, gains, robot

TIMEOUT = 30_000_000 // PERIOD_NS


def test_enabling_holds_where_the_robot_is() -> None:
    stand = Stand()
    for axis in range(7):
        stand.port.place(axis, 0.1 * axis)
    stand.control()
    stand.run(5)
    np.testing.assert_allclose(stand.record.setpoint_position, 0.1 * np.arange(7), atol=1e-12)
    assert (stand.currents == 0x8000).all()
    assert stand.record.pid_generation[0] == 2


def test_set_points_are_followed_in_the_same_cycle() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(1)
    assert (stand.record.setpoint_position == 0.1).all()
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.1)
    expected = int(0.05 * 5242.88 + 32768)
    assert (stand.currents == expected).all()
    np.testing.assert_allclose(stand.record.current_request, 0.05)


def test_set_points_for_another_bias_or_enable_are_ignored() -> None:
    for name in ("bias_generation", "pid_generation"):
        stand = Stand()
        stand.control()
        stand.arms_alive = False
        stand.send(1, position=0.1)
        arm = stand.arms[0]
        arm.bias_generation[...] = stand.record.bias_generation[0]
        arm.pid_generation[...] = stand.record.pid_generation[0]
        getattr(arm, name)[...] += 1
        arm.stamp_ns = stand.clock.ns
        stand.run(3)
        assert (stand.record.setpoint_position == 0.0).all()
        assert not stand.record.holding[0]


def test_set_points_are_clipped_to_the_limits_when_asked() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=2.0)
    stand.run(2)
    assert (stand.record.setpoint_position == 2.0).all()
    assert not stand.record.at_limit.any()
    stand.ask("enforce_limits", 1)
    stand.run(1)
    assert (stand.record.setpoint_position == 1.5).all()
    assert stand.record.at_limit.all()
    stand.send(1, position=-1.0)
    stand.run(1)
    assert not stand.record.at_limit.any()


def test_holding_outside_the_limits_does_not_move() -> None:
    stand = Stand()
    for axis in range(7):
        stand.port.place(axis, 1.6)
    stand.ask("enforce_limits", 1)
    stand.control()
    stand.run(5)
    np.testing.assert_allclose(stand.record.setpoint_position, 1.6, atol=1e-5)


def test_limits_that_are_all_zero_are_refused() -> None:
    encoder = actuator(0, 0).encoder
    assert encoder is not None
    flat = type(encoder)(encoder.bits_to_position, 0.0, 0.0, "FIRMWARE")
    arm = robot("PSM1", 0)
    arm = type(arm)("PSM1", "1", "QLA1", tuple(actuator(i // 4, i % 4, encoder=flat) for i in range(7)))
    assert Stand(robots=(arm,)).ask("enforce_limits", 1).outcome == "refused"


def test_a_silent_arm_is_held_after_30_ms() -> None:
    stand = Stand()
    stand.control()
    stand.ask("use_setpoint_v", 1)
    stand.send(1, position=0.1, velocity=1.0, feed_forward=0.05)
    stand.arms[0].has_velocity[...] = True
    stand.run(2)
    stand.arms_alive = False
    stand.run(TIMEOUT - 1)
    assert not stand.record.holding[0]
    stand.run(2)
    assert stand.record.holding[0]
    assert (stand.record.setpoint_position == 0.1).all()
    assert (stand.record.setpoint_velocity == 0.0).all()
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.15)
    assert stand.record.setpoint_age_ns[0] > 30_000_000
    stand.arms_alive = True
    stand.run(1)
    assert not stand.record.holding[0]
    assert stand.codes == []


@pytest.mark.parametrize("stamp", [-(2**63), -1])
def test_a_set_point_from_before_time_began_is_none(stamp: int) -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(2)
    stand.arms_alive = False
    stand.arms[0].stamp_ns = stamp
    stand.run(2)
    assert stand.record.setpoint_age_ns[0] == -1
    assert (stand.record.setpoint_position == 0.1).all()


def test_an_arm_that_asks_for_nothing_is_not_silent() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(1)
    stand.send(0)
    stand.run(100)
    assert not stand.record.holding[0]
    assert (stand.record.setpoint_position == 0.1).all()


def test_efforts_are_passed_through() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, in_effort=True, effort=0.4, feed_forward=0.1)
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.5)
    assert stand.record.effort_mode.all()


def test_without_an_arm_efforts_become_a_held_position() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, in_effort=True, effort=0.4)
    for axis in range(7):
        stand.port.place(axis, 0.3)
    stand.run(2)
    stand.arms_alive = False
    stand.run(TIMEOUT + 1)
    assert stand.record.holding[0]
    assert not stand.record.effort_mode.any()
    np.testing.assert_allclose(stand.record.setpoint_position, 0.3, atol=1e-5)
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.0, atol=1e-9)


MIXED = np.array([True, True, True, False, False, False, False, False])


def test_some_actuators_apply_efforts_while_the_others_follow() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, in_effort=MIXED, position=0.1, effort=0.7, feed_forward=0.05)
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, [0.75] * 3 + [0.15] * 4)
    np.testing.assert_allclose(stand.record.setpoint_position, [0.0] * 3 + [0.1] * 4)
    assert (stand.record.effort_mode == MIXED[:7]).all()
    stand.send(1, in_effort=~MIXED)
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, [0.15] * 3 + [0.75] * 4)


def test_an_actuator_back_from_effort_begins_where_the_set_point_is() -> None:
    stand = Stand(pids=(PidConfig("PSM1", "PSM1", tuple(gains(i_gain=1.0, i_limit=1.0, p_gain=0.0) for _ in range(7))),
                        ))
    stand.control()
    stand.send(1, in_effort=True, position=-1.0)  # nobody looks at it, so nothing winds up
    for axis in range(7):
        stand.port.place(axis, 0.3)
    stand.run(50)
    np.testing.assert_allclose(stand.record.setpoint_position, 0.3, atol=1e-5)
    stand.send(1, in_effort=False, position=0.3)
    stand.run(1)
    assert (stand.record.setpoint_position == 0.3).all()
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.0, atol=1e-4)


def test_without_an_arm_only_actuators_in_effort_mode_stay_where_they_are() -> None:
    stand = Stand()
    stand.control()
    stand.ask("enforce_limits", 1)
    stand.send(1, in_effort=MIXED, position=2.0)
    for axis in range(7):
        stand.port.place(axis, 0.3)
    stand.run(2)
    stand.arms_alive = False
    stand.run(TIMEOUT + 1)
    assert stand.record.holding[0] and not stand.record.effort_mode.any()
    np.testing.assert_allclose(stand.record.setpoint_position, [0.3] * 3 + [1.5] * 4, atol=1e-5)


def test_actuators_in_effort_mode_have_no_tracking_error_and_no_limits() -> None:
    stand = Stand()
    for axis in range(7):
        stand.port.place(axis, 1.6 if axis < 3 else 0.0)
    stand.control()
    stand.ask("enforce_limits", 1)
    stand.ask("tracking_check", 1)
    stand.send(1, in_effort=MIXED, position=0.1)
    stand.run(2)
    assert stand.codes == [] and not stand.record.at_limit.any()
    stand.arms[0].position[4] = 0.3
    stand.run(1)
    assert stand.codes == ["tracking"]


@pytest.mark.parametrize("row", ["position", "velocity", "effort"])
def test_what_is_not_looked_at_may_be_anything(row: str) -> None:
    stand = Stand()
    stand.control()
    stand.ask("use_setpoint_v", 1)
    stand.arms[0].has_velocity[...] = True
    stand.send(1, in_effort=MIXED, position=0.1, effort=0.7)
    getattr(stand.arms[0], row)[MIXED if row != "effort" else ~MIXED] = np.nan
    stand.run(2)
    assert stand.codes == [] and stand.record.pid_enabled[0]
    np.testing.assert_allclose(stand.record.setpoint_effort, [0.7] * 3 + [0.1] * 4)
    stand.arms_alive = False
    stand.run(TIMEOUT + 1)
    assert stand.codes == [] and stand.record.holding[0] and np.isfinite(stand.record.setpoint_effort).all()


def test_a_lost_arm_is_an_error_but_holds() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(2)
    stand.arms_alive = False
    stand.run_s(2.9)
    assert stand.codes == []
    stand.run_s(5.0)
    assert stand.codes == ["arm-lost"]
    assert stand.record.pid_enabled[0]
    assert stand.record.fault[0] == 0
    assert (stand.record.setpoint_position == 0.1).all()


def test_a_lost_arm_may_be_powered_off() -> None:
    stand = Stand(arm_lost_power_off_s=5.0)
    stand.control()
    stand.arms_alive = False
    stand.run_s(5.2)
    assert stand.codes == ["arm-lost", "arm-lost-power-off"]
    assert not stand.record.power_wanted[0]


def test_an_arm_that_never_came_is_waited_for_from_the_enable() -> None:
    stand = Stand()
    stand.arms_alive = False
    stand.run_s(4.0)
    stand.control()
    stand.run_s(2.0)
    assert stand.codes == []
    assert stand.record.holding[0]
    stand.run_s(1.5)
    assert stand.codes == ["arm-lost"]


def test_a_tracking_error_stops_the_controller_not_the_power() -> None:
    stand = Stand()
    stand.control()
    stand.ask("tracking_check", 1)
    stand.send(1, position=0.2)
    stand.run(2)
    assert stand.codes == []
    stand.arms[0].position[4] = 0.21
    stand.run(1)
    event = next(e for e in stand.core.reports.events if e.kind == "error")
    assert (event.code, event.axis, event.limit) == ("tracking", 4, 0.2)
    assert event.value == pytest.approx(0.21)
    assert not stand.record.pid_enabled[0]
    assert stand.record.power_wanted[0]
    assert (stand.currents == 0x8000).all()
    assert (stand.dac() & 0xFFFF == 0x8000).all()


def test_velocity_feed_needs_leave() -> None:
    stand = Stand(pids=())
    assert stand.ask("use_setpoint_v", 1).outcome == "done"
    axes = tuple(gains(p_gain=0.0, d_gain=1.0) for _ in range(7))
    pids = (type(Stand().io.pids[0])("PSM1", "PSM1", axes),)
    stand = Stand(pids=pids)
    stand.control()
    stand.send(1, velocity=0.5)
    stand.arms[0].has_velocity[...] = True
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.0)
    stand.ask("use_setpoint_v", 1)
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.5)
    stand.arms[0].has_velocity[...] = False
    stand.run(1)
    np.testing.assert_allclose(stand.record.setpoint_effort, 0.0)


def test_the_controller_needs_power_and_bias() -> None:
    stand = Stand(preset=False)
    assert stand.ask("pid_enable", 1).answers == [("refused", "it is not powered")]
    stand.power()
    assert stand.ask("pid_enable", 1).answers == [("refused", "its encoders are not biased")]
    assert stand.ask("pid_enable", 2).outcome == "refused"
    assert stand.ask("pid_enable").outcome == "refused"


def test_servo_zero_stops_the_controller() -> None:
    stand = Stand()
    stand.control()
    stand.send(1, position=0.1)
    stand.run(2)
    assert stand.ask("servo_zero").outcome == "done"
    assert (stand.currents == 0x8000).all()
    assert stand.record.powered[0]


def test_robots_do_not_disturb_each_other() -> None:
    stand = Stand(2)
    stand.control("PSM1")
    stand.control("PSM2")
    stand.ask("tracking_check", 1, robot="PSM2")
    stand.send(1, arm=0, position=0.1)
    stand.send(1, arm=1, position=0.3)
    stand.run(1)
    assert stand.record.pid_enabled.tolist() == [True, False]
    np.testing.assert_allclose(stand.record.setpoint_effort, [0.1] * 7 + [0.0] * 7)


bad = st.sampled_from([np.nan, np.inf, -np.inf])
ROWS = ("position", "velocity", "effort", "feed_forward")


LOOKED_AT = [(False, "position"), (False, "velocity"), (False, "feed_forward"),
             (True, "effort"), (True, "feed_forward")]


@given(bad, st.sampled_from(LOOKED_AT), st.integers(0, 6))
@settings(max_examples=60, deadline=None)
def test_what_is_not_a_number_never_reaches_the_motors(value: float, field: tuple[bool, str], axis: int) -> None:
    in_effort, row = field
    stand = Stand()
    stand.control()
    stand.ask("use_setpoint_v", 1)
    stand.arms[0].has_velocity[...] = True
    stand.send(1, in_effort=in_effort, position=0.1)
    stand.run(1)
    getattr(stand.arms[0], row)[axis] = value
    stand.run(1)
    assert stand.codes == ["not-finite"]
    assert not stand.record.pid_enabled[0]
    assert (stand.currents == 0x8000).all()
    for name in ("setpoint_position", "setpoint_velocity", "setpoint_effort", "current_request"):
        assert np.isfinite(getattr(stand.record, name)).all()
    getattr(stand.arms[0], row)[axis] = 0.1
    stand.ask("clear_fault")
    assert stand.ask("pid_enable", 1).outcome == "done"
    stand.run(2)
    assert stand.record.pid_enabled[0]


@given(st.lists(st.floats(-1e300, 1e300), min_size=7, max_size=7), st.booleans())
@settings(max_examples=60, deadline=None)
def test_currents_stay_within_the_motors_limits(values: list[float], in_effort: bool) -> None:
    stand = Stand()
    stand.control()
    for row in ROWS:
        getattr(stand.arms[0], row)[:7] = values
    stand.send(1, in_effort=in_effort)
    stand.run(2)
    assert (np.abs(stand.record.current_request) <= 1.0).all()
    assert ((stand.currents >= 32768 - 5243) & (stand.currents <= 32768 + 5243)).all()
