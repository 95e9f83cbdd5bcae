"""The slow move of a reset on a running system: no faster than a person has set the arm, and it ends in time."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium
import numpy as np
import pytest

from tests.rl.running import HostTime, ask, made
from trocar.procs.host.host import Host
from trocar.procs.rl import attached
from trocar.procs.rl.attached import RunningSystem
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.tasks import PsmReach
from trocar.shm.ring.ring import RingReader


@pytest.mark.slow
def test_reset_is_a_slow_move_and_leaves_the_speed_as_it_was(psm: Host) -> None:
    assert ask(psm, psm.client("PSM1"), "trajectory_j/set_ratio", (0.7,)) == "done"
    env, reader = made(psm), psm.reader("PSM1")
    begun_ns = psm.now_ns
    while reader.next():
        pass
    env.reset(options={"start": 1})
    assert psm.now_ns - begun_ns > 1_000_000_000
    psm.run(0.1)
    assert reader.newest()
    assert reader.field("trajectory_ratio_v")[()] == reader.field("trajectory_ratio_a")[()] == 0.7
    np.testing.assert_allclose(reader.field("position")[:6], env._starts[0][1].joints, atol=1e-6)
    env.close()


def quickest(state: RingReader) -> float:
    """The largest velocity that a PSM's yaw was asked to have among the records that are kept, rad/s."""
    assert state.newest()
    return float(np.abs(state.last(2000)["setpoint_velocity"][:, 0]).max())


@pytest.mark.slow
def test_reset_is_no_faster_than_a_person_has_set(system: Callable[..., Host]) -> None:
    host = system("kinematic.yaml", "PSM1", history=2000)
    person, state = host.client("PSM1"), host.reader("PSM1")
    assert ask(host, person, "move_jp", (0.02, 0.02, 0.12, 0.0, 0.0, 0.0)) == "done"
    assert ask(host, person, "trajectory_j/set_ratio_v", (0.02,)) == "done"
    env = PsmReach(backend=RunningSystem(host.name, reset_ratio=0.5), starts=1)
    host.run(4.1)  # longer than records are kept
    env.reset()
    assert 0.0 < quickest(state) < 0.04
    assert state.field("trajectory_ratio_v")[()] == 0.02 and state.field("trajectory_ratio_a")[()] == 1.0
    env.close()


def test_resets_one_after_the_other_leave_the_speed_as_it_was(psm: Host) -> None:
    env, state = made(psm), psm.reader("PSM1")
    for start in (0, 1, 1, 0):
        env.reset(options={"start": start})
        assert state.newest() and state.field("trajectory_ratio")[()] == 1.0
    env.close()


@pytest.mark.slow
def test_who_makes_the_slow_move_faster_ends_it(system: Callable[..., Host], monkeypatch: pytest.MonkeyPatch) -> None:
    host = system("kinematic.yaml", "PSM1", history=2000)
    person, state, env = host.client("PSM1"), host.reader("PSM1"), made(host)
    assert ask(host, person, "move_jp", (0.6, 0.5, 0.2, 0.0, 0.0, 0.0)) == "done"
    host.run(4.1)  # longer than records are kept
    monkeypatch.setattr(HostTime, "waits", 30)
    monkeypatch.setattr(HostTime, "comes", lambda: person.send("trajectory_j/set_ratio", (0.9,)), raising=False)
    with pytest.raises(RobotStopped, match=r"another program set the trajectory ratio of PSM1 to 0.9 during our move"):
        env.reset()
    host.run(0.5)
    assert 0.01 < quickest(state) < 0.2 and not state.field("is_busy")[()]
    assert state.field("trajectory_ratio")[()] == 0.9, "theirs stays"
    env.close()


def test_the_slower_the_move_the_longer_it_may_take(psm: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attached, "MOVE_S", 0.2)
    env = PsmReach(backend=RunningSystem(psm.name, reset_ratio=0.05), starts=2)
    env.reset(options={"start": 1})
    monkeypatch.setattr(attached, "MOVE_S", 0.01)
    with pytest.raises(RobotStopped, match=r"move_jp is not done after 0.2 s"):
        env.reset(options={"start": 0})
    env.close()


@pytest.mark.parametrize("ends", [KeyboardInterrupt, SystemExit, None])
def test_whatever_ends_the_slow_move_the_arm_holds(psm: Host, monkeypatch: pytest.MonkeyPatch, ends: type | None
                                                   ) -> None:
    """None: another program asks for the jaw, which would leave our move of the arm as it is."""
    assert ask(psm, psm.client("PSM1"), "move_jp", (0.6, 0.5, 0.2, 0.0, 0.0, 0.0)) == "done"
    person, state, env = psm.client("PSM1"), psm.reader("PSM1"), made(psm)

    def comes() -> None:
        assert state.newest() and state.field("is_busy")[()]
        if ends is not None:
            raise ends
        person.send("jaw/move_jp", (0.3,))

    monkeypatch.setattr(HostTime, "waits", 30)
    monkeypatch.setattr(HostTime, "comes", staticmethod(comes), raising=False)
    with pytest.raises(ends or RobotStopped):
        env.reset(options={"start": 1})
    psm.run(0.1)
    assert state.newest() and not state.field("is_busy")[()]
    before = state.field("position").copy()
    assert 0.5 < before[0] < 0.6 and state.field("trajectory_ratio")[()] == 1.0
    psm.run(0.5)
    assert state.newest() and (state.field("position") == before).all()
    with pytest.raises((gymnasium.error.ResetNeeded, RobotStopped)):
        env.step(np.zeros(7))
    env.close()


def test_who_was_held_up_in_the_slow_move_does_not_go_on(psm: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    env = made(psm)
    monkeypatch.setattr(HostTime, "hold_ups", 20)
    with pytest.raises(RobotStopped, match=r"this program stalled for 0.2"):
        env.reset(options={"start": 1})
    psm.run(0.1)
    state = psm.reader("PSM1")
    assert state.newest() and not state.field("is_busy")[()]
    with pytest.raises(RobotStopped, match="make a new environment"):
        env.reset()
    env.close()


def test_a_slow_move_ends_where_the_system_s_time_stands_still(psm: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    env = made(psm)
    monkeypatch.setattr(HostTime, "stands_after", 20)
    with pytest.raises(RobotStopped, match="the system's time has stood still for 10 s"):
        env.reset(options={"start": 1})
    psm.run(0.1)
    state = psm.reader("PSM1")
    assert state.newest() and not state.field("is_busy")[()]
    env.close()
