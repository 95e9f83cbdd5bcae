"""Whether a master's gripper is closed, from what its arm has told and where it is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.tools.client.kinds import Gripper


def gripper(angle: float, *, reported: bool) -> Gripper:
    record: Any = SimpleNamespace(part=lambda view, name: (np.array([angle]), 1), reported=lambda event: reported)
    return Gripper(record, zero=0.05)


@pytest.mark.parametrize(("angle", "reported", "closed"), [(0.0, True, True), (0.05, True, True), (0.0, False, False)])
def test_it_is_closed_when_the_arm_says_so(angle: float, reported: bool, closed: bool) -> None:
    assert gripper(angle, reported=reported).closed() is closed


def test_one_that_opened_while_its_arm_was_away_is_open() -> None:
    assert gripper(0.3, reported=True).closed() is False
