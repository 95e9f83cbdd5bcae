"""The end of a stage that moves an arm: it holds before its usual speed is restored, whatever has ended the stage."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock, call

import pytest

from trocar.tools.commission.move import end
from trocar.tools.output.errors import Problem


@pytest.mark.parametrize("problem", [None, Problem("it is in FAULT"), TimeoutError("no answer")])
def test_the_arm_holds_first_and_keeps_its_low_speed_if_it_does_not_hold(problem: Exception | None) -> None:
    arm: Any = Mock()
    arm.hold.side_effect = problem
    end(arm, 1.0)
    restored = [] if problem else [call.trajectory_j_set_ratio(1.0)]
    assert arm.mock_calls == [call.hold(), *restored, call.close()]
