"""A teleoperation that follows, by native code and by Python alone: the same commands and records, whatever happens."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_requests import FakeRequest
from tests.host.hosted import document
from tests.native.shadow import bits
from tests.teleop.harness import JAW, NO_JAW, SMALL_JAW, FakeTeleopRing, Reports
from trocar.procs.document.consoles import TeleopPsmConfig as PsmSettings
from trocar.procs.host.host import Host
from trocar.procs.kinematics.poses import product
from trocar.procs.native.library import native
from trocar.procs.node.inputs import FOR_EVER_NS, Input
from trocar.procs.teleop.arms import BaseFrame, Operator, TeleopArm
from trocar.procs.teleop.psm import TeleopPsm
from trocar.procs.teleop.record import TeleopRecord
from trocar.procs.teleop.steady import SteadyFollowing, steady_following
from trocar.procs.teleop.teleop import TeleopContext
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.generations import FaultCell, Faults, Watched, create_faults
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.mailbox.origins import Origin
from trocar.shm.mailbox.received import DONE, REFUSED
from trocar.shm.memory import private
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.operator_topics import CONSOLE_STATE, TELEOP_STATE
from trocar.shm.ring.ring import HEAD
from trocar.shm.system import directory
from trocar.shm.topics import ARM_STATE, EVENTS
from trocar.tools.bench.measuring import home_all
from trocar.tools.examples.operator_sim import OperatorSim

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

MS = 1_000_000
ARMS = ("MTMR", "PSM1")
FIELDS = [field.name for field in TELEOP_STATE.fields]
PERSONS = (*((("state_command", (), "enable"),) * 6), ("state_command", (), "disable"),
           ("clutch", (1.0,), ""), ("clutch", (0.0,), ""), ("clutch", (0.0,), ""), ("set_scale", (0.5,), ""),
           ("set_scale", (0.0,), ""), ("lock_rotation", (1.0,), ""), ("lock_rotation", (0.0,), ""),
           ("lock_translation", (1.0,), ""), ("lock_translation", (0.0,), ""), ("set_align_MTM", (0.0,), ""),
           ("following/mtm/body/servo_cf", (0.1,) * 6, ""), ("dance", (), ""))
TEXTS = ("", "", "clipped: jaw", "at its limit: jaw", "clipped: yaw", "hm")
KINDS: dict[str, dict[str, Any]] = {
    "plain": {}, "turning": {"use_mtm_angular_velocity": True, "use_mtm_linear_velocity": False, "scale": 0.4},
    "carried": {"use_mtm_linear_velocity": True, "jaw_rate": 3.0, "gripper_zero": 0.1},
    "without_jaw": {"ignore_jaw": True, "mtm_is_haptic": False, "align_mtm": False}}


class OneTeleop:
    """One of both, with readers and places of its own."""

    def __init__(self, system: str, number: int, kind: str, is_over: Callable[[], bool]) -> None:
        self.held = contextlib.ExitStack()

        def input_of(name: str) -> Input:
            return Input(self.hold(directory.reader(system, name, "state")))

        arms = [TeleopArm(name, input_of(name), self.hold(directory.reader(system, name, "events")),
                          self.hold(LoopClient(system, name, f"one{number}", is_over)), is_master=name == "MTMR")
                for name in ARMS]
        self.record, self.reports = FakeTeleopRing(TELEOP_STATE), Reports()
        settings = PsmSettings("MTMR_PSM1", *ARMS, 0.001, "console", **{"start_gripper_threshold": 0.0, **KINDS[kind]})
        base = BaseFrame("ECM", input_of("ECM")) if kind == "carried" else None
        own = TeleopRecord(self.record.field, "PSM", ("MTMR",), "PSM1", "console")
        faults = Watched(self.hold(Faults(system)), ARMS)
        context = TeleopContext(Operator("console", input_of("console")), own, self.reports, faults)
        self.teleop = TeleopPsm(settings, arms[0], arms[1], context,
                                {b"LND": JAW, "LND": JAW, "SMALL": SMALL_JAW, "HOOK": NO_JAW}.get, base)

    def hold(self, part: Any) -> Any:
        self.held.callback(part.close)
        return part


class BothFollow:
    """The same arms, console and persons for both."""

    def __init__(self, system: str, kind: str, seed: int) -> None:
        private.keep(system)
        self.system, self.rng, self.now_ns = system, np.random.default_rng(seed), 5_000 * MS
        for name in (*ARMS, "ECM"):
            directory.create_ring(system, name, ARM_STATE, {}, {})
            directory.create_ring(system, name, EVENTS, {}, {})
            create_mailbox(system, name, "arm", COMMANDS["arm"])
        directory.create_ring(system, "console", CONSOLE_STATE, {"teleops": 1}, {})
        create_faults(system, ARMS)
        self.held = contextlib.ExitStack()
        self.writers = {name: self.hold(directory.writer(system, name, "state", None))
                        for name in (*ARMS, "ECM", "console")}
        self.events = {name: self.hold(directory.writer(system, name, "events", None)) for name in ARMS}
        self.boxes = {name: self.hold(Mailbox(system, name, COMMANDS["arm"])) for name in ARMS}
        self.faults = self.hold(Faults(system, write=True))
        self.cell = FaultCell(self.faults, "PSM1")
        for name in (*ARMS, "ECM"):
            self.set(name, state=b"ENABLED", sub_state=b"HOMED", is_homed=True, reference_valid=True, control_mode=1,
                     has_jaw=True, gripper_valid=True, tool=b"LND", simulated=True, gripper_position=0.3,
                     base_frame=(0, 0, 0, 0, 0, 0, 1), measured_cp=(0, 0, 0, 0, 0, 0, 1),
                     setpoint_cp=(0, 0, 0, 0, 0, 0, 1))
        self.set("console", valid=True, operator_present=True)
        self.publish(())
        self.is_over, self.deaf, self.refused, self.refusals = False, 0, "", np.random.default_rng(seed)
        self.ones = [OneTeleop(system, number, kind, lambda: self.is_over) for number in range(2)]
        made = steady_following(self.ones[0].teleop, lambda: 0 if self.is_over else FOR_EVER_NS)
        assert isinstance(made, SteadyFollowing)
        self.steady, self.count, self.back = made, 0, lambda: None

    def hold(self, part: Any) -> Any:
        self.held.callback(part.close)
        return part

    def set(self, name: str, **values: Any) -> None:
        for field, value in values.items():
            self.writers[name].field(field)[...] = value

    def publish(self, silent: tuple[str, ...]) -> None:
        for name, writer in self.writers.items():
            if name not in silent and self.rng.random() < 0.8:
                writer.publish(self.now_ns - 300_000)

    def move(self) -> None:
        """A hand moves the master, someone the base; the slave goes where it was asked to go."""
        rng = self.rng
        for name in ("MTMR", "ECM"):
            pose = self.writers[name].field("measured_cp")
            turn = (*rng.normal(0.0, 0.003, 3).tolist(), 1.0)
            quaternion = np.array(product(pose[3:].tolist(), turn))
            pose[3:] = quaternion / np.linalg.norm(quaternion)
            pose[:3] += rng.normal(0.0, 0.0005, 3)
            self.set(name, setpoint_cp=pose)
        grip = self.writers["MTMR"].field("gripper_position")
        grip[...] = np.clip(grip + rng.normal(0.0, 0.05), -0.5, 1.3)
        self.set("MTMR", measured_cv=rng.normal(0.0, 0.1, 6))

    def mishap(self) -> None:
        """Something that Python has to look at; over after a while."""
        self.back()
        rng, name = self.rng, str(self.rng.choice(ARMS))
        choices: list[dict[str, Any]] = [
            {"state": b"FAULT"}, {"is_homed": False}, {"sub_state": b"MANUAL"}, {"reference_valid": False},
            {"tool": b"SMALL"}, {"has_jaw": False}, {"gripper_valid": False}, {"measured_cp": math.nan},
            {"base_frame": (0.001, 0, 0, 0, 0, 0, 1)}, {"base_frame": (0.1, 0, 0, 0, 0, 0, 1)},
            {"stops": int(self.writers[name].field("stops")) + 1, "stopped_by": b"play"}, {"control_mode": 3},
            {"simulated": False}, {"measured_cv": 3.0}]
        chosen: dict[str, Any] = choices[rng.integers(len(choices))]
        before = {field: self.writers[name].field(field).copy() for field in chosen}
        self.back = lambda: self.set(name, **{field: value for field, value in before.items() if field != "stops"})
        which = rng.random()
        if which < 0.6:
            self.set(name, **chosen)
        elif which < 0.7:
            self.set("console", **{str(rng.choice(("valid", "operator_present", "clutch"))): bool(rng.integers(2))})
            self.back = lambda: self.set("console", valid=True, operator_present=True, clutch=False)
        elif which < 0.75:
            self.cell.fault()
        elif which < 0.85:
            self.events[name].field("severity")[...] = rng.integers(1, 4)
            self.events[name].field("text")[...] = b"something"
            self.events[name].publish(self.now_ns)
        elif which < 0.9:
            self.spoil(name)
        else:
            self.writers[name].publish(self.now_ns - 300_000)  # by its successor
            self.writers[name].close()
            self.writers[name] = self.hold(directory.writer(self.system, name, "state", None))

    def answer(self, name: str) -> list[list[Any]]:
        """Take the commands of both, and answer both alike."""
        found: dict[int, list[Any]] = {}
        outcome = REFUSED if self.rng.random() < 0.0005 else DONE
        some = self.refusals
        refused = str(some.choice(("servo_cp", "jaw/servo_jp"))) if some.random() < 0.0005 else self.refused
        text = str(self.rng.choice(TEXTS)) if self.rng.random() < 0.02 else ""
        for received in self.boxes[name].drain(0):
            found.setdefault(received.place, []).append(
                (received.name, received.values.tobytes(), received.text, received.origin))
            self.boxes[name].answer(received.place, received.id, REFUSED if received.name == refused else outcome, text)
            if name == "PSM1" and received.place and received.name == "servo_cp":
                self.set(name, setpoint_cp=received.values[:7], measured_cp=received.values[:7])
            if name == "PSM1" and received.place and received.name == "jaw/servo_jp":
                self.set(name, jaw_setpoint_position=received.values[0])
        return [found.get(place, []) for place in range(2)]

    def follow(self) -> None:
        """Step until native code does a cycle."""
        before = self.count
        while self.count == before:
            self.cycle()

    def step(self) -> bool:
        """A cycle in which nothing else happens; whether it is by native code. Both answer alike."""
        self.now_ns += MS
        is_native = self.steady.go_on(self.now_ns)
        if not is_native:
            self.steady.leave()
            self.ones[0].teleop.step(self.now_ns, ())
            self.steady.enter()
        self.ones[1].teleop.step(self.now_ns, ())
        self.compare()
        return is_native

    def spoil(self, name: str) -> None:
        """Make the newest record of a ring one that is not whole."""
        with Segment(segment_name(self.system, name, "state"), write=True) as hand:
            words, header = hand.words(), hand.header
            words[(header.first + words[HEAD] % header.depth * header.stride) // 8] = 0
            words.release()

    def cycle(self) -> None:
        rng = self.rng
        self.now_ns += int(rng.choice((*(MS,) * 20, 2 * MS, 10 * MS, 29 * MS)))
        self.move()
        self.is_over = rng.random() < 0.01  # it stalled
        self.deaf = self.deaf - 1 if rng.random() > 0.003 else 40  # arms take no commands
        if rng.random() < 0.01:
            self.mishap()
        elif rng.random() < 0.1:
            self.back()
        silent = ARMS if rng.random() < 0.02 else ()
        for _ in range(rng.integers(3)):
            self.publish(silent)
        requests: list[list[FakeRequest]] = [[], []]
        is_off = self.ones[1].teleop.is_idle
        if rng.random() < (0.2 if is_off else 0.02):
            name, values, text = PERSONS[0 if is_off else rng.integers(len(PERSONS))]
            origin = Origin(self.now_ns, self.faults.generation(), "play")
            requests = [[FakeRequest(name, values, text, kind="teleop", origin=origin)] for _ in range(2)]
        if requests[0] or not self.steady.go_on(self.now_ns):
            self.steady.leave()
            self.ones[0].teleop.step(self.now_ns, requests[0])
            self.steady.enter()
        else:
            self.count += 1
        self.ones[1].teleop.step(self.now_ns, requests[1])
        self.compare()

    def compare(self) -> None:
        one, other = self.ones
        for name in ARMS if self.deaf <= 0 else ():
            quick, slow = self.answer(name)
            assert quick == slow, name
        for name in FIELDS:
            assert np.array_equal(bits(one.record.field(name)), bits(other.record.field(name))), name
        assert one.reports.log == other.reports.log

    def close(self) -> None:
        for one in self.ones:
            one.held.close()
        self.held.close()
        private.forget(self.system)


@pytest.mark.slow
def test_a_loop_that_follows_calls_its_teleoperation_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with Host(document("kinematic-teleop.yaml")) as host, host.passing():
        home_all(host.name)
        with OperatorSim(host.name, "console") as seat:
            seat.begin()
            seat.wait()
            loop: Any = host.loops[seat.teleops[0].name]
            host.run(0.1)
            asked: list[Any] = []
            monkeypatch.setattr(loop.teleop, "step", lambda *given: asked.append(given))
            host.run(0.5)
            assert asked == [] and seat.teleops[0].is_following


@pytest.fixture
def both(world: Any, request: pytest.FixtureRequest) -> Iterator[BothFollow]:
    made = BothFollow(world.name, *request.param)
    yield made
    made.close()


@pytest.mark.parametrize("both", [(kind, 7) for kind in KINDS], indirect=True)
def test_both_begin_alike(both: BothFollow) -> None:
    for _ in range(200):
        both.cycle()
    assert both.count > 40, "hardly any cycle was by native code"


@pytest.mark.parametrize("both", [(kind, seed) for kind in KINDS for seed in range(2)], indirect=True)
@pytest.mark.slow
def test_both_come_to_the_same_in_every_cycle(both: BothFollow) -> None:
    for _ in range(1500):
        both.cycle()
    assert both.count > 150, "hardly any cycle was by native code"


@pytest.mark.parametrize("both", [("plain", 7)], indirect=True)
@pytest.mark.parametrize("refused", ["servo_cp", "jaw/servo_jp"])
def test_a_refusal_is_that_of_the_goal_or_of_the_jaw(both: BothFollow, refused: str) -> None:
    both.follow()
    slaves = [one.teleop.slave for one in both.ones]
    for grip in range(20):
        for name, writer in both.writers.items():
            both.set("MTMR", gripper_position=0.1 * (grip % 2))
            assert writer.publish(both.now_ns + MS), name
        both.refused = refused if grip == 10 else ""
        is_native = both.step()
        assert grip < 5 or grip > 10 or is_native
        assert slaves[0].refuses_goals is slaves[1].refuses_goals
        if grip == 11:
            assert slaves[0].refuses_goals is (refused == "servo_cp")


@pytest.mark.parametrize("both", [("plain", 7)], indirect=True)
def test_an_operator_who_left_in_a_record_that_was_not_whole_is_absent_in_the_next(both: BothFollow) -> None:
    both.follow()
    for writer in both.writers.values():
        writer.publish(both.now_ns)
    while not both.step():
        pass
    both.set("console", operator_present=False)
    both.writers["console"].publish(both.now_ns)
    both.spoil("console")
    both.step()
    for writer in both.writers.values():
        writer.publish(both.now_ns)
    both.step()
    assert not any(one.teleop.following for one in both.ones)
