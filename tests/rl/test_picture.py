"""Pictures without a screen, where this machine can draw: the instrument, its goal and the ground are on them."""

from __future__ import annotations

import importlib
import warnings
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.rl.playing import psm
from trocar.procs.rl import picture
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.hand_over import PEG_COLOUR, PsmHandOver
from trocar.procs.rl.picture import Picture, PictureError
from trocar.procs.rl.scene import DARK, GREEN, STEEL, scene_of
from trocar.procs.rl.tasks import EcmAim, PsmReach


@pytest.fixture(scope="module", autouse=True)
def _can_draw() -> None:
    try:
        Picture(32, 32).close()
    except PictureError as error:
        pytest.skip(str(error))


def share(image: np.ndarray, lower: tuple[int, int, int], upper: tuple[int, int, int]) -> float:  # type: ignore[type-arg]
    """Of pixels between two colours."""
    return float(((image >= lower) & (image <= upper)).all(axis=2).mean())


@pytest.mark.parametrize(("task", "size"), [(PsmReach, (160, 120)), (EcmAim, (240, 180))])
@pytest.mark.slow
def test_the_instrument_and_its_goal_are_on_the_ground_before_the_sky(task: type[RobotEnv],
                                                                    size: tuple[int, int]) -> None:
    env = task(render_mode="rgb_array", width=size[0], height=size[1], starts=1)
    env.reset(seed=4)
    image = env.render()
    assert image.shape == (size[1], size[0], 3) and image.dtype == np.uint8
    assert share(image, (0, 0, 0), (70, 70, 80)) > 0.003, "the shaft is dark"
    green = (image[..., 1].astype(int) - image[..., 0] > 40) & (image[..., 1].astype(int) - image[..., 2] > 30)
    assert 1e-4 < green.mean() < 0.05, "the goal is green"
    assert share(image, (150, 150, 150), (240, 240, 245)) > 0.5, "the ground is bright"
    other = env.render()
    assert other is not image and (other == image).all()
    for _ in range(5):
        env.step(np.ones(env.action_space.shape))
    assert (env.render() != image).any()
    env.close()


def test_who_wants_no_pictures_gets_none() -> None:
    env = PsmReach(starts=1)
    env.reset()
    assert env.render() is None
    env.close()


def test_what_is_drawn_stands_where_the_chain_says() -> None:
    model = psm()
    things = scene_of([(model, model.centre, 0.5)], [])
    ends = [thing.middle + side * thing.size[1] * thing.axes[:, 2] for thing in things if thing.colour == STEEL
            for side in (-1, 1)]
    assert min(np.linalg.norm(end - model.middle) for end in ends) < 0.004
    shaft = next(thing for thing in things if thing.colour == DARK)
    assert abs(np.cross(shaft.middle - model.base[:3, 3], shaft.axes[:, 2])).max() < 1e-4, "through the remote centre"


@pytest.mark.slow
def test_two_arms_and_a_peg_are_drawn() -> None:
    env = PsmHandOver(starts=1)
    env.reset(seed=1)
    colours = [thing.colour for thing in env.things()]
    assert colours == [GREEN, PEG_COLOUR]
    env.close()


def test_where_nothing_draws_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> SimpleNamespace:
        raise ImportError(f"{name} cannot be loaded")

    monkeypatch.setattr(picture, "importlib", SimpleNamespace(import_module=absent))
    monkeypatch.setattr(picture, "_is_there", lambda library: library == "libEGL.so.1")
    with pytest.raises(PictureError, match=r"mujoco.egl cannot be loaded.*apt-get install libegl1"):
        Picture(32, 32)
    monkeypatch.setattr(picture, "_is_there", lambda library: True)
    with pytest.raises(PictureError, match=r"mujoco.egl cannot be loaded.*libOSMesa.so.8 is there: .*MUJOCO_GL=osmesa"):
        Picture(32, 32)
    monkeypatch.undo()
    monkeypatch.setattr(picture, "WAYS", {"egl": "libNoEGL.so.1"})
    with pytest.raises(PictureError, match=r"libNoEGL.so.1 are not there"):
        Picture(32, 32)


@pytest.mark.slow
def test_gymnasium_finds_nothing_wrong_with_its_pictures() -> None:
    importlib.import_module("trocar.procs.rl.registration")
    env = gymnasium.make("trocar/PsmReach-v0", render_mode="rgb_array", starts=1, width=64, height=48)
    with warnings.catch_warnings(action="error"):
        check_env(env.unwrapped)
    env.close()
