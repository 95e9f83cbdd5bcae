"""The end of `trocar demo`: what it did not show it does not call shown."""

from __future__ import annotations

from typing import Any

import pytest

from shm.clock import monotonic_ns
from shm.system_time import SystemTime
from tools.errors import Problem
from tools.verbs.demo import _draw


class Idle:
    """A hand, a teleoperation, or whoever looks at them; nothing happens."""

    def __getattr__(self, name: str) -> Any:
        return lambda *values: None


def test_a_demo_that_a_busy_machine_left_no_time_says_so_as_a_problem() -> None:
    idle: Any = Idle()
    with SystemTime("") as time, pytest.raises(Problem, match=r"ended after 0\.0 of 3 s: this machine is busy"):
        _draw(idle, idle, (idle, idle), 3.0, [0], time, monotonic_ns(), lambda text: None)
