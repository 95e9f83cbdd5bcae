"""Two masters that carry the camera: golden numbers of dVRK 2.4."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.procs.teleop.camera import Camera, outside

LEFT, RIGHT = np.array((0.15, -0.05, 0.40)), np.array((-0.15, -0.05, 0.40))
STRAIGHT = np.array((0.0, 0.0, 0.12, 0.0))
REST = np.zeros(3)


def begun(joints: object = STRAIGHT) -> Camera:
    camera = Camera(0.2, 0.0)
    camera.begin(LEFT, RIGHT, np.array(joints))
    return camera


@pytest.mark.parametrize(
    ("left", "right", "change"),
    [
        ((0.02, 0, 0), (0.02, 0, 0), (-0.049958, 0, -0.000099, 0)),
        ((0, 0.01, 0), (0, 0.01, 0), (0, -0.024686, 0.000224, 0)),
        ((0, 0, 0.05), (0, 0, 0.05), (0, -0.013698, -0.009931, 0)),
        ((0, 0.01, 0), (0, -0.01, 0), (0, 0, 0, -0.066568)),
        ((0.01, 0, 0), (-0.01, 0, 0), (0, 0, 0, 0)),
    ],
)
def test_the_camera_goes_against_the_hands(left: tuple[float, ...], right: tuple[float, ...],
                                           change: tuple[float, ...]) -> None:
    goal = begun().step(LEFT + left, RIGHT + right, REST, REST)
    assert (goal - STRAIGHT).tolist() == pytest.approx(change, abs=1e-6)


def test_all_at_once_from_a_rolled_camera() -> None:
    camera = begun((0.1, 0.2, 0.12, 0.3))
    goal = camera.step(np.array((0.17, -0.04, 0.4)), np.array((-0.13, -0.06, 0.4)), REST, REST)
    assert goal.tolist() == pytest.approx((0.051397, 0.188444, 0.119901, 0.233432), abs=1e-6)


def test_hands_are_kept_as_far_apart_as_they_were() -> None:
    camera = begun()
    camera.step(LEFT + (0.01, 0, 0), RIGHT - (0.01, 0, 0), REST, REST)
    assert camera.left_force.tolist() == pytest.approx((-1.5, 0, 0), abs=1e-9)
    assert camera.right_force.tolist() == pytest.approx((1.5, 0, 0), abs=1e-9)
    camera.step(LEFT, RIGHT, np.array((0.1, 0.1, 0.1)), REST)
    assert camera.left_force.tolist() == pytest.approx((-1, -1, -4), abs=1e-9)


def test_masters_turn_with_the_view() -> None:
    camera, first = begun(), np.eye(3)
    assert camera.orientation(first) == pytest.approx(np.eye(3))
    goal = camera.step(LEFT + (0, 0.01, 0), RIGHT - (0, 0.01, 0), REST, REST)
    c, s = np.cos(-goal[3]), np.sin(-goal[3])
    assert camera.orientation(first) == pytest.approx(np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))), abs=1e-9)


def test_masters_elsewhere_are_named_with_their_place() -> None:
    assert not outside("MTML", LEFT)
    assert outside("MTML", LEFT + (0.3, 0, 0)).startswith("MTML is at (0.450, -0.050, 0.400) m, it must be within")
    assert outside("MTML", np.full(3, np.nan))
