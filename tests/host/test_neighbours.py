"""Arms that keep away from each other: two of them, driven by random streams in one process."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from tests.native.test_moved import by_mujoco, turned
from trocar.procs.arm.joints import body_of, joints
from trocar.procs.config import load_system
from trocar.procs.host.host import Host
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.procs.kinematics.walls.body import points_at
from trocar.procs.native.library import native
from trocar.shm.mailbox.client import Client

pytestmark = [pytest.mark.slow, pytest.mark.skipif(native().library is None, reason=f"no library: {native().why}")]
Array = Any
FILE = """\
$id: dvrk-system.schema.json
$version: "1"
arms:
  - {{name: PSM1, type: PSM, simulation: KINEMATIC, arm_file: arms/PSM1-demo.yaml}}
  - {{name: PSM2, type: PSM, simulation: KINEMATIC, arm_file: arms/PSM1-demo.yaml}}
  - {{name: ECM, type: ECM, simulation: KINEMATIC, arm_file: arms/ECM-demo.yaml}}
trocar:
  walls:
    - {{name: arms, shape: arms, arms: [PSM1, PSM2], margin: 0.005, unknown: {unknown}}}
    - {{name: view, shape: cone, size: [0.5], keep: in, of: tip, frame: ECM, arms: [PSM2]}}
"""
APART, EXACT, STEP_S = 0.005, 2e-6, 0.002
NEAR = 2e-4
TRACKING = 2.5e-3
"""m: how far the tips of two arms on emulated boards are from their setpoints, at most."""


class Pair:
    """Two homed arms in a host."""

    def __init__(self, text: str, boards: str | None = None, name: str = "xapart") -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "apart.yaml"
            file.write_text(text)
            sections = ("io",) if boards else ("io", "arm")
            periods = [f"{section}.period_s={STEP_S}" for section in sections]
            loaded = load_system(file, name=name, sets=["clock=paced", *periods], search=[Path("configs")],
                                 boards=boards)
        assert loaded.system is not None, loaded.errors
        arms = {arm.name: arm for arm in loaded.system.arms}
        self.host = Host(loaded.system, 64)
        self.names = ("PSM1", "PSM2")
        self.clients: dict[str, Client] = {name: self.host.client(name) for name in arms}
        self.states = {name: self.host.reader(name) for name in self.clients}
        self.walls = {name: self.host.reader(name, "walls") for name in self.names}
        self.spaces = {name: joints(arms[name], arms[name].tool) for name in self.names}
        self.bodies = {name: body_of(arms[name], self.spaces[name]) for name in self.names}
        self.bases: dict[str, Array] = {name: np.array(arms[name].base_frame or np.eye(4)) for name in self.names}
        self.host.run(0.1)
        for word, field, wanted in (("enable", "sub_state", b"ENABLED"), ("home", "is_homed", True)):
            for name in self.clients:
                self.clients[name].send("state_command", (), word)
            for _ in range(60):
                self.host.run(0.2)
                if all(self.state(name, field).item() == wanted for name in self.clients):
                    break
            else:
                raise AssertionError(f"{word}: {[self.state(name, 'reason').item() for name in self.clients]}")

    def state(self, name: str, field: str) -> Any:
        self.states[name].newest()
        return self.states[name].field(field).copy()

    def wall(self, name: str, field: str) -> Any:
        self.walls[name].newest()
        return self.walls[name].field(field).copy()

    def ask(self, name: str, command: str, values: Any = (), text: str = "", seconds: float = STEP_S) -> Any:
        """Send a command, and let time pass; its last outcome and text."""
        number = self.clients[name].send(command, values, text)
        self.host.run(seconds)
        return [(reply.outcome, reply.text) for reply in self.clients[name].poll() if reply.id == number]

    def reattach(self, name: str) -> None:
        """After a restart of an arm."""
        self.clients[name] = self.host.client(name)

    def put(self, name: str, base: Array | None) -> None:
        """Set a base frame; None: unknown."""
        if base is not None:
            self.bases[name] = base
        self.ask(name, "set_base_frame", () if base is None else pose_from_matrix(base), "world", 0.08)

    def go(self, name: str, q: Array) -> None:
        """Move there, with the rule off."""
        self.put(name, None)
        assert self.ask(name, "move_jp", q, seconds=6.0)[-1][0] == "done"

    def capsules(self, name: str) -> list[tuple[Array, Array, float]]:
        body, space, base = self.bodies[name], self.spaces[name], self.bases[name]
        assert space.kinematics is not None
        q = self.state(name, "setpoint_position")[: space.count]
        points = points_at(space.kinematics, q, list(zip(body.of.tolist(), body.place, strict=True)))
        points = points @ base[:3, :3].T + base[:3, 3]
        return [(points[i], points[j], r) for i, j, r in zip(body.starts, body.stops, body.radius, strict=True) if r]

    def apart(self) -> float:
        """The distance of both setpoints' bodies from each other, above what is kept."""
        return by_mujoco(*(self.capsules(name) for name in self.names), most=0.05) - APART


