"""Efforts that nobody can give: clipped, and said so; a wrench keeps its direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import CHAIN, TOOL, fixed_arm
from tests.arm.fake_io import ArmHarness
from trocar.procs.arm.effort_limits import EffortLimits, motor_efforts
from trocar.procs.arm.joints import joints
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.kinematics.forward import Kinematics

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
MOTORS = (3.3, 3.3, 9.9, 0.34, 0.34, 0.34, 0.34)


@pytest.fixture
def harness() -> ArmHarness:
    """Homed and deep enough; every joint of the fake arm is rated at 1, its jaw at 0.16."""
    made = ArmHarness(fixed_arm(effort_timeout_s=0.0)).homed()
    made.go(DEEP)
    made.reports.events.clear()
    return made


def asked(harness: ArmHarness) -> np.ndarray:
    """The joint efforts (7,) that io is asked for."""
    assert harness.setpoint["in_effort"][:7].all()
    return np.linalg.solve(harness.arm.joints.to_joint.T, harness.setpoint["effort"][:7])


def warnings(harness: ArmHarness, code: str) -> list[Any]:
    return [event for event in harness.reports.of("warning") if event[1] == code]


def test_what_a_motor_gives_is_its_current_by_its_constant() -> None:
    system = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml").system
    assert system is not None
    efforts = motor_efforts(system.ios[0].robots[0])
    assert efforts[:3] == pytest.approx((1.34 / 0.40408938, 1.34 / 0.40408938, 0.67 / 0.067828432))
    kinematic = load_system(PROJECT_CONFIGS / "systems" / "kinematic.yaml").system
    assert kinematic is not None and motor_efforts(kinematic.ios[0].robots[0]) == ()


def test_a_joint_is_clipped_by_itself_unless_it_shares_motors() -> None:
    limits = EffortLimits(MOTORS, joints(fixed_arm(), TOOL))
    efforts = np.array((1e6, 0.5, -1e6, 0.01, 0.02, 0.03, 0.0))
    assert np.flatnonzero(limits.clip(efforts, together=False)).tolist() == [0, 2]
    assert efforts == pytest.approx((1.0, 0.5, -1.0, 0.01, 0.02, 0.03, 0.0))
    wrist = np.array((0.1, 0.0, 0.0, 0.0, 1.0, 0.9, 0.0))  # more than the motors of the two give together
    assert np.flatnonzero(limits.clip(wrist, together=False)).tolist() == [5]
    assert wrist[0] == 0.1 and wrist[4] / wrist[5] == pytest.approx(1.0 / 0.9)
    assert (np.abs(wrist @ joints(fixed_arm(), TOOL).to_joint) <= np.array(MOTORS) + 1e-9).all()


def test_joints_that_share_motors_stay_within_them_whatever_they_are_asked_for() -> None:
    space = joints(fixed_arm(), TOOL)
    limits, random = EffortLimits(MOTORS, space), np.random.default_rng(2)
    for _ in range(500):
        for together in (False, True):
            efforts = random.normal(size=7) * 10.0 ** random.uniform(-2, 8)
            wanted = efforts.copy()
            outside = limits.clip(efforts, together=together)
            assert (np.abs(efforts) <= space.rated + 1e-9).all()
            assert (np.abs(efforts @ space.to_joint) <= np.array(MOTORS) + 1e-9).all()
            assert (efforts * wanted >= 0.0).all()
            assert outside.any() == (not np.allclose(efforts, wanted, rtol=1e-12))


def test_efforts_that_can_be_given_are_left_alone() -> None:
    limits = EffortLimits(MOTORS, joints(fixed_arm(), TOOL))
    efforts = np.array((0.9, -0.9, 0.9, 0.1, 0.1, -0.1, 0.1))
    assert not limits.clip(efforts, together=False).any() and efforts[0] == 0.9
    wrist_pitch = 0.34 / 1.0186 * (1.0 + 0.8306 / 0.6089)  # by the three motors that bend the wrist
    assert limits.most == pytest.approx((1.0, 1.0, 1.0, 0.34 / 1.5632, wrist_pitch, 0.34 / 0.6089, 0.16))


def test_a_joint_effort_beyond_the_motors_is_clipped_and_told_once_an_episode(harness: ArmHarness) -> None:
    for _ in range(100):
        assert harness.send("servo_jf", (1e6, 0, 0, 0, 0, 0)).replies == [("done", "clipped: yaw")]
        assert asked(harness) == pytest.approx((1.0, 0, 0, 0, 0, 0, 0))
    harness.run(1.0)
    assert asked(harness)[0] == pytest.approx(1.0), "and stays so"
    assert len(warnings(harness, "effort-clipped")) == 1 and "yaw" in warnings(harness, "effort-clipped")[0][2]
    assert harness.send("servo_jf", (0.5, 0, 0, 0, 0, 0)).replies == [("done", "")]
    harness.run(1.0)
    harness.send("servo_jf", (0, 0, -3.0, 0, 0, 0))
    assert len(warnings(harness, "effort-clipped")) == 2 and asked(harness)[2] == pytest.approx(-1.0)


def test_a_jaw_effort_is_clipped_as_well(harness: ArmHarness) -> None:
    assert harness.send("jaw/servo_jf", (-1e6,)).replies == [("done", "clipped: jaw")]
    harness.run(0.5)
    assert asked(harness)[6] == pytest.approx(-0.16)


@pytest.mark.parametrize("name", ("body/servo_cf", "spatial/servo_cf"))
def test_a_wrench_too_strong_keeps_its_direction(harness: ArmHarness, name: str) -> None:
    answer = harness.send(name, (20.0, -40.0, 60.0, 0.0, 0.0, 0.0))
    assert answer.outcomes == ["done"] and answer.replies[0][1].startswith("clipped: ")
    harness.run(0.1)
    kinematics = Kinematics(CHAIN, TOOL)
    jacobian = (kinematics.body_jacobian if name.startswith("body") else kinematics.spatial_jacobian)(np.array(DEEP))
    wanted = jacobian.T @ (20.0, -40.0, 60.0, 0.0, 0.0, 0.0)
    assert np.abs(wanted).max() > 5.0
    given = asked(harness)[:6]
    assert np.abs(given).max() == pytest.approx(1.0)
    assert given == pytest.approx(wanted / np.abs(wanted).max(), abs=1e-9)
    assert len(warnings(harness, "effort-clipped")) == 1


@pytest.mark.parametrize(("name", "values"), (
    ("body/servo_cf", (1e6, 0, 0, 0, 0, 0)),
    ("servo_cf", (0, 0, 1001.0, 0, 0, 0)),
    ("spatial/servo_cf", (0, 0, 0, 0, -101.0, 0)),
    ("servo_cs", (*(0.0,) * 6, 1.0, *(0.0,) * 6, 1e6, *(0.0,) * 5, 0.0, 0.0, 1.0)),
))
def test_a_wrench_out_of_the_question_is_refused(harness: ArmHarness, name: str, values: tuple[float, ...]) -> None:
    answer = harness.send(name, values)
    assert answer.outcomes == ["refused"] and "allowed: 1000 N and 100 N·m" in answer.replies[0][1]
    assert harness.state["control_mode"] != 3


def test_an_impedance_too_stiff_is_clipped_each_cycle(harness: ArmHarness) -> None:
    tip = np.array(harness.state["measured_cp"])
    side = np.zeros((4, 6))
    side[0, :3] = -1e5
    place = tip[:3] - (0.0, 0.0, 0.01)
    answer = harness.send("servo_ci", [*place, 0, 0, 0, 1, *tip[3:], *side.ravel(), *side.ravel()])
    assert answer.replies[0][1] == "clipped: insertion"
    harness.run(0.1)
    assert np.abs(asked(harness)).max() == pytest.approx(1.0) and asked(harness)[2] == pytest.approx(1.0)


def test_a_wrench_beside_a_pose_is_clipped_and_told(harness: ArmHarness) -> None:
    pose = tuple(harness.state["setpoint_cp"])
    answer = harness.send("servo_cs", (*pose, *(0.0,) * 6, 0.0, 0.0, -60.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    assert answer.replies == [("done", "clipped: insertion")]
    assert harness.setpoint["feed_forward"][2] == pytest.approx(1.0) and harness.state["control_mode"] == 1


def test_efforts_of_joints_take_the_place_of_a_wrench() -> None:
    harness = ArmHarness(fixed_arm()).homed()
    harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    harness.step()
    harness.send("servo_jf", (0.2, 0.0, 0.0, 0.0, 0.0, 0.0))
    harness.step()
    efforts = harness.arm.control.motion.effort
    assert efforts[:6] == pytest.approx((0.2, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_where_nothing_is_clipped_no_joint_is_marked(harness: ArmHarness) -> None:
    harness.send("servo_jf", (0.5, 0, 0, 0, 0, 0))
    assert harness.arm.control.efforts.clipped.tolist() == [False] * 7
    assert harness.arm.control.joints.clip(np.zeros(7)).tolist() == [False] * 7
