"""What a master's motors are asked for when nobody asks for positions: wrenches, platform, weight, impedance."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests import stock
from tests.arm.fake_master import MasterHarness, actuator_of, master
from tests.kinematics.test_gravity import parameters
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import matrix_from_pose

BENT = (0.1, 0.2, 0.3, -0.4, 0.5, -0.6, 0.7)
WEIGHT = (-0.04732, 0.5073, 0.21282, 0.05798, 0.04149, -0.03281, 0.0)  # at BENT, of MTML 22723
QUARTER = (0.1, 0.2, 0.3, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
TO_JOINT = np.linalg.inv(np.array([actuator_of(row) for row in np.eye(7)]).T)


@pytest.fixture
def harness() -> MasterHarness:
    """Homed and free, bent by a hand; no platform, no weight."""
    return bent(master(platform_gain=0.0))


def bent(arm, *joints: float) -> MasterHarness:
    made = MasterHarness(dataclasses.replace(arm, effort_zone_ratio=0.0)).homed()  # BENT is where the wall pushes
    made.send("free")
    made.put(*(joints or BENT))
    made.reports.events.clear()
    return made


def joint_effort(harness: MasterHarness) -> np.ndarray:
    """What io is asked for, as joint efforts: power is the same on both sides."""
    assert harness.setpoint["in_effort"][:7].all()
    return np.linalg.solve(TO_JOINT.T, harness.setpoint["effort"][:7])


def body() -> np.ndarray:
    return Kinematics(stock.chain("MTML")).body_jacobian(np.array(BENT)).copy()


def test_a_body_wrench_is_the_transposed_jacobian_times_it(harness: MasterHarness) -> None:
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    assert harness.state["control_mode"] == 3 and harness.state["control_space"] == 2
    assert joint_effort(harness) == pytest.approx(body().T @ (0, 0, 1, 0, 0, 0), abs=1e-9)


def test_an_absolute_wrench_is_in_axes_of_the_reference_frame(harness: MasterHarness) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    harness.send("body/set_cf_orientation_absolute", (1,))
    harness.step()
    harness.send("body/servo_cf", (0, 0, 1, 0.05, 0, 0))
    rotation = matrix_from_pose(harness.state["measured_cp"])[:3, :3]
    turned = np.concatenate((rotation.T @ (0, 0, 1), rotation.T @ (0.05, 0, 0)))
    assert joint_effort(harness) == pytest.approx(body().T @ turned, abs=1e-9)


def test_a_spatial_wrench_goes_through_the_spatial_jacobian(harness: MasterHarness) -> None:
    harness.send("spatial/servo_cf", (0.1, 0, 0, 0, 0, 0.01))
    spatial = Kinematics(stock.chain("MTML")).spatial_jacobian(np.array(BENT))
    assert joint_effort(harness) == pytest.approx(spatial.T @ (0.1, 0, 0, 0, 0, 0.01), abs=1e-9)


def test_joint_efforts_go_through_the_coupling(harness: MasterHarness) -> None:
    wanted = (0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.007)
    harness.send("servo_jf", wanted)
    assert joint_effort(harness) == pytest.approx(wanted, abs=1e-12)
    assert harness.setpoint["effort"][3] == pytest.approx(0.04) and harness.setpoint["effort"][1] == pytest.approx(
        0.2 - 0.3 + 0.6697 * 0.04)


@pytest.mark.parametrize(("pitch", "yaw", "platform", "velocity", "effort"), (
    (0.0, 0.1, 0.0, 0.0, 0.5 * 0.1),
    (0.5, 0.1, 0.0, 0.0, 0.5 * 0.1 * math.cos(0.5)),
    (0.0, -0.5, 0.0, 0.0, -0.5 * 0.05 * math.pi),  # no further than that
    (0.0, 0.1, 0.0, 0.3, 0.5 * (0.1 - 0.1 * 0.3)),
    (0.0, 0.5, 1.6, 0.0, 0.5 * 0.0580),  # no further than its limit
    (0.0, 0.1, 0.0, -10.0, 0.30901),  # no more than the motor gives
    (0.0, 0.1, 0.0, 10.0, -0.30901),
))
def test_the_platform_goes_where_the_yaw_points(pitch, yaw, platform, velocity, effort) -> None:
    harness = bent(master(effort_speed_ratio=0.0), 0.1, 0.2, 0.3, platform, pitch, yaw, 0.0)
    harness.io.record["velocity"][2 + 3] = velocity
    harness.send("body/servo_cf", (0,) * 6)
    assert joint_effort(harness) == pytest.approx((0, 0, 0, effort, 0, 0, 0), abs=1e-4)
    harness.step()
    assert joint_effort(harness)[3] == pytest.approx(effort, abs=1e-4), "each cycle anew"
    harness.send("spatial/servo_cf", (0,) * 6)
    assert joint_effort(harness) == pytest.approx(np.zeros(7), abs=1e-12), "for wrenches of the body only"


def test_the_platform_comes_on_top_of_the_wrench() -> None:
    harness = bent(master(platform_gain=1.0))
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    platform = -min(0.6 * math.cos(0.5), 0.05 * math.pi)
    assert joint_effort(harness) - body().T @ (0, 0, 1, 0, 0, 0) == pytest.approx((0, 0, 0, platform, 0, 0, 0),
                                                                                  abs=1e-6)


def gains(p: tuple[float, ...], deadband: tuple[float, ...]) -> list[float]:
    """The same for errors of both signs, x y z only."""
    side = np.zeros((4, 6))
    side[0, :3], side[3, :3] = p, deadband
    return [*side.ravel(), *side.ravel()]


def test_an_impedance_pulls_back_in_the_axes_it_names(harness: MasterHarness) -> None:
    tip = harness.state["measured_cp"].copy()
    place = tip[:3] + (0.03, -0.02, 0.0)  # the tip is 3 cm before it along x, 2 cm beyond along y
    harness.send("servo_ci", [*place, 0, 0, 0, 1, *tip[3:], *gains((-100.0, -50.0, 0.0), (0.0, 0.01, 0.0))])
    rotation = matrix_from_pose(tip)[:3, :3]
    wrench = np.concatenate((rotation.T @ (3.0, -0.5, 0.0), np.zeros(3)))
    assert joint_effort(harness) == pytest.approx(body().T @ wrench, abs=1e-6)


def with_weight() -> MasterHarness:
    harness = bent(master(platform_gain=0.0, master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    harness.step()
    return harness


def borne(harness: MasterHarness) -> np.ndarray:
    return np.linalg.solve(TO_JOINT.T, harness.setpoint["feed_forward"][:7])


def test_weight_is_borne_in_effort_mode_as_measured() -> None:
    harness = with_weight()
    assert borne(harness) == pytest.approx(WEIGHT, abs=1e-5)
    assert harness.state["gravity_effort"][:7] == pytest.approx(WEIGHT, abs=1e-5)
    harness.send("use_gravity_compensation", (0,))
    shares = []
    for _ in range(120):
        harness.step()
        shares.append(borne(harness)[1] / WEIGHT[1])
    assert max(np.abs(np.diff([1.0, *shares]))) < 0.03 and shares[-1] == 0.0, "it does not drop"
    harness.send("use_gravity_compensation", (1,))
    assert borne(harness) == pytest.approx(WEIGHT, abs=1e-5)


def test_weight_is_let_go_of_slowly_where_servo_positions_are_followed() -> None:
    harness = with_weight()
    harness.send("hold")
    shares = []
    for _ in range(120):
        harness.step()
        shares.append(borne(harness)[1] / WEIGHT[1])
    assert max(np.abs(np.diff([1.0, *shares]))) < 0.03 and shares[-1] == 0.0
    harness.send("move_jp", BENT)
    harness.run(0.5)
    assert 0.4 < borne(harness)[1] / WEIGHT[1] < 0.6
    harness.run(0.6)
    assert borne(harness) == pytest.approx(WEIGHT, abs=1e-5)


def test_effort_mode_bears_all_the_weight_at_once() -> None:
    harness = with_weight()
    harness.send("hold")
    harness.run(1.1)
    harness.send("free")
    assert borne(harness) == pytest.approx(WEIGHT, abs=1e-5)


def test_homed_arms_bear_their_weight_from_the_search_on() -> None:
    harness = MasterHarness(master(master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    harness.reach("CALIBRATING_ROLL")
    harness.run(0.03)
    assert np.abs(borne(harness)).max() < 0.05
    harness.reports.events.clear()
    harness.until(lambda: harness.arm.state == "HOMED")
    before = borne(harness)
    harness.run(0.5)
    assert borne(harness) == pytest.approx(before, abs=1e-3) and np.abs(before).max() > 0.1


def test_a_wrench_may_end_by_itself(harness: MasterHarness) -> None:
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 0.03))
    harness.run(0.02)
    assert joint_effort(harness) == pytest.approx(body().T @ (0, 0, 1, 0, 0, 0), abs=1e-9)
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 0.03))
    harness.run(0.02)
    assert np.abs(joint_effort(harness)).max() > 0.01
    harness.run(0.02)
    assert not joint_effort(harness).any()
    assert harness.state["control_mode"] == 3
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    harness.run(0.05)
    assert joint_effort(harness).any()


@pytest.mark.parametrize("lasting", [0.0, -1.0, 4000.0])
def test_a_wrench_lasts_a_time_that_makes_sense(harness: MasterHarness, lasting: float) -> None:
    answer = harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0, lasting))
    assert answer.outcomes == ["refused"] and "it may last up to" in answer.replies[0][1]