@pytest.fixture(scope="module")
def pair() -> Iterator[Pair]:
    made = Pair(FILE.format(unknown="off"))
    yield made
    made.host.close()


def facing(pair: Pair, rng: np.random.Generator) -> Array:
    """A base of PSM2 whose tips are where those of PSM1 are."""
    kinematics, base = pair.spaces["PSM1"].kinematics, turned(rng, 0.0)
    assert kinematics is not None
    middle = kinematics.fk(np.array((0.0, 0.0, 0.14, 0.0, 0.0, 0.0)), np.eye(4))[:3, 3]
    base[:3, 3] = middle + rng.uniform(-0.03, 0.03, 3) - base[:3, :3] @ middle
    return base


def any_joints(rng: np.random.Generator) -> Array:
    return rng.uniform((-0.4, -0.4, 0.1, -1.0, -0.6, -0.6), (0.4, 0.4, 0.18, 1.0, 0.6, 0.6))


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=3,
          derandomize=True)
@given(some.integers(0, 2**32 - 1))
def test_no_stream_brings_two_arms_nearer_than_they_may_be(pair: Pair, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = {name: any_joints(rng) for name in pair.names}
    pair.go("PSM2", places["PSM2"])
    pair.go("PSM1", places["PSM1"])
    pair.put("PSM2", facing(pair, rng))
    pair.put("PSM1", np.eye(4))
    assert all(pair.wall(name, "active")[0] for name in pair.names)
    least, begin = min(pair.apart(), 0.0), {name: pair.state(name, "setpoint_position")[:6] for name in pair.names}
    for name in pair.names:
        assert pair.state(name, "setpoint_position")[:6] == pytest.approx(places[name], abs=1e-6), "nothing moves"
    for _ in range(3):
        ends = {name: any_joints(rng) for name in pair.names}
        count = int(rng.integers(150, 300))
        for share in np.linspace(0.0, 1.0, count):
            before = {name: pair.state(name, "setpoint_position")[:6] for name in pair.names}
            for name in pair.names:
                pair.clients[name].send("servo_jp", begin[name] + share * (ends[name] - begin[name]))
            pair.host.run(STEP_S)
            for name in pair.names:
                steps = np.abs(pair.state(name, "setpoint_position")[:6] - before[name])
                assert (steps <= 1.4 * STEP_S * pair.spaces[name].servo_speed[:6]).all(), "no jump"
            apart = pair.apart()
            assert apart >= least - EXACT or apart < -APART + 1e-4
            least = min(max(apart, least), 0.0)
        begin = ends
    for name in pair.names:
        back = pair.state(name, "setpoint_position")[:6]
        pair.host.run(1.0)  # streams pause, so that the next ones begin
        for share in np.linspace(0.0, 1.0, 150):
            goal = back.copy()
            goal[2] += share * (0.03 - back[2])
            pair.clients[name].send("servo_jp", goal)
            pair.host.run(STEP_S)
            apart = pair.apart()  # of two shafts that cross, the one with the bent wrist may be caught
            assert apart >= least - EXACT or apart < -APART + 1e-4
            least = min(max(apart, least), 0.0)


def side_by_side(pair: Pair, far: float = 0.03) -> None:
    """Both straight down, so far from each other."""
    for name in pair.names:
        pair.go(name, (0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
    base = np.eye(4)
    base[0, 3] = far
    pair.put("PSM1", np.eye(4))
    pair.put("PSM2", base)


def pushed(pair: Pair, name: str, yaw: float, count: int = 200) -> tuple[str, str]:
    """Turn an arm about its yaw by a stream; returns the last answer."""
    begin = pair.state(name, "setpoint_position")[:6]
    for share in np.linspace(0.0, 1.0, count):
        pair.host.run(STEP_S)
        number = pair.clients[name].send("servo_jp", begin + share * yaw * np.eye(6)[0])
    pair.host.run(STEP_S)
    return [(reply.outcome, reply.text) for reply in pair.clients[name].poll() if reply.id == number][-1]


def towards(pair: Pair) -> float:
    """The sign of the yaw that takes PSM1 to PSM2."""
    at = []
    assert pair.spaces["PSM1"].kinematics is not None
    for yaw in (-0.1, 0.1):
        at.append(pair.spaces["PSM1"].kinematics.fk(np.array((yaw, 0.0, 0.12, 0.0, 0.0, 0.0)), np.eye(4))[0, 3])
    return 1.0 if at[1] > at[0] else -1.0


def test_an_arm_stops_beside_another_and_says_beside_which(pair: Pair) -> None:
    side_by_side(pair)
    assert pushed(pair, "PSM1", 0.4 * towards(pair)) == ("done", "at wall arms: PSM2")
    assert pair.wall("PSM1", "stopped_by").item() == b"arms: PSM2"
    pair.host.run(0.3)
    assert pair.apart() == pytest.approx(0.0, abs=NEAR) and pair.wall("PSM1", "distance")[0] < NEAR
    refused = pair.ask("PSM1", "move_jp", (0.5 * towards(pair), 0.0, 0.12, 0.0, 0.0, 0.0))
    assert refused[-1][0] == "refused" and "wall arms: PSM2 is in the way" in refused[-1][1]


def test_a_move_ends_where_another_arm_comes_into_its_way(pair: Pair) -> None:
    side_by_side(pair, 0.1)
    number = pair.clients["PSM1"].send("move_jp", (0.5 * towards(pair), 0.0, 0.12, 0.0, 0.0, 0.0))
    pair.clients["PSM2"].send("move_jp", (-0.5 * towards(pair), 0.0, 0.12, 0.0, 0.0, 0.0))
    least = np.inf
    for _ in range(800):
        pair.host.run(STEP_S)
        least = min(least, pair.apart())
    replies = [(reply.outcome, reply.text) for reply in pair.clients["PSM1"].poll() if reply.id == number]
    if replies[-1][0] == "refused":  # PSM2 was quicker
        raise AssertionError(replies)
    assert replies[-1][0] == "failed" and "arms: PSM2" in replies[-1][1]
    assert least > -0.002, "what both move in a cycle or two"


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=2,
          derandomize=True)
@given(some.integers(0, 2**32 - 1))
def test_kills_and_pauses_of_both_arms_bring_them_no_nearer(pair: Pair, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for name in pair.names:
        pair.go(name, any_joints(rng))
    pair.put("PSM2", facing(pair, rng))
    pair.put("PSM1", np.eye(4))
    least = min(pair.apart(), 0.0)
    goals = {name: pair.state(name, "setpoint_position")[:6] for name in pair.names}
    ends = {name: any_joints(rng) for name in pair.names}
    for _ in range(300):
        for name in pair.names:
            if (np.abs(ends[name] - goals[name]) < 1e-3).all():
                ends[name] = any_joints(rng)
            goals[name] = goals[name] + np.clip(ends[name] - goals[name], -4e-3, 4e-3) * (1.0, 1.0, 0.1, 1.0, 1.0, 1.0)
            pair.clients[name].send("servo_jp", goals[name])
        if rng.random() < 0.02:
            name = pair.names[rng.integers(2)]
            if rng.random() < 0.5:
                pair.host.restart(name, killed=True)
                pair.reattach(name)
            else:
                pair.host.delay(name, float(rng.uniform(0.005, 0.08)))
            pair.host.run(0.1)
            pair.host.run(float(rng.uniform(0.0, 0.7)))
            goals = {each: pair.state(each, "setpoint_position")[:6] for each in pair.names}
        pair.host.run(STEP_S)
        apart = pair.apart()
        assert apart >= least - EXACT or apart < -APART + 1e-4
        least = min(max(apart, least), 0.0)


@pytest.mark.parametrize("dies", ["PSM2", "ECM"])
def test_an_arm_whose_process_is_dead_still_counts(pair: Pair, dies: str) -> None:
    side_by_side(pair)
    pair.host.delay(dies, 1e6)
    assert pushed(pair, "PSM1", 0.4 * towards(pair)) == ("done", "at wall arms: PSM2")
    pair.host.run(1.0)
    assert pair.apart() == pytest.approx(0.0, abs=NEAR)
    pair.host.restart(dies, killed=True)
    pair.reattach(dies)
    pair.host.run(0.2)
    assert pair.apart() == pytest.approx(0.0, abs=NEAR) and pair.wall("PSM1", "active")[0]


def test_until_the_base_frame_of_the_other_arm_is_known_an_arm_can_hold() -> None:
    made = Pair(FILE.format(unknown="hold"), name="xheld")
    here = made.state("PSM1", "setpoint_position")
    answer = pushed(made, "PSM1", 0.1, 20)
    assert answer == ("done", "at wall arms (the base frame of PSM2 is not known here)")
    assert (made.state("PSM1", "setpoint_position") == here).all()
    refused = made.ask("PSM1", "move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert refused[-1][0] == "refused" and "the base frame of PSM2 is not known here" in refused[-1][1]
    base = np.eye(4)
    base[0, 3] = 0.1
    for name in made.names:
        made.put(name, base if name == "PSM2" else np.eye(4))
    made.host.run(0.6)
    assert made.ask("PSM1", "move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0), seconds=2.0)[-1][0] == "done"
    made.host.close()


def test_on_boards_two_arms_meet_and_one_stays_away_from_the_other_whose_io_is_silent() -> None:
    text = Path("configs/systems/demo-hand-over.yaml").read_text()
    wall = f"  walls:\n    - {{name: apart, shape: arms, arms: [PSM1, PSM2], margin: {APART}}}\n"
    made = Pair(f"{text}\n{wall}", "emulated", "xboards")
    numbers = {name: made.clients[name].send("move_jp", (0.0, 0.0, 0.14, 0.0, 0.0, 0.0)) for name in made.names}
    made.host.run(4.0)
    assert -TRACKING < made.apart() < 1e-3
    for name, number in numbers.items():
        assert [reply.outcome for reply in made.clients[name].poll() if reply.id == number] == ["accepted", "failed"]
    begin = {name: made.state(name, "setpoint_position")[:6] for name in made.names}
    for share in np.linspace(0.0, 1.0, 200):  # both push against each other
        for name in made.names:
            made.clients[name].send("servo_jp", begin[name] + share * 0.03 * np.eye(6)[2])
        made.host.run(STEP_S)
        assert made.apart() > -TRACKING
    made.host.run(1.0)
    away = (0.2, 0.1, 0.1, 0.0, 0.0, 0.0)
    assert all(made.ask(name, "move_jp", away, seconds=3.0)[-1][0] == "done" for name in made.names), "leaving"
    here, far = made.state("PSM1", "setpoint_position"), made.wall("PSM1", "distance")[0]
    made.host.delay("IO2", 0.5)
    made.host.run(0.3)
    assert made.wall("PSM1", "distance")[0] < far - 0.2 and (made.state("PSM1", "setpoint_position") == here).all()
    refused = made.ask("PSM1", "move_jp", (0.0, 0.0, 0.14, 0.0, 0.0, 0.0))
    assert refused[-1][0] == "refused" and "PSM2, not measured for 0.3" in refused[-1][1]
    assert made.ask("PSM1", "move_jp", (0.2, 0.1, 0.08, 0.0, 0.0, 0.0))[-1][0] == "accepted"
    made.host.run(1.0)
    assert made.wall("PSM1", "distance")[0] > 0.0, "measured again"
    made.host.close()
