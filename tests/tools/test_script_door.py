"""`import trocar`: what a user's script sees of an arm that the test plays."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import trocar
from shm.clock import monotonic_ns, pause
from tests.tools.robot import Played, robot


@pytest.fixture
def played(world: Any) -> Iterator[Played]:
    with robot(world.name) as made:
        yield made


def answering(played: Played, *outcomes: str) -> threading.Thread:
    """The arm answers one command with each of the outcomes in turn."""

    def loop() -> None:
        end = monotonic_ns() + 10 * 10**9
        while monotonic_ns() < end:
            for command in played.mailbox.drain():
                for outcome in outcomes:
                    played.show_arm(0.3, state="ENABLED")
                    getattr(command, outcome)()
                return
            pause(0.001)

    thread = threading.Thread(target=loop)
    thread.start()
    return thread


def test_reads_return_value_and_stamp(played: Played) -> None:
    played.show_arm(0.25, state="ENABLED", homed=True)
    with trocar.arm("PSM1", played.name) as psm:
        position, stamp_ns = psm.measured_jp()
        assert position.tolist() == [0.25] * 6
        assert 0 < stamp_ns <= monotonic_ns()
        pose, _ = psm.measured_cp()
        assert np.allclose(pose[:3, 3], (1, 2, 3))
        assert pose.shape == (4, 4)
        assert psm.jacobian()[0].shape == (6, 6)
        assert psm.jaw.measured_jp()[0].tolist() == [0.25]
        assert psm.jaw.setpoint_js()[0].velocity.size == 0
        assert psm.operating_state()[0] == "ENABLED"
        assert psm.is_homed()
        assert not psm.is_busy()


def test_an_absent_arm_times_out(played: Played) -> None:
    with pytest.raises(TimeoutError, match="no arm PSM9"):
        trocar.arm("PSM9", played.name, timeout=0.0)


def test_a_silent_arm_times_out(played: Played) -> None:
    with pytest.raises(TimeoutError, match="does not show its state"):
        trocar.arm("PSM1", played.name, timeout=0.0)


def test_invalid_values_are_not_handed_out(played: Played) -> None:
    played.show_arm(valid=False)
    with trocar.arm("PSM1", played.name) as psm, pytest.raises(TimeoutError, match="not valid"):
        psm.measured_jp()


def test_a_move_is_busy_until_done(played: Played) -> None:
    played.show_arm(state="ENABLED")
    with trocar.arm("PSM1", played.name) as psm:
        thread = answering(played, "accept", "done")
        handle = psm.move_jp([0] * 6)
        thread.join()
        handle.wait(5.0)
        assert not handle.is_busy()


def test_a_move_that_is_not_done_times_out(played: Played) -> None:
    played.show_arm(state="ENABLED")
    with trocar.arm("PSM1", played.name) as psm:
        thread = answering(played, "accept")
        handle = psm.move_jp([0] * 6)
        thread.join()
        assert handle.is_busy()
        with pytest.raises(TimeoutError, match="move_jp is not done"):
            handle.wait(0.02)


def test_a_refused_command_raises_the_reason(played: Played) -> None:
    played.show_arm()
    with trocar.arm("PSM1", played.name) as psm:
        thread = threading.Thread(target=lambda: _refuse(played, "arm not ready"))
        thread.start()
        with pytest.raises(trocar.Refused, match="arm not ready"):
            psm.servo_jp([0] * 6, [0] * 6)
        thread.join()


def _refuse(played: Played, reason: str) -> None:
    end = monotonic_ns() + 10 * 10**9
    while monotonic_ns() < end:
        for command in played.mailbox.drain():
            assert len(command.values) == 12
            command.refuse(reason)
            return
        pause(0.001)


def test_a_system_lists_arms_and_processes(played: Played) -> None:
    with trocar.system(played.name) as system:
        assert system.arms() == ["PSM1"]
        assert {life.name for life in system.status()} == {"supervisor", "IO1", "PSM1"}
