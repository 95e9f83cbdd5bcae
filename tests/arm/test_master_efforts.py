"""What a master's motors are asked for when nobody asks for positions: wrenches, platform, weight, impedance."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from procs.kinematics.forward import Kinematics
from procs.kinematics.poses import matrix_from_pose
from tests import stock
from tests.arm.fake_master import MasterRig, actuator_of, master
from tests.lib.test_gravity import parameters

BENT = (0.1, 0.2, 0.3, -0.4, 0.5, -0.6, 0.7)
WEIGHT = (-0.04732, 0.5073, 0.21282, 0.05798, 0.04149, -0.03281, 0.0)  # at BENT, of MTML 22723
QUARTER = (0.1, 0.2, 0.3, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
TO_JOINT = np.linalg.inv(np.array([actuator_of(row) for row in np.eye(7)]).T)


@pytest.fixture
def rig() -> MasterRig:
    """Homed and free, bent by a hand; no platform, no weight."""
    return bent(master(platform_gain=0.0))


def bent(arm, *joints: float) -> MasterRig:
    made = MasterRig(dataclasses.replace(arm, effort_zone_ratio=0.0)).homed()  # BENT is where the wall pushes
    made.send("free")
    made.put(*(joints or BENT))
    made.reports.events.clear()
    return made


def joint_effort(rig: MasterRig) -> np.ndarray:
    """What io is asked for, as joint efforts: power is the same on both sides."""
    assert rig.setpoint["in_effort"][:7].all()
    return np.linalg.solve(TO_JOINT.T, rig.setpoint["effort"][:7])


def body() -> np.ndarray:
    return Kinematics(stock.chain("MTML")).body_jacobian(np.array(BENT)).copy()


def test_a_body_wrench_is_the_transposed_jacobian_times_it(rig: MasterRig) -> None:
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    assert rig.state["control_mode"] == 3 and rig.state["control_space"] == 2
    assert joint_effort(rig) == pytest.approx(body().T @ (0, 0, 1, 0, 0, 0), abs=1e-9)


def test_an_absolute_wrench_is_in_axes_of_the_reference_frame(rig: MasterRig) -> None:
    rig.send("set_base_frame", QUARTER, "world")
    rig.send("body/set_cf_orientation_absolute", (1,))
    rig.step()
    rig.send("body/servo_cf", (0, 0, 1, 0.05, 0, 0))
    rotation = matrix_from_pose(rig.state["measured_cp"])[:3, :3]
    turned = np.concatenate((rotation.T @ (0, 0, 1), rotation.T @ (0.05, 0, 0)))
    assert joint_effort(rig) == pytest.approx(body().T @ turned, abs=1e-9)


def test_a_spatial_wrench_goes_through_the_spatial_jacobian(rig: MasterRig) -> None:
    rig.send("spatial/servo_cf", (0.1, 0, 0, 0, 0, 0.01))
    spatial = Kinematics(stock.chain("MTML")).spatial_jacobian(np.array(BENT))
    assert joint_effort(rig) == pytest.approx(spatial.T @ (0.1, 0, 0, 0, 0, 0.01), abs=1e-9)


def test_joint_efforts_go_through_the_coupling(rig: MasterRig) -> None:
    wanted = (0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.007)
    rig.send("servo_jf", wanted)
    assert joint_effort(rig) == pytest.approx(wanted, abs=1e-12)
    assert rig.setpoint["effort"][3] == pytest.approx(0.04) and rig.setpoint["effort"][1] == pytest.approx(
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
    rig = bent(master(effort_speed_ratio=0.0), 0.1, 0.2, 0.3, platform, pitch, yaw, 0.0)
    rig.io.record["velocity"][2 + 3] = velocity
    rig.send("body/servo_cf", (0,) * 6)
    assert joint_effort(rig) == pytest.approx((0, 0, 0, effort, 0, 0, 0), abs=1e-4)
    rig.step()
    assert joint_effort(rig)[3] == pytest.approx(effort, abs=1e-4), "each cycle anew"
    rig.send("spatial/servo_cf", (0,) * 6)
    assert joint_effort(rig) == pytest.approx(np.zeros(7), abs=1e-12), "for wrenches of the body only"


def test_the_platform_comes_on_top_of_the_wrench() -> None:
    rig = bent(master(platform_gain=1.0))
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    platform = -min(0.6 * math.cos(0.5), 0.05 * math.pi)
    assert joint_effort(rig) - body().T @ (0, 0, 1, 0, 0, 0) == pytest.approx((0, 0, 0, platform, 0, 0, 0), abs=1e-6)


def gains(p: tuple[float, ...], deadband: tuple[float, ...]) -> list[float]:
    """The same for errors of both signs, x y z only."""
    side = np.zeros((4, 6))
    side[0, :3], side[3, :3] = p, deadband
    return [*side.ravel(), *side.ravel()]


def test_an_impedance_pulls_back_in_the_axes_it_names(rig: MasterRig) -> None:
    tip = rig.state["measured_cp"].copy()
    place = tip[:3] + (0.03, -0.02, 0.0)  # the tip is 3 cm before it along x, 2 cm beyond along y
    rig.send("servo_ci", [*place, 0, 0, 0, 1, *tip[3:], *gains((-100.0, -50.0, 0.0), (0.0, 0.01, 0.0))])
    rotation = matrix_from_pose(tip)[:3, :3]
    wrench = np.concatenate((rotation.T @ (3.0, -0.5, 0.0), np.zeros(3)))
    assert joint_effort(rig) == pytest.approx(body().T @ wrench, abs=1e-6)


def with_weight() -> MasterRig:
    rig = bent(master(platform_gain=0.0, master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    rig.step()
    return rig


def borne(rig: MasterRig) -> np.ndarray:
    return np.linalg.solve(TO_JOINT.T, rig.setpoint["feed_forward"][:7])


def test_weight_is_borne_in_effort_mode_as_measured() -> None:
    rig = with_weight()
    assert borne(rig) == pytest.approx(WEIGHT, abs=1e-5)
    assert rig.state["gravity_effort"][:7] == pytest.approx(WEIGHT, abs=1e-5)
    rig.send("use_gravity_compensation", (0,))
    assert not borne(rig).any()


def test_weight_is_let_go_of_slowly_where_servo_positions_are_followed() -> None:
    rig = with_weight()
    rig.send("hold")
    shares = []
    for _ in range(120):
        rig.step()
        shares.append(borne(rig)[1] / WEIGHT[1])
    assert max(np.abs(np.diff([1.0, *shares]))) < 0.03 and shares[-1] == 0.0
    rig.send("move_jp", BENT)
    rig.run(0.5)
    assert 0.4 < borne(rig)[1] / WEIGHT[1] < 0.6
    rig.run(0.6)
    assert borne(rig) == pytest.approx(WEIGHT, abs=1e-5)


def test_effort_mode_bears_all_the_weight_at_once() -> None:
    rig = with_weight()
    rig.send("hold")
    rig.run(1.1)
    rig.send("free")
    assert borne(rig) == pytest.approx(WEIGHT, abs=1e-5)


def test_homed_arms_bear_their_weight_from_the_search_on() -> None:
    rig = MasterRig(master(master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    rig.reach("CALIBRATING_ROLL")
    rig.run(0.03)
    assert np.abs(borne(rig)).max() < 0.05
    rig.reports.events.clear()
    rig.until(lambda: rig.arm.state == "HOMED")
    before = borne(rig)
    rig.run(0.5)
    assert borne(rig) == pytest.approx(before, abs=1e-3) and np.abs(before).max() > 0.1


def test_a_wrench_may_end_by_itself(rig: MasterRig) -> None:
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 0.03))
    rig.run(0.02)
    assert joint_effort(rig) == pytest.approx(body().T @ (0, 0, 1, 0, 0, 0), abs=1e-9)
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 0.03))
    rig.run(0.02)
    assert np.abs(joint_effort(rig)).max() > 0.01
    rig.run(0.02)
    assert not joint_effort(rig).any()
    assert rig.state["control_mode"] == 3
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    rig.run(0.05)
    assert joint_effort(rig).any()


@pytest.mark.parametrize("lasting", [0.0, -1.0, 4000.0])
def test_a_wrench_lasts_a_time_that_makes_sense(rig: MasterRig, lasting: float) -> None:
    answer = rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0, lasting))
    assert answer.outcomes == ["refused"] and "it may last up to" in answer.replies[0][1]
