import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.io.harness import pid_step
from trocar.procs.document.system import PidAxis
from trocar.procs.io.pid import Pid

ALL = slice(None)
def axis(**changes) -> PidAxis:
    values = {"name": "a", "joint_type": "REVOLUTE", "p_gain": 0.0, "d_gain": 0.0, "i_gain": 0.0,
              "pid_max_output": -1.0} | changes
    return PidAxis(**values)


def enabled(*axes: PidAxis, limit: np.ndarray | None = None, dt: float = 1 / 1500) -> Pid:
    n = len(axes)
    pid = Pid(axes, np.zeros(n) if limit is None else limit, dt)
    pid.enable(ALL, True, np.zeros(n))
    return pid


def step(pid: Pid, setpoint: float, position: float = 0.0, velocity: float = 0.0) -> float:
    pid.setpoint_position[:] = setpoint
    pid_step(pid, np.array([position]), np.array([velocity]), np.zeros(1, dtype=bool))
    return float(pid.effort[0])


def test_velocity_feed_is_filtered() -> None:
    pid = enabled(axis(p_gain=6000, d_gain=200, v_low_pass_cutoff=0.5))
    pid.carry_velocity(ALL, True)
    pid.setpoint_velocity[:] = 0.02
    assert step(pid, 0.1, 0.0995, 0.01) == pytest.approx(3.0, abs=1e-12)
    assert pid.filtered[0] == 0.01  # so that nothing is damped


@pytest.mark.parametrize(
    ("error", "effort"), [(0.02, 0.5), (0.03, 2.0), (-0.025, -1.265625), (0.05, 4.0), (0.005, 0.0)])
def test_soft_dead_band_rises_smoothly(error: float, effort: float) -> None:
    pid = enabled(axis(p_gain=100, p_deadband=0.01, p_deadband_outer=0.03))
    assert step(pid, error) == pytest.approx(effort, abs=1e-12)


def test_integral_forgets_per_cycle() -> None:
    pid = enabled(axis(i_gain=1.0, i_forget_rate=0.5, i_limit=0.3))
    found = [step(pid, 0.1) for _ in range(6)]
    np.testing.assert_allclose(found, [0.1, 0.15, 0.175, 0.1875, 0.19375, 0.196875], atol=1e-12)


def observer() -> Pid:
    return enabled(axis(p_gain=600, d_gain=30, pid_max_output=10.0, use_disturbance_observer=True, nominal_mass=0.01,
                        disturbance_cutoff=50.0), dt=1 / 1500 - 60e-6)


def test_observer_follows_the_table() -> None:
    pid = observer()
    found = [step(pid, 0.01, 0.0, v) for v in (0.0, 0.1, 0.2, 0.3)]
    np.testing.assert_allclose(found, [6.0, 3.13351666666667, 0.17603333333333, -2.87245], atol=1e-12)


@pytest.mark.parametrize(
    ("tolerance", "dead_band", "error", "trips"),
    [(0.2, 0.0, 0.2, False), (0.2, 0.0, 0.2000001, True), (0.5, 0.015, 0.51, False), (0.5, 0.015, 0.516, True)])
def test_tracking_check_looks_behind_the_dead_band(
    tolerance: float, dead_band: float, error: float, trips: bool) -> None:
    pid = enabled(axis(tolerance=tolerance, p_deadband=dead_band))
    pid.setpoint_position[:] = error
    no_limit = np.zeros(1, dtype=bool)
    assert pid_step(pid, np.zeros(1), np.zeros(1), no_limit) is None
    pid.check_tracking(ALL, True)
    found = pid_step(pid, np.zeros(1), np.zeros(1), no_limit)
    assert (found is not None) is trips


def test_enabling_starts_without_memory() -> None:
    pid = enabled(axis(i_gain=1.0, i_limit=10.0))
    for _ in range(10):
        step(pid, 0.1)
    pid.enable(ALL, False, np.zeros(1))
    pid.enable(ALL, True, np.array([0.2]))
    assert pid.setpoint_position[0] == 0.2
    assert pid.integral[0] == 0.0
    pid_step(pid, np.array([0.2]), np.zeros(1), np.zeros(1, dtype=bool))
    assert pid.effort[0] == 0.0
    again = observer()
    step(again, 0.01)
    again.enable(ALL, True, np.zeros(1))
    assert step(again, 0.01) == pytest.approx(6.0, abs=1e-12)


anything = st.floats(allow_nan=True, allow_infinity=True)


@given(anything, anything, anything, anything, anything, st.booleans())
def test_effort_is_always_finite_and_limited(
    setpoint: float, position: float, velocity: float, feed: float, requested: float, effort_mode: bool) -> None:
    full = axis(p_gain=600, d_gain=30, i_gain=1.0, i_limit=1.0, p_deadband=0.01, p_deadband_outer=0.02, tolerance=0.1,
                use_disturbance_observer=True, nominal_mass=0.01, disturbance_cutoff=50.0)
    pid = enabled(full, limit=np.array([3.0]))
    pid.check_tracking(ALL, True)
    pid.carry_velocity(ALL, True)
    pid.use_effort(ALL, effort_mode)
    pid.requested_effort[:] = requested
    pid.feed_forward[:] = feed
    pid.setpoint_velocity[:] = velocity
    pid.setpoint_position[:] = setpoint
    with np.errstate(all="ignore"):
        tripped = pid_step(pid, np.array([position]), np.array([velocity]), np.zeros(1, dtype=bool))
        assert abs(pid.effort[0]) <= 3.0
        if not math.isfinite(position - setpoint) and not effort_mode:
            assert tripped is not None
        pid.setpoint_position[:] = pid.feed_forward[:] = pid.requested_effort[:] = pid.setpoint_velocity[:] = 0.0
        pid_step(pid, np.zeros(1), np.zeros(1), np.zeros(1, dtype=bool))
    assert abs(pid.effort[0]) <= 3.0


def test_a_contribution_cannot_leave_the_effort_limits() -> None:
    pid = enabled(axis(p_gain=1.0), limit=np.array([2.0]))
    pid.contribute()[:] = 0.5
    assert step(pid, 0.1) == pytest.approx(0.6, abs=1e-12)
    pid.contribution[:] = -9.0
    assert step(pid, 0.1) == -2.0
    pid.contribution[:] = np.inf
    assert step(pid, 0.1) == 2.0
    pid.contribution[:] = np.nan
    assert step(pid, 0.1) == 0.0
