"""Base frames from setup joints: taken while fresh, unknown otherwise, never an old one for a new one."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.procs.arm.setup_base import SetupBase, place_of
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.node.inputs import SETUP_LATE_S, Input
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import SUJ_STATE

MS = 1_000_000
POSE = np.array((0.1, -0.2, 0.3, 0.5, 0.5, 0.5, 0.5))


class FakeCartRing:
    """A record of two setup arms that is written by the test."""

    epoch = 1

    def __init__(self) -> None:
        self.record = np.zeros(1, dtype=schema_of(SUJ_STATE, {"setups": 2}).dtype)
        self.stamp_ns, self.whole = 0, True

    def field(self, name):
        return self.record[name].reshape(self.record[name].shape[1:])

    def newest(self) -> bool:
        return self.whole and self.stamp_ns > 0

    def write(self, now_ns: int, pose=POSE, frame: bytes = b"ECM", valid: bool = True) -> None:
        self.stamp_ns = now_ns
        self.field("measured_cp")[1], self.field("reference_frame")[1], self.field("base_valid")[1] = pose, frame, valid


@pytest.fixture
def ring() -> FakeCartRing:
    return FakeCartRing()


@pytest.fixture
def setup(ring: FakeCartRing) -> SetupBase:
    return SetupBase(Input(ring, SETUP_LATE_S), 1)


def test_base_is_unknown_before_anything_was_written(setup: SetupBase) -> None:
    assert setup.update(5 * MS) is False
    assert setup.base is None and setup.frame == ""


def test_a_fresh_pose_is_taken_with_its_frame(ring: FakeCartRing, setup: SetupBase) -> None:
    ring.write(10 * MS)
    assert setup.update(11 * MS) is True
    assert np.array_equal(setup.base, matrix_from_pose(POSE)) and setup.frame == "ECM"
    assert setup.update(12 * MS) is False, "nothing new"
    ring.write(13 * MS, frame=b"Cart")
    assert setup.update(13 * MS) is True and setup.frame == "Cart"
    ring.write(14 * MS, pose=POSE + (0.01, 0, 0, 0, 0, 0, 0))
    assert setup.update(14 * MS) is True and setup.base[0, 3] == pytest.approx(0.11)


def test_the_base_is_unknown_as_soon_as_it_is_said_or_old(ring: FakeCartRing, setup: SetupBase) -> None:
    ring.write(10 * MS)
    setup.update(10 * MS)
    ring.write(20 * MS, valid=False)
    assert setup.update(20 * MS) is True and setup.base is None
    ring.write(30 * MS)
    assert setup.update(30 * MS + 50 * MS) is True and setup.base is not None
    assert setup.update(31 * MS + 50 * MS) is True and setup.base is None and setup.frame == ""
    assert setup.update(32 * MS + 50 * MS) is False
    ring.write(100 * MS)
    assert setup.update(101 * MS) is True and setup.base is not None, "back with the same pose"


def test_a_torn_record_keeps_the_last_one_until_it_is_old(ring: FakeCartRing, setup: SetupBase) -> None:
    ring.write(10 * MS)
    setup.update(10 * MS)
    ring.whole = False
    ring.field("base_valid")[1] = False
    assert setup.update(20 * MS) is False and setup.base is not None
    assert setup.update(70 * MS) is True and setup.base is None


@pytest.mark.parametrize("pose", [np.full(7, np.nan), np.zeros(7), POSE * (1, 1, 1, 2, 2, 2, 2),
                                  POSE + (np.inf, 0, 0, 0, 0, 0, 0)])
def test_what_is_no_pose_is_not_taken(ring: FakeCartRing, setup: SetupBase, pose: np.ndarray) -> None:
    ring.write(10 * MS)
    setup.update(10 * MS)
    ring.write(20 * MS, pose=pose)
    assert setup.update(20 * MS) is True and setup.base is None


def test_a_stamp_from_the_future_does_not_count(ring: FakeCartRing, setup: SetupBase) -> None:
    ring.write(200 * MS)
    assert setup.update(10 * MS) is False and setup.base is None


def test_the_place_in_the_record_is_found_by_name() -> None:
    info = {"setups": {"ECM": {}, "PSM1": {}}}
    assert place_of(info, "PSM1") == 1
    with pytest.raises(ValueError, match="no setup arm PSM4; there are ECM, PSM1"):
        place_of(info, "PSM4")
