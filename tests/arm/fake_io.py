"""An io process as an arm sees it, on a fake clock: flags that follow commands, joints that follow setpoints."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_requests import PERSON, FakeReports, FakeRequest
from tests.guarded import FakeCell, Guarded
from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.context import ArmContext, ToolReading, no_other_arm
from trocar.procs.arm.other_arm import OtherArm
from trocar.procs.arm.psm.psm import PsmLogic
from trocar.procs.document.system import ArmConfig
from trocar.procs.io.arm_requests import DesiredCommand, DesiredProgress
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables import codes
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.desired_state import DESIRED_STATES, SETTINGS
from trocar.shm.mailbox.client import Reply
from trocar.shm.mailbox.guard import unauthorized
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import ARM_STATE, ARM_WALLS, IO_STATE, SETPOINT

AXES = 7
PERIOD_NS = 2_000_000
HURRIED_NS = 20_000_000
SECOND = 1_000_000_000


class View(dict[str, Any]):
    """A record by the names of its fields, each of which is resolved once."""

    def __init__(self, field: Callable[[str], Any]) -> None:
        super().__init__()
        self.field = field

    def __missing__(self, name: str) -> Any:
        view = self[name] = self.field(name)
        return view

    def set(self, name: str, value: Any) -> None:
        self[name][...] = value

    def text(self, name: str) -> str:
        return bytes(self[name].item()).decode()


class Record(View):
    """A record of the topic table without a ring."""

    def __init__(self, topic: Any, **dims: int) -> None:
        array = np.zeros(1, dtype=schema_of(topic, dims).dtype)
        super().__init__(lambda name: array[name].reshape(array[name].shape[1:]))


class FakeIo(Guarded):
    """Two robots, the arm's is the second one; behind the guard of its mailbox, and of what io does for arms."""

    def __init__(self, axes: int = AXES, inputs: int = 4, name: str = "PSM1") -> None:
        super().__init__("io", FakeCell())
        self.axes, self.name = axes, name
        self.record: View = Record(IO_STATE, axes=axes + 2, drives=axes + 2, robots=2, inputs=inputs, outputs=0)
        self._seen: tuple[View, View] | None = None
        self.stamp_ns = 0
        self.epoch = 1
        self.stall = ""
        """What its events say of a stall."""
        self.power_cycles, self.bias_cycles, self.read_cycles = 5, 20, 20
        self._now_ns = 0
        self.never_powers = self.never_biases = self.deaf = self.stuck = self.blind = False
        self.sent: list[tuple[str, tuple[float, ...]]] = []
        self.refuses: dict[str, str] = {}
        self.loses: dict[str, int] = {}
        self._replies: list[Reply] = []
        self._queue: list[tuple[int, str, tuple[float, ...]]] = []
        self._power_left = self._bias_left = 0
        self._looked_at: set[str] = set()  # commands that the newest desired states came to
        self._had_fault = False
        self.reader = f"{name}_dallas"
        self.memory, self.reading = "", ToolReading()
        self._read_left = 0
        self.record["position"][2:] = (0.1, -0.2, 0.05, 0.3, 0.1, -0.1, 0.2)[:axes]
        self.record["setpoint_position"][...] = self.record["position"]

    def flag(self, name: str, value: Any = None) -> Any:
        """Read or set a flag of the arm's robot."""
        if value is not None:
            self.record[name][1] = value
        return self.record[name].item(1)

    @property
    def position(self) -> Any:
        return self.record["position"][2:]

    @property
    def setpoint(self) -> Any:
        return self.record["setpoint_position"][2:]

    def send(self, name: str, values: Any, text: str) -> int:
        assert text == (self.reader if name == "trigger_read" else self.name)
        self.sent.append((name, tuple(values)))
        number = len(self.sent)
        if self.loses.get(name, 0) > 0:
            self.loses[name] -= 1
        elif self.lets_through(name, values, text):
            self._queue.append((number, name, tuple(values)))
        else:
            self._replies.append(Reply(number, "refused", self.refused[-1]))
        return number

    def poll(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies

    def void(self, reason: str = "") -> None:
        """A fault or a person came after the newest desired states."""
        self.flag("desired_void", True)
        self.flag("desired_refused", reason.encode())

    def drop_power(self) -> None:
        """What a watchdog or a supply does."""
        self.cell.fault()
        self.void()
        for name in ("powered", "amps_on", "pid_enabled"):
            self.flag(name, False)

    def restart(self) -> None:
        """kill -9 and a new process: no power, another epoch, the encoders keep counting."""
        self.drop_power()
        self.flag("power_requested", False)
        self.flag("fault", 0)
        self.epoch += 1

    def cycle(self, now_ns: int, setpoint: View) -> None:
        """One cycle: commands, power, bias, joint controller."""
        if self.deaf:
            return
        if self._seen is None or self._seen[0] is not self.record or self._seen[1] is not setpoint:
            self._see(setpoint)
        self._now_ns = now_ns
        for number, name, values in self._queue:
            if name in self.refuses:
                self._replies.append(Reply(number, "refused", self.refuses[name]))
            else:
                self._do(name, values)
                self._replies.append(Reply(number, "done", ""))
        self._queue.clear()
        self._look_at_desired_states(setpoint)
        self._power_and_bias()
        self._control(setpoint)
        self.stamp_ns = now_ns
        self._valid[...] = self._robot_valid[...] = not self.blind

    def _see(self, setpoint: View) -> None:
        """Find the parts of both records that each cycle needs."""
        record, axes = self.record, self.axes
        self._seen = record, setpoint
        self._valid, self._robot_valid = record["valid"], record["robot_valid"]
        self._fault, self._pid, self._void = record["fault"], record["pid_enabled"], record["desired_void"]
        self._generations = [(setpoint[tag], record[tag]) for tag in ("bias_generation", "pid_generation")]
        self._desired = [(setpoint[row.field], record[row.shown], row) for row in DESIRED_STATES]
        self._effort_mode, self._mode = record["effort_mode"][2:], setpoint["mode"]
        self._in_effort, self._wanted = setpoint["in_effort"][:axes], setpoint["position"][:axes]

    def _look_at_desired_states(self, setpoint: View) -> None:
        """Each that is not so is carried out, unless it is `refuses`d; of `loses` the record is overlooked."""
        has_fault = bool(self._fault.item(1))
        if has_fault and not self._had_fault:
            self.void()
        self._had_fault = has_fault
        generation = setpoint["desired_generation"].item()
        if generation not in (0, self.flag("desired_generation")):
            self.flag("desired_generation", generation)
            self.flag("desired_void", False)
            self.flag("desired_refused", b"")
            self._looked_at.clear()
        if not generation or self._void.item(1):
            return
        refused = ""
        for asked_for, shown, desired in self._desired:
            wanted = asked_for.item()
            if wanted and bool(shown.item(1)) is not (wanted == 2):
                origin = Origin(int(setpoint["desired_origin"]), int(setpoint["desired_since"]),
                                setpoint.text("desired_program"))
                name, values = desired.on if wanted == 2 else desired.off
                if self.loses.get(name, 0) > 0:
                    self.loses[name] -= 1
                    return
                if name not in self._looked_at:
                    self._looked_at.add(name)
                    self.sent.append((name, values))
                asked = DesiredCommand(self.name, (name, values), generation, origin, DesiredProgress(),
                                       lambda *said: None)
                if name in self.refuses:
                    refused = self.refuses[name]
                elif name not in SETTINGS and (
                        refused := unauthorized(asked.command, self.name, values, origin, self.cell)):
                    self.refused.append(f"{name} {values}: {refused}")
                else:
                    self._do(name, values)
        if refused or self.record["desired_refused"].item(1):
            self.flag("desired_refused", refused.encode())

    def _do(self, name: str, values: tuple[float, ...]) -> None:
        match name:
            case "power_on":
                if self.flag("fault") or self.flag("power_requested"):
                    return
                self.flag("power_requested", True)
                self._power_left = self.power_cycles
            case "power_off":
                self.flag("power_requested", False)
                for flag in ("powered", "amps_on", "pid_enabled"):
                    self.flag(flag, False)
            case "bias_encoders":
                self.flag("biasing", True)
                self._bias_left = self.bias_cycles
            case "pid_enable":
                if values[0] and not self.flag("pid_enabled"):
                    self.flag("pid_generation", self.flag("pid_generation") + 1)
                self.flag("pid_enabled", bool(values[0]))
            case "clear_fault":
                self.flag("fault", 0)
            case "trigger_read":
                self.reading, self._read_left = ToolReading("READING", "", self._now_ns), self.read_cycles
            case "brake_release" | "brake_engage":
                self.flag("brakes_released", name == "brake_release" and self.flag("pid_enabled"))
            case _:
                flags = {"enforce_limits": "limits_enforced", "tracking_check": "tracking_check",
                         "pot_check": "pot_check", "use_setpoint_v": "use_setpoint_velocity"}
                self.flag(flags[name], bool(values[0]))

    def _power_and_bias(self) -> None:
        if self._read_left:
            self._read_left -= 1
            if not self._read_left:
                self.reading = ToolReading("READ" if self.memory else "ABSENT", self.memory, self._now_ns)
        if self._power_left and not self.never_powers:
            self._power_left -= 1
            if not self._power_left and self.flag("power_requested"):
                self.flag("powered", True)
                self.flag("amps_on", True)
        if self._bias_left and not self.never_biases:
            self._bias_left -= 1
            if not self._bias_left:
                self.flag("biasing", False)
                self.flag("biased", True)
                self.flag("bias_generation", self.flag("bias_generation") + 1)

    def _control(self, setpoint: View) -> None:
        mine = self.setpoint
        if not self._pid.item(1):
            mine[...] = self.position
            return
        if self._mode.item() != 1 or any(tag.item() != own.item(1) for tag, own in self._generations):
            if self._effort_mode.any():  # what applied efforts is held where it is
                np.copyto(mine, self.position, where=self._effort_mode)
                self._effort_mode[...] = False
        else:
            self._effort_mode[...] = self._in_effort
            wanted = np.where(self._in_effort, self.position, self._wanted) if self._in_effort.any() else self._wanted
            if wanted.tobytes() != mine.tobytes():
                steps = np.abs(wanted - mine)
                steps[self._in_effort] = 0.0
                self.largest_step = max(self.largest_step, float(steps.max()))
                mine[...] = wanted
        if not self.stuck:
            self._move()

    def _move(self) -> None:
        self.position[...] = self.setpoint

    largest_step = 0.0


class ArmHarness:
    """An arm on a fake io and a fake clock."""

    def __init__(self, arm: ArmConfig | None = None, period_ns: int = PERIOD_NS, *, kind: type[ArmLogic] = PsmLogic,
                 inputs: dict[str, int] | None = None, has_brakes: bool = False,
                 other: Callable[[str], OtherArm] = no_other_arm) -> None:
        """`inputs`: places of io's digital inputs by name; `other`: see ArmContext."""
        self.document = arm or fixed_arm()
        self.period_ns, self._other = period_ns, other
        self.now_ns = 5 * SECOND
        self.kind, self.inputs, self.has_brakes = kind, inputs or {}, has_brakes
        self.io = self.make_io()
        self.state = Record(ARM_STATE)
        self.setpoint, self.walls = Record(SETPOINT), Record(ARM_WALLS)
        self.start_arm()

    def make_io(self) -> FakeIo:
        """The io of this arm."""
        return FakeIo(ARM_TYPES[self.document.type].actuators, name=self.document.robot)

    def start_arm(self, stall: str = "") -> None:
        """A new arm process on the records as they are, or the same one after a stall."""
        self.reports = FakeReports()
        self.arm = self.kind(self.document, ArmContext(
            self.io.record.field, 1, 2, self.inputs, self.has_brakes, self.io, self.state.field, self.setpoint.field,
            self.reports, lambda code: FaultReport(codes.IO_FAULT, f"fault number {code}"),
            gripper=0 if self.document.gripper else -1, reading=lambda: self.io.reading,
            io_stall=lambda since_ns: self.io.stall, walls=self.walls.field, stall=stall, other=self._other))

    def press(self, name: str, on: bool = True) -> None:
        """A digital input of io, from the next cycle on."""
        self.io.record["input"][self.inputs[name]] = on

    def step(self, *requests: FakeRequest) -> None:
        """One cycle of io, then one of the arm; a person knows of all faults."""
        self.now_ns += self.period_ns
        for request in requests:
            if request.origin is PERSON:
                request.origin = Origin(PERSON.id, self.io.cell.valid_from, PERSON.program)
        self.io.cycle(self.now_ns, self.setpoint)
        self.arm.step(self.now_ns, self.io.stamp_ns, self.io.epoch, requests)
        if self.arm.control.walls.show(self.arm.control.here, self.now_ns):
            self.arm.control.walls.answer()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * SECOND / self.period_ns)):
            self.step()

    def send(self, name: str, values: Any = (), text: str = "") -> FakeRequest:
        """One cycle with a command in it."""
        request = FakeRequest(name, values, text)
        self.step(request)
        return request

    def until(self, condition: Any, seconds: float = 60.0) -> float:
        """Let time pass until the condition holds; returns how long that took in s."""
        start = self.now_ns
        while not condition():
            assert self.now_ns - start < seconds * SECOND, f"not within {seconds} s; the arm is {self.arm.state}"
            self.step()
        return (self.now_ns - start) / SECOND

    def state_command(self, word: str) -> FakeRequest:
        return self.send("state_command", (), word)

    def reach(self, state: str) -> None:
        """Bring the arm to an internal state by the ordinary way."""
        if state == "DISABLED":
            self.run(0.1)
            return
        if state == "FAULT":
            self.reach("ENABLED")
            self.io.drop_power()
            self.until(lambda: self.arm.state == "FAULT")
            self.run(0.3)
            return
        if state == "PAUSED":
            self.reach("HOMED")
            self.state_command("pause")
            return
        self.run(0.1)
        self.state_command("enable")
        if state in ("POWERING", "ENABLED"):
            self.until(lambda: self.arm.state == state)
            return
        if state == "ENCODERS_BIASED":
            self.until(lambda: self.arm.state == "ENABLED")
            self.state_command("home")
            self.until(lambda: self.arm.state == "CALIBRATING_ENCODERS_FROM_POTS")
            self.state_command("enable")
        else:
            self.until(lambda: self.arm.state == "ENABLED")
            self.state_command("home")
        self.until(lambda: self.arm.state == state)

    def go(self, joints: Any) -> None:
        """Move there, and be there."""
        with self.hurried():
            move = self.send("move_jp", joints)
            self.until(lambda: move.outcomes[-1] != "accepted")
        assert move.outcomes[-1] == "done", move.replies
        self.run(0.02)

    @contextlib.contextmanager
    def hurried(self) -> Iterator[None]:
        """A way that is not what the test is about: in longer cycles, which are fewer."""
        usual, self.period_ns = self.period_ns, max(self.period_ns, HURRIED_NS)
        try:
            yield
        finally:
            self.period_ns = usual

    def homed(self) -> ArmHarness:
        """Homed, with the events so far forgotten."""
        with self.hurried():
            self.reach("HOMED")
            self.run(0.3)
        self.reports.events.clear()
        return self
