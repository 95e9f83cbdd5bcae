"""Names of joints, in any order and under any of their names, say which number is for which joint."""

from __future__ import annotations

import itertools

import pytest

from tests.cases import cases
from trocar.procs.crtk.joint_order import WrongNames, in_order, order_of

PSM = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")
DVRK_MODEL = ("outer_yaw", "outer_pitch", "outer_insertion", "outer_roll", "outer_wrist_pitch", "outer_wrist_yaw")
MTM = ("outer_yaw", "shoulder_pitch", "elbow_pitch", "wrist_platform", "wrist_pitch", "wrist_yaw", "wrist_roll")
NUMBERS = ("0", "1", "2", "3", "4", "5")


@pytest.mark.parametrize("called", [PSM, DVRK_MODEL, NUMBERS, (*PSM[:3], *DVRK_MODEL[3:])])
def test_each_joint_gets_the_number_with_its_name(called: tuple[str, ...]) -> None:
    for order in itertools.permutations(range(6)):
        names = [called[place] for place in order]
        assert list(in_order([float(place) for place in order], names, PSM)) == [0, 1, 2, 3, 4, 5]


def test_names_in_order_and_no_names_change_nothing() -> None:
    numbers = [3.0, 1.0, 2.0, 6.0, 5.0, 4.0]
    for names in ((), PSM, DVRK_MODEL, NUMBERS):
        assert in_order(numbers, names, PSM) is numbers
    assert order_of((), ()) is None


def test_a_master_has_a_yaw_and_a_wrist_yaw() -> None:
    assert order_of(("yaw", *MTM[1:]), MTM) is None
    assert order_of(MTM[::-1], MTM) == (6, 5, 4, 3, 2, 1, 0)


def test_a_name_of_its_own_comes_before_a_synonym() -> None:
    assert order_of(("1", "0"), ("1", "0")) is None
    assert order_of(("outer_yaw", "yaw"), ("yaw", "outer_yaw")) == (1, 0)


@cases("names", [
    ("x", *PSM[1:]), ("yaw", "yaw", *PSM[2:]), ("yaw", "0", *PSM[2:]), PSM[:5], (*PSM, "roll"), ("",) * 6,
    ("Yaw", *PSM[1:]),
])
def test_names_that_do_not_fit_are_refused_with_those_of_the_arm(names: tuple[str, ...]) -> None:
    with pytest.raises(WrongNames) as refused:
        in_order([0.0] * len(names), names, PSM)
    assert all(name in str(refused.value) for name in PSM)


def test_as_many_numbers_as_names() -> None:
    with pytest.raises(WrongNames, match="6 names and 5 numbers"):
        in_order([0.0] * 5, PSM, PSM)


def test_before_an_arm_is_up_no_name_is_known() -> None:
    with pytest.raises(WrongNames, match="not known"):
        in_order([0.0], ["yaw"], ())
