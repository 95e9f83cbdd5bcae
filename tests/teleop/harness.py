"""Arms, a console and a clock that a test writes, around one teleoperation."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tests.arm.fake_requests import FakeRequest
from tests.guarded import objection
from trocar.procs.document.consoles import TeleopEcmConfig as EcmSettings
from trocar.procs.document.consoles import TeleopPsmConfig as PsmSettings
from trocar.procs.kinematics.poses import angle_between, matrix_from_pose, pose_from_matrix
from trocar.procs.node.inputs import Input
from trocar.procs.tables.code_row import Code
from trocar.procs.teleop.arms import BaseFrame, Operator, TeleopArm
from trocar.procs.teleop.ecm import TeleopEcm
from trocar.procs.teleop.psm import TeleopPsm
from trocar.procs.teleop.record import TeleopRecord
from trocar.procs.teleop.teleop import Teleop, TeleopContext
from trocar.shm.mailbox.generations import NoFaults
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.memory.layout import schema_of
from trocar.shm.operator_topics import CONSOLE_STATE, TELEOP_STATE
from trocar.shm.system.events import SEVERITIES
from trocar.shm.topics import ARM_STATE, EVENTS, SUJ_STATE

PERIOD_NS = 1_000_000
STEP_M, STEP_RAD = 0.001, 0.02  # of a move, or a hand, in one cycle
SECOND = 1_000_000_000
JAW = (math.radians(-40.0), math.radians(80.0))
SMALL_JAW = (0.0, math.radians(30.0))
NO_JAW = (math.radians(-20.0), 0.0)
EXACT = {"start_orientation_tolerance": math.radians(5.0), "start_gripper_threshold": math.radians(40.0),
         "start_roll_threshold": math.radians(4.0), "jaw_rate": 4.0 * math.pi, "jaw_rate_after_clutch": 0.2 * math.pi,
         "gripper_max": math.radians(60.0)}
"""The usual settings, which files have to seven digits."""


class FakeTeleopRing:
    """A ring that a test writes: what it holds is the newest record."""

    def __init__(self, topic: Any, **dims: int) -> None:
        self._record: Any = np.zeros(1, dtype=schema_of(topic, dims).dtype)
        self.stamp_ns, self.epoch, self.torn = 0, 1, False
        self.waiting: list[dict[str, Any]] = []

    def field(self, name: str) -> Any:
        return self._record[name].reshape(self._record[name].shape[1:])

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            self.field(name)[...] = value

    def newest(self) -> bool:
        return self.stamp_ns > 0 and not self.torn

    def next(self) -> bool:
        if not self.waiting:
            return False
        self.set(**self.waiting.pop(0))
        return True


@dataclasses.dataclass
class Answer:
    id: int
    outcome: str
    text: str = ""


class FakeTeleopArm:
    """An arm that does at once what it is asked for, but for moves, and remembers it."""

    def __init__(self, name: str) -> None:
        self.name, self.ring, self.events = name, FakeTeleopRing(ARM_STATE), FakeTeleopRing(EVENTS)
        self.sent: list[tuple[str, tuple[float, ...], str]] = []
        self.answers: list[Answer] = []
        self.origins: list[Origin] = []
        self.origin = NO_ORIGIN
        self.alive, self.obeys = True, True
        self.valid_from = 0
        """Commands of an earlier fault generation count for nothing."""
        self.refuses: dict[str, str] = {}
        self.says: dict[str, str] = {}
        self.ring.set(state=b"ENABLED", sub_state=b"HOMED", is_homed=True, reference_valid=True, cartesian_valid=True,
                      valid=True, control_mode=1, has_jaw=True, gripper_valid=True, tool=b"LND",
                      base_frame=(0, 0, 0, 0, 0, 0, 1))
        self.pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        self._goal: tuple[int, np.ndarray] | None = None

    @property
    def pose(self) -> np.ndarray:
        return self.ring.field("measured_cp").copy()

    @pose.setter
    def pose(self, pose: Any) -> None:
        self.ring.set(measured_cp=pose, setpoint_cp=pose)

    def shift(self, *by: float) -> None:
        self.pose = self.pose + (*by, 0, 0, 0, 0)

    def turn(self, axis: int, angle: float) -> None:
        """About an axis of its reference frame."""
        matrix, (a, b) = matrix_from_pose(self.pose), [i for i in range(3) if i != axis]
        turn = np.eye(4)
        c, s = math.cos(angle), math.sin(angle) * (1 if axis != 1 else -1)
        turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
        moved = turn @ matrix
        moved[:3, 3] = matrix[:3, 3]
        self.pose = pose_from_matrix(moved)

    def fail(self, text: str, code: str = "") -> None:
        self.events.waiting.append({"severity": 3, "text": text.encode(), "code": code.encode()})

    def on_behalf(self, origin: Origin) -> None:
        self.origins.append(origin)
        self.origin = origin

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        self.sent.append((name, tuple(float(v) for v in values), text))
        number = len(self.sent)
        reason = objection("arm", name, values, text, self.origin, self.valid_from) or self.refuses.get(name, "")
        if reason:
            self.answers.append(Answer(number, "refused", reason))
            return number
        if self.obeys and name == "move_cp":
            self._goal = number, np.array(values)
            self.answers.append(Answer(number, "accepted"))
            self.ring.set(control_mode=1)
            self.advance()
            return number
        if self.obeys:
            self._do(name, values, text)
        self.answers.append(Answer(number, "done", self.says.get(name, "")))
        return number

    def advance(self) -> None:
        """A cycle of the move that is under way."""
        if self._goal is None:
            return
        number, goal = self._goal
        here = self.pose
        left = max(math.dist(goal[:3], here[:3]) / STEP_M, angle_between(here, goal) / STEP_RAD)
        if left <= 1.0:
            self._goal = None
            self.pose = goal
            self.answers.append(Answer(number, "done", self.says.get("move_cp", "")))
            return
        near = goal if here[3:] @ goal[3:] >= 0.0 else np.append(goal[:3], -goal[3:])
        on_way = here + (near - here) / left
        self.pose = np.append(on_way[:3], on_way[3:] / np.linalg.norm(on_way[3:]))

    def stop(self, program: str) -> None:
        """A program has it hold."""
        self._goal = None
        self.ring.set(control_mode=1, stops=self.ring.field("stops") + 1, stopped_by=f"{program} (hold)".encode())

    def _do(self, name: str, values: Any, text: str) -> None:
        if name != "use_gravity_compensation":
            self._goal = None
        if name == "servo_cp":
            self.pose = np.array(values[:7])
            self.ring.set(control_mode=1)
        elif name == "jaw/servo_jp":
            self.ring.set(jaw_setpoint_position=values[0])
        elif name == "servo_jp":
            self.ring.field("setpoint_position")[: len(values)] = values
        elif name == "body/servo_cf":
            self.ring.set(control_mode=3)
        elif name == "end_stream":
            self.ring.set(control_mode=1)
        elif name == "state_command" and text == "enable":
            self.ring.set(state=b"ENABLED", sub_state=b"ENABLED")
        elif name == "state_command" and text == "home":
            self.ring.set(is_homed=True, sub_state=b"HOMED")

    def poll(self) -> list[Answer]:
        answers, self.answers = self.answers, []
        return answers

    def asked(self, *names: str) -> list[tuple[str, tuple[float, ...], str]]:
        return [one for one in self.sent if one[0] in names]

    def words(self) -> list[str]:
        return [text or name for name, _, text in self.sent]

    def seen(self, *, is_master: bool = False) -> TeleopArm:
        self.origin = NO_ORIGIN  # a handle of a new process
        return TeleopArm(self.name, Input(self.ring), self.events, self, is_master=is_master)


class Reports:
    def __init__(self) -> None:
        self.reported: list[tuple[str, str]] = []
        self.log: list[str] = []
        """All of it, on a line each."""

    def status(self, text: str, component: str = "") -> None:
        self.reported.append(("status", text))
        self.log.append(f"status of {component}: {text}")

    def report(self, code: Code, text: str, component: str = "") -> None:
        self.reported.append((SEVERITIES[code.severity], text))
        self.log.append(f"{code.code} of {component}: {text}")

    def emit(self, event: str, text: str = "", *, value: float = math.nan) -> None:
        self.reported.append((event, str(text) if text else str(value)))
        self.log.append(" ".join((event, *self.reported[-1][1:])))

    def of(self, kind: str) -> list[str]:
        return [text for reported, text in self.reported if reported == kind]


class TeleopHarness:
    """One teleoperation and everything around it; a PSM's unless `make_teleop` says something else."""

    names = ("MTMR", "PSM1")

    def __init__(self, *, console: bool = True, base: bool = False, setup: int | None = None, **settings: Any) -> None:
        """`base`: an ECM carries the slave; `setup`: the setup arm of that place does."""
        self.now_ns = 5 * SECOND
        self.arms = {name: FakeTeleopArm(name) for name in self.names}
        self.console = FakeTeleopRing(CONSOLE_STATE, teleops=1) if console else None
        self.console_alive = True
        if self.console is not None:
            self.console.set(valid=True, operator_present=True)
        self.setup = setup
        self.base = FakeTeleopRing(ARM_STATE) if base else None
        if self.base is None and setup is not None:
            self.base = FakeTeleopRing(SUJ_STATE, setups=setup + 1)
        self.settings, self.faults = settings, NoFaults()
        self.start()

    def start(self, left: FakeTeleopRing | None = None) -> None:
        """A new process on a record as its predecessor `left` it, or an empty one."""
        self.reports, self.record = Reports(), left or FakeTeleopRing(TELEOP_STATE)
        self.teleop = self.make_teleop(Operator("console", self.console and Input(self.console)))

    def make_teleop(self, operator: Operator) -> Teleop:
        values: dict[str, Any] = {"start_gripper_threshold": 0.0, **self.settings}
        record = TeleopRecord(self.record.field, "PSM", ("MTMR",), "PSM1", "console")
        range_of: Callable[[str], tuple[float, float] | None] = {"LND": JAW, "SMALL": SMALL_JAW, "HOOK": NO_JAW}.get
        carrier = "ECM" if self.setup is None else "SUJ"
        return TeleopPsm(PsmSettings("MTMR_PSM1", "MTMR", "PSM1", 0.001, "console", **{**EXACT, **values}),
                         self.master.seen(is_master=True), self.slave.seen(),
                         TeleopContext(operator, record, self.reports, self.faults), range_of,
                         BaseFrame(carrier, Input(self.base), self.setup) if self.base else None)

    @property
    def master(self) -> FakeTeleopArm:
        return self.arms[self.names[0]]

    @property
    def slave(self) -> FakeTeleopArm:
        return self.arms[self.names[-1]]

    def step(self, *requests: FakeRequest) -> None:
        self.now_ns += PERIOD_NS
        for arm in self.arms.values():
            arm.advance()
            if arm.alive:
                arm.ring.stamp_ns = self.now_ns - 300_000
        if self.console is not None and self.console_alive:
            self.console.stamp_ns = self.now_ns - 5_000_000
        if self.base is not None:
            self.base.stamp_ns = self.now_ns
        self.teleop.step(self.now_ns, requests)

    def lead(self, *by: float, turn: float = 0.0, axis: int = 0, of: Sequence[str] = ()) -> None:
        """A hand leads all masters, or those of these names, no faster than hands do."""
        cycles = math.ceil(max(math.hypot(*by) / STEP_M, abs(turn) / STEP_RAD))
        for _ in range(cycles):
            for name in of or self.names[:-1]:
                self.arms[name].shift(*(each / cycles for each in (by or (0.0, 0.0, 0.0))))
                self.arms[name].turn(axis, turn / cycles)
            self.step()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * SECOND / PERIOD_NS)):
            self.step()

    def send(self, name: str, *values: float, text: str = "") -> FakeRequest:
        request = FakeRequest(name, values, text, kind="teleop")
        self.step(request)
        return request

    def state_command(self, word: str) -> FakeRequest:
        return self.send("state_command", text=word)

    def text(self, name: str) -> str:
        return bytes(self.record.field(name).item()).decode()

    @property
    def following(self) -> bool:
        return bool(self.record.field("following"))

    def follow(self) -> Any:
        """Enabled and following; what was sent and said until then is forgotten."""
        self.state_command("enable")
        for _ in range(20):
            self.step()
        assert self.following, self.text("reason")
        self.forget()
        return self

    def forget(self) -> None:
        for arm in self.arms.values():
            arm.sent.clear()
        self.reports.reported.clear()
        self.reports.log.clear()


class EcmHarness(TeleopHarness):
    """Two masters and an ECM."""

    names = ("MTML", "MTMR", "ECM")

    def make_teleop(self, operator: Operator) -> Teleop:
        self.arms["MTML"].pose = (0.15, -0.05, 0.40, 0, 0, 0, 1)
        self.arms["MTMR"].pose = (-0.15, -0.05, 0.40, 0, 0, 0, 1)
        self.slave.ring.field("setpoint_position")[:4] = (0.0, 0.0, 0.12, 0.0)
        record = TeleopRecord(self.record.field, "ECM", ("MTML", "MTMR"), "ECM", "console")
        left, right, slave = (arm.seen(is_master=arm is not self.slave) for arm in self.arms.values())
        settings = EcmSettings("MTML_MTMR_ECM", "MTML", "MTMR", "ECM", 0.001, "console", **self.settings)
        return TeleopEcm(settings, left, right, slave, TeleopContext(operator, record, self.reports, self.faults))
