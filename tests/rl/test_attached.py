"""What an environment does with a running system, which a host plays here: it moves it slowly, and stops in time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np
import pytest

from tests.rl.playing import drawn
from tests.rl.running import HandAtArm, HostTime, ask, home, is_over, made
from trocar.procs.host.host import Host
from trocar.procs.rl import attached
from trocar.procs.rl.attached import RunningSystem
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.hand_over import PsmHandOver
from trocar.procs.rl.rollouts import RolloutTask, run
from trocar.procs.rl.tasks import EcmAim, PsmReach
from trocar.shm.time.system_time import LOCKSTEP
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import all_up, is_up


@pytest.mark.parametrize("control", ["joint", "cartesian"])
@pytest.mark.slow
def test_a_policy_goes_the_same_way_bit_by_bit_where_arms_are_ideal(psm: Host, control: str) -> None:
    env, other = made(psm, control=control), PsmReach(control=control, starts=2)
    rows = [np.frombuffer(drawn(each, 5, 12)) for each in (env, other)]
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-9)
    env.close()
    other.close()


@pytest.mark.slow
def test_it_powers_and_homes_nothing(system: Callable[..., Host]) -> None:
    host = system("kinematic.yaml")
    with pytest.raises(RobotStopped, match=r"PSM1 is DISABLED and not homed; first: trocar home PSM1"):
        made(host)
    host.run(2.0)
    state = host.reader("PSM1")
    assert state.newest() and state.field("state")[()] == b"DISABLED"


@pytest.mark.slow
def test_who_was_held_up_does_not_go_on(psm: Host) -> None:
    env = made(psm)
    env.reset()
    psm.run(5.0)  # before the first step one may think as long as one likes
    env.step(np.ones(7))
    psm.run(0.09)
    assert not env.step(np.ones(7))[2]
    psm.run(0.15)
    is_over(env, "this program stalled for 0.1")
    env.close()


@pytest.mark.slow
def test_after_a_fault_it_waits_for_a_person_to_make_it_anew(system: Callable[..., Host]) -> None:
    host = system("demo.yaml", "PSM1", backend="boards")
    env = made(host)
    env.reset()
    env.step(np.ones(7))
    host.client("boards").send("emergency_stop", (1.0,))
    for _ in range(10):
        if (seen := env.step(np.zeros(7)))[2]:
            break
    assert "PSM1 is FAULT" in seen[4]["fault"], seen[4]
    with pytest.raises(RobotStopped, match=r"PSM1 is FAULT"):
        env.reset()
    assert ask(host, host.client("boards"), "emergency_stop", (0.0,)) == "done"
    home(host, "PSM1")
    state = host.reader("PSM1")
    assert state.newest()
    before = state.field("setpoint_position").copy()
    for act in (partial(env.step, np.ones(7)), env.reset, partial(env.step, np.ones(7))):
        with pytest.raises(RobotStopped, match="make a new environment"):
            act()
    link = env.robot.links[0]
    link.forget()
    link.send("servo_jp", before[:6] + 0.001)  # what is on its way still counts for nothing, too
    host.run(0.5)
    link.hear()
    assert "after the last fault" in link.refusal
    assert state.newest() and (state.field("setpoint_position") == before).all()
    env.close()
    again = made(host)
    again.reset()
    again.close()


def person_holds(observation: object) -> object:
    """A policy during which a person holds the arm."""
    HostTime.host.client("PSM1").send("hold")
    HostTime.host.run(0.02)
    return np.zeros(7)


def test_a_rollout_whose_last_episode_was_stopped_says_so(psm: Host) -> None:
    where = RunningSystem(psm.name)
    episodes = run(RolloutTask("trocar/PsmReach-v0", {"backend": where, "starts": 2}, f"{__name__}:person_holds"), [1])
    assert "hold" in next(episodes).fault
    with pytest.raises(RobotStopped, match="make a new environment"):
        next(episodes)


def test_a_base_that_is_moved_ends_it_before_the_arm_jumps(psm: Host) -> None:
    person, state = psm.client("PSM1"), psm.reader("PSM1")
    person.send("set_base_frame", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "table")
    psm.run(0.01)
    env = made(psm)
    env.reset()
    env.step(np.ones(7))
    assert state.newest()
    before = state.field("setpoint_position").copy()
    person.send("set_base_frame", (0.0, 0.0, 0.0005, 0.0, 0.0, 0.0, 1.0), "table")
    psm.run(0.01)
    assert not (seen := env.step(np.zeros(7)))[2], seen[4]
    assert state.newest() and np.abs(state.field("setpoint_position") - before).max() < 1e-3
    person.send("set_base_frame", (0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0), "table")
    psm.run(0.01)
    is_over(env, "the base of PSM1 has moved since the environment was made")
    assert state.newest() and np.abs(state.field("setpoint_position") - before).max() < 1e-3
    env.close()


@pytest.fixture
def hand(system: Callable[..., Host]) -> HandAtArm:
    host = system("demo.yaml", "PSM1", backend="boards")
    return HandAtArm(host)


@pytest.mark.slow
def test_an_arm_that_a_hand_takes_is_let_go(hand: HandAtArm) -> None:
    env = made(HostTime.host)
    env.reset()
    hand.clutch(True)
    for _ in range(6):
        if (seen := env.step(np.zeros(7)))[2]:
            break
    assert "PSM1 is MANUAL, which we did not request" in seen[4]["fault"], seen[4]
    with pytest.raises(RobotStopped, match="PSM1 is MANUAL, which we did not request; begin once it is at rest"):
        made(HostTime.host).reset()
    env.close()


@pytest.mark.parametrize("steps", [0, 3])
@pytest.mark.slow
def test_an_arm_that_a_hand_has_moved_unseen_does_not_leap_back(hand: HandAtArm, monkeypatch: pytest.MonkeyPatch,
                                                                steps: int) -> None:
    env = made(HostTime.host)
    env.reset()
    for _ in range(steps):
        env.step(np.zeros(7))
    before = hand.setpoint()
    hand.moves()
    away = hand.setpoint()
    assert 0.02 < abs(away - before) < 0.15, "so far a stream may begin from"
    monkeypatch.setattr(attached, "GAP_NS", 1_000_000_000)
    is_over(env, "PSM1 was moved by another program: ")
    HostTime.host.run(0.05)
    assert abs(hand.setpoint() - away) < 0.001
    env.close()


def test_an_arm_that_carries_something_else_is_let_go(psm: Host) -> None:
    env = made(psm)
    env.reset()
    env.robot.models[0].carried = "PROGRASP_FORCEPS:400049"  # as if that had been there before
    is_over(env, "PSM1 carries LARGE_NEEDLE_DRIVER:400006, no longer PROGRASP_FORCEPS:400049")
    env.close()


def test_an_arm_that_refuses_what_is_streamed_ends_it(psm: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    env = made(psm)
    env.reset()
    client = env.robot.links[0]._client
    monkeypatch.setattr(env.robot.links[0], "send", lambda *_: client.send("servo_jp", (0.0,)))
    assert not env.step(np.zeros(7))[2], "a base that trembles"
    assert not env.step(np.zeros(7))[2]
    is_over(env, "PSM1 refuses: servo_jp")
    env.close()


def test_who_shows_nothing_any_more_is_asked_for_nothing(psm: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    env = made(psm)
    env.reset()
    monkeypatch.setattr(HostTime, "ahead_ns", 300_000_000)
    is_over(env, "PSM1 no longer publishes its state")
    env.close()


@pytest.mark.slow
def test_an_arm_that_moves_for_somebody_else_is_not_taken(psm: Host) -> None:
    person, state, env = psm.client("PSM1"), psm.reader("PSM1"), made(psm)
    goal = (0.6, 0.5, 0.2, 0.0, 0.0, 0.0)
    person.send("move_jp", goal)
    psm.run(0.05)
    with pytest.raises(RobotStopped, match="PSM1 is moving, which we did not request; begin once it is at rest"):
        env.reset()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.ones(7))
    psm.run(3.0)
    assert state.newest()
    np.testing.assert_allclose(state.field("position")[:6], goal, atol=1e-6)
    env.reset()
    env.close()


@pytest.mark.parametrize(("command", "values"), [("hold", ()), ("move_jp", (0.2, -0.1, 0.11, 0.0, 0.0, 0.0)),
                                                 ("jaw/servo_jp", (0.1,))])
def test_who_else_commands_the_arm_has_it(psm: Host, command: str, values: tuple[float, ...]) -> None:
    person = psm.client("PSM1")
    assert ask(psm, person, "hold") == "done"  # before the episode it does not count
    env = made(psm)
    env.reset()
    assert ask(psm, person, "trajectory_j/set_ratio", (0.9,)) == "done"  # nor do settings
    assert not env.step(np.zeros(7))[2]
    person.send(command, values)
    psm.run(0.01)
    is_over(env, f"PSM1 received {command} from")
    psm.run(3.0)
    state = psm.reader("PSM1")
    assert state.newest()
    if command == "move_jp":
        np.testing.assert_allclose(state.field("position")[:6], values, atol=1e-6)
    env.close()


@pytest.mark.slow
def test_a_person_s_stop_counts_between_episodes_too(psm: Host) -> None:
    person, env = psm.client("PSM1"), made(psm)
    env.reset()
    assert ask(psm, person, "move_jp", (0.2, -0.1, 0.11, 0.0, 0.0, 0.0)) == "done"
    env.reset()  # a move that has ended does not
    assert ask(psm, person, "move_jp", (0.2, -0.1, 0.11, 0.0, 0.0, 0.0)) == "done"
    assert ask(psm, person, "hold") == "done"
    with pytest.raises(RobotStopped, match=r"PSM1 received hold from .* make a new environment"):
        env.reset()
    env.close()
    again = made(psm)
    again.reset()
    for word in ("pause", "resume"):
        assert ask(psm, person, "state_command", (), word) == "done"
    with pytest.raises(RobotStopped, match=r"PSM1 received state_command pause from"):
        again.reset()
    again.close()


def test_a_stop_that_nobody_can_read_any_more_counts_too(psm: Host) -> None:
    person, env = psm.client("PSM1"), made(psm)
    env.reset()
    assert ask(psm, person, "hold") == "done"
    for _ in range(300):
        person.send("trajectory_j/set_ratio", (1.0,))
        psm.run(0.004)
    with pytest.raises(RobotStopped, match=r"PSM1 received more commands than are kept: \d+ of them are lost"):
        env.reset()
    env.close()


def test_of_two_environments_at_an_arm_neither_fights_the_other(psm: Host) -> None:
    first, second = made(psm), made(psm)
    first.reset(seed=1)
    second.reset(seed=2)
    is_over(first, "PSM1 received")
    assert not second.step(np.zeros(7))[2]
    first.close()
    second.close()


def test_what_cannot_be_attached_is_refused(system: Callable[..., Host], monkeypatch: pytest.MonkeyPatch) -> None:
    host = system("kinematic-hand-over.yaml")
    where = RunningSystem(host.name, arms=("PSM2",))
    with pytest.raises(ValueError, match=r"arms are PSM2 \(PSM\); it takes 1 different ECM"):
        EcmAim(backend=where)
    with pytest.raises(ValueError, match=r"arms are PSM2 \(PSM\); it takes 2 different PSM"):
        PsmHandOver(backend=where)
    with pytest.raises(ValueError, match=r"reset_ratio is 1; allowed: 0.01 to 0.5"):
        RunningSystem(reset_ratio=1.0)
    with pytest.raises(TypeError, match=r"arms is 'PSM1'; allowed: names, as \('PSM1',\)"):
        RunningSystem(arms="PSM1")  # type: ignore[arg-type]
    with pytest.raises(Problem, match=r"ECM.*RunningSystem\(arms="):
        made(host, EcmAim)
    monkeypatch.setattr(HostTime, "clock", LOCKSTEP)
    with pytest.raises(Problem, match=r"is in lock-step"):
        made(host)


@pytest.mark.slow
def test_two_arms_hand_over_as_in_a_host(system: Callable[..., Host]) -> None:
    host = system("kinematic-hand-over.yaml", "PSM1", "PSM2")
    env, other = made(host, PsmHandOver), PsmHandOver(starts=2)
    np.testing.assert_allclose(np.frombuffer(drawn(env, 3, 4)), np.frombuffer(drawn(other, 3, 4)), atol=1e-9)
    env.close()
    other.close()


def test_an_environment_of_this_program_is_no_system_that_is_up(psm: Host) -> None:
    assert is_up(psm.name) and psm.name not in all_up()
