"""Readings, setpoints, loads and near poses of an arm by native code and by numpy: the same, whatever is in memory."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.arm.arm_configs import TOOL, fixed_arm
from tests.examples import examples
from trocar.procs.arm.effort_limits import EffortLimits
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.arm.motion import Motion
from trocar.procs.arm.near import Near
from trocar.procs.arm.readings import ROWS, ArmReadings
from trocar.procs.arm.record import SetpointRecord
from trocar.procs.kinematics.poses import pose_from_matrix, rotation_from_vector
from trocar.procs.native.arm_fields import CHANGED, FAULTY, FRESH, POWER, VALID
from trocar.procs.native.library import address_of, native
from trocar.procs.node.inputs import LATE_NS

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

SAME = 1e-12
NOW_NS = 10**12
AXES, ROBOTS = 12, 2
MOTORS = (3.3, 3.3, 9.9, 0.34, 0.34, 0.34, 0.34)
seeds = st.integers(0, 2**32 - 1)


def space() -> JointSpace:
    return joints(fixed_arm(), TOOL)


class IoFields:
    """The fields of io's record that readings look at: each row of axes beside the other."""

    def __init__(self) -> None:
        self.rows = np.zeros((6, AXES))
        self.flags: dict[str, Any] = {}

    def __call__(self, name: str) -> Any:
        if name in ROWS:
            return self.rows[ROWS.index(name)]
        dtype = {"fault": np.uint16, "sample_age_ns": np.int64, "input": np.bool_}.get(name, np.bool_)
        return self.flags.setdefault(name, np.zeros(AXES, dtype))


@given(seeds)
@examples(60)
def test_readings_are_the_same_both_ways(seed: int) -> None:
    rng, fields = np.random.default_rng(seed), IoFields()
    made = ArmReadings(fields, 1, 3, space())
    assert address_of(made._update)
    for _ in range(6):
        if rng.random() < 0.7:
            fields.rows[...] = rng.normal(size=fields.rows.shape)
        for name in ("powered", "amps_on", "biased"):
            fields(name)[...] = rng.random() < 0.8
        fields("fault")[...] = rng.choice((0, 0, 7))
        fields("sample_age_ns")[...] = rng.choice((0, LATE_NS, LATE_NS + 1, -1))
        stamp_ns = int(rng.choice((0, NOW_NS, NOW_NS - LATE_NS, NOW_NS - LATE_NS - 1, NOW_NS + LATE_NS + 1)))
        read = made.read.copy()
        found = made._update(NOW_NS, stamp_ns)
        rows, after = made.rows.copy(), made.read.copy()
        made.read[...] = read
        assert made.by_numpy_update(NOW_NS, stamp_ns) == found
        np.testing.assert_allclose(rows, made.rows, atol=SAME, rtol=0)
        assert after.tobytes() == made.read.tobytes()


def test_readings_say_what_is_the_case() -> None:
    fields = IoFields()
    made = ArmReadings(fields, 0, 0, space())
    for name in ("powered", "amps_on", "biased"):
        fields(name)[...] = True
    fields.rows[...] = 0.1
    for update in (made._update, made.by_numpy_update):
        made.read[...] = 0.0
        assert update(NOW_NS, NOW_NS) == FRESH | POWER | VALID | CHANGED
        assert update(NOW_NS, NOW_NS) == FRESH | POWER | VALID
        assert update(NOW_NS, 0) == POWER
        fields("fault")[...] = 3
        assert update(NOW_NS, NOW_NS) & FAULTY
        fields("fault")[...] = 0


@given(seeds)
@examples(60)
def test_setpoints_are_the_same_both_ways(seed: int) -> None:
    rng, made = np.random.default_rng(seed), space()
    motion = Motion(made)
    fields: dict[str, Any] = {name: np.zeros(8, np.bool_) if name == "in_effort" else np.zeros(8)
                              for name in ("position", "velocity", "effort", "feed_forward", "in_effort")}
    record = SetpointRecord(lambda name: fields.setdefault(name, np.zeros(())), made.axes)
    gravity, measured = rng.normal(size=(2, made.size))
    record.use(made, motion, gravity, measured)
    assert address_of(record._show)
    outputs = record.position, record.velocity, record.effort, record.feed_forward, record.in_effort
    for in_effort in (False, True):
        for array in (motion.rows, motion.effort, motion.feed):
            array[...] = rng.normal(size=array.shape)
        motion.in_effort[...] = rng.random(made.size) < 0.6
        before = motion.rows.copy()
        record._show(in_effort)
        found, goal = [output.copy() for output in outputs], motion.rows.copy()
        motion.rows[...] = before
        record.by_numpy_show(in_effort)
        for quick, output in zip(found, outputs, strict=True):
            np.testing.assert_allclose(quick, output, atol=SAME, rtol=0)
        assert np.array_equal(goal, motion.rows)


@given(seeds, st.sampled_from((0.0, 0.1, 3.0, 1e9, np.nan, np.inf)))
@examples(60)
def test_loads_are_the_same_both_ways(seed: int, scale: float) -> None:
    rng, limits = np.random.default_rng(seed), EffortLimits(MOTORS, space())
    assert address_of(limits._bear)
    limits.wanted[...] = rng.normal(size=limits.size) * scale
    found, load = limits._bear(), limits._load.copy()
    with np.errstate(all="ignore"):
        assert found == limits.by_numpy_bear()
    np.testing.assert_allclose(load, limits._load, rtol=SAME)


@given(seeds, st.sampled_from((0.0, 1e-3, 0.05, 2.0)), st.sampled_from((1.0, 1.05, 1.2, 0.0, np.nan)), st.booleans())
@examples(60)
def test_joints_of_near_poses_are_the_same_both_ways(seed: int, away: float, length: float, is_local: bool) -> None:
    rng, made = np.random.default_rng(seed), space()
    assert made.inverse is not None and made.kinematics is not None
    n = made.count
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = rotation_from_vector(rng.normal(size=3)), rng.normal(size=3)
    at = made.lower[:n] + (made.upper - made.lower)[:n] * rng.uniform(0.2, 0.8, n)
    near = Near(made.inverse, SimpleNamespace(to_base=np.linalg.inv(base)), at)  # type: ignore[arg-type]
    assert address_of(near._find)
    local = made.kinematics.fk(at + away * rng.uniform(-1.0, 1.0, n), np.eye(4))
    pose = pose_from_matrix(local if is_local else base @ local)
    pose[3:] *= length
    found, joints_found = near.find(pose, is_local), near.joints.copy()
    assert bool(near.by_numpy_find(is_local)) is found
    assert found is False or length in (1.0, 1.05)
    assert found or away > 1e-3 or length not in (1.0, 1.05)
    if found:
        np.testing.assert_allclose(joints_found, near.joints, atol=SAME, rtol=0)
        shown = pose_from_matrix(made.kinematics.fk(joints_found, np.eye(4)))
        np.testing.assert_allclose(shown, pose_from_matrix(local), atol=1e-7)


def test_near_poses_stop_at_limits_and_far_turns() -> None:
    made = space()
    assert made.inverse is not None and made.kinematics is not None
    at = 0.5 * (made.lower + made.upper)[: made.count]
    at[2] = 0.12
    near = Near(made.inverse, SimpleNamespace(to_base=np.eye(4)), at)  # type: ignore[arg-type]
    pose = pose_from_matrix(made.kinematics.fk(at, np.eye(4)))
    for find in (near._find, near.by_numpy_find):
        near.pose[...] = pose
        assert find(1) == 1
        near.pose[2] += 1.0
        assert find(1) == 0
