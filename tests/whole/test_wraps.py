"""32-bit counters at their end: a robot homes, follows, and outlives its arm's process as before."""

from __future__ import annotations

import itertools
from typing import Any, cast

import pytest

from tests.host.hosted import QUICK, HashedArm, document
from tests.io.harness import IoHarness
from trocar.procs.host.host import Host
from trocar.procs.tables.generation import WRAP, next_generation
from trocar.shm.mailbox import origins

LAST = WRAP - 1
GOAL, BACK = (0.1, -0.1, 0.12, 0.0, 0.0, 0.0), (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)


def test_the_next_generation_is_another_one_and_none_is_0() -> None:
    for generation in (0, 1, WRAP // 2, LAST - 1, LAST):
        assert 0 < next_generation(generation) <= LAST and next_generation(generation) != generation


def test_a_robot_homes_moves_and_outlives_its_arms_process_when_every_counter_begins_again() -> None:
    with Host(document("kinematic.yaml", sets=QUICK)) as host:
        host.run(0.05)
        loops: dict[str, Any] = dict(host.loops)
        loops["io"]._core.record.bias_generation[...] = LAST
        loops["PSM1"].arm.control.io_requests._generation = LAST - 3
        host.restart("io")  # the counters of a process continue those of the one before
        arm, record = HashedArm(host), cast(Any, host.loops["io"])._core.record
        record.pid_generation[...] = LAST
        arm.homes()
        assert record.pid_generation.item() == 1 and 1 <= record.desired_generation.item() < 10
        assert arm.does("move_jp", GOAL) == "done", "io follows"
        host.restart("PSM1", killed=True)
        arm.run(0.05)
        state = host.reader("PSM1")
        assert state.newest() and state.field("is_homed"), "the encoders are those of before"
        assert arm.does("move_jp", BACK) == "done"
        for word, powered in (("disable", False), ("enable", True)):
            assert arm.does("state_command", (), word) == "done"
            assert bool(record.power_requested[0]) is powered


@pytest.mark.parametrize("native", [True, False])
def test_setpoints_of_the_enable_before_are_not_followed_after_the_last_number(native: bool) -> None:
    harness = IoHarness() if native else IoHarness().by_numpy()
    harness.power()
    harness.record.pid_generation[...] = LAST
    harness.ask("bias_encoders", 10)
    harness.run_s(0.1)
    harness.record.bias_generation[...] = LAST
    harness.ask("bias_encoders", 10)
    harness.run_s(0.1)
    assert harness.record.bias_generation[0] == 1
    harness.ask("pid_enable", 1)
    assert harness.record.pid_generation[0] == 1
    harness.send(1, position=[0.01] * 8)
    harness.run(3)
    assert harness.record.setpoint_position[0] == pytest.approx(0.01)
    alive, harness.arms_alive = harness.arms[0], False
    alive.pid_generation[...] = LAST
    alive.position[...] = 0.02
    for _ in range(3):
        alive.stamp_ns = harness.clock.ns
        harness.run()
    assert harness.record.setpoint_position[0] == pytest.approx(0.01)


def test_commands_of_a_person_have_numbers_of_their_program_after_four_thousand_millions(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(origins, "COUNT", itertools.count(LAST - 1))
    monkeypatch.setattr("os.getpid", lambda: 1 << 22)  # the largest
    numbers = [origins.new_id() for _ in range(4)]
    assert len(set(numbers)) == 4 and min(numbers) > 0 and max(numbers) < 1 << 64
    assert all(origins.is_direct(number, 1 << 22) for number in numbers)
