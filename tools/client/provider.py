"""The place of a user program in a running system: its records, and the commands to it."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trocar.procs.document.system import SystemConfig, ThirdParty
from trocar.procs.kinematics.poses import POSE, check_matrix, matrix_from_pose, normalised, pose_from_matrix
from trocar.procs.node.node import Node
from trocar.procs.tables import codes
from trocar.procs.tables.manifest import lost_s
from trocar.procs.user.process import UserLoop
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox_map import COMMANDS_DEPTH
from trocar.shm.mailbox.origins import SenderId
from trocar.shm.mailbox.received import Received
from trocar.shm.memory.closable import Closable
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools.client.here import asked_for, connected
from trocar.tools.client.instance import known_state
from trocar.tools.client.values import Array, numbers, six_numbers
from trocar.tools.inspect.watch import document_of
from trocar.tools.output.errors import PlaceTaken, Refused
from trocar.tools.systems.find import unknown

Process = UserLoop
KIND: Final = "third_party"
READY: Final = ("enable", "home")
HOLD, END = "hold", "end_stream"
PRESSED: Final = {True: ("pressed", 0.0), False: ("released", 1.0)}
CLICKED: Final = ("clicked", 2.0)
SLOWEST, FASTEST = 50.0, 2000.0  # records a second: none for 30 ms counts as disconnected
NOWHERE: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

Handler = Callable[[Array, str], object]
"""Executes a command, given its numbers and its text, and returns the answer; raises Refused or ValueError with the
reason for a refusal.
"""


class Provider(Closable):
    """One arm of a `_GENERIC` type, or the buttons of a console; a context manager, for one thread. Made by `provide`.

    Every `write` publishes a record; values that are not written again stay unchanged, except the pose. The place in
    the system is `process`: claims, commands, periods and pauses are those of any user process.
    """

    def __init__(self, process: UserLoop, commands: Mapping[str, Handler] | None = None, program: str = "") -> None:
        """`process` must not run yet. Problem: it provides no arm or buttons; ValueError: no such command."""
        document, name = process.node.document, process.name
        self.process, self.name, self.system = process, name, process.system
        self._place, self._handlers = _places(document, name)[name], _checked(name, commands or {})
        process.carries_out = self._carry_out
        self._leader: SenderId | None = None
        """Sender of the last executed command."""
        self._consoles = [process.node.waker_for(row.name) for row in document.consoles if row.is_wired_to(name)]
        self._unreported: list[tuple[str, str, float]] = []  # button events since the last record
        self._base = np.array(self._place.base_frame) if self._place.base_frame is not None else None
        for cells in self._fields.values():
            cells[...] = np.zeros((), cells.dtype)
        program = program or (Path(process.declared.module).stem if process.node.is_child else _program())
        self._set(program=program.encode()[:40], reference_frame=self._place.reference_frame.encode()[:24],
                  measured_cp=NOWHERE, setpoint_cp=NOWHERE, gripper_position=np.nan,
                  simulated="body/servo_cf" not in self._handlers, control_mode=1)
        self.set_state("ENABLED", homed=True)
        if not process.node.is_child:
            process.begin()
        self.now_ns = monotonic_ns()
        """Start of this cycle, monotonic."""
        process.status(f"{name} is now {program} (pid {os.getpid()})")

    @property
    def _fields(self) -> dict[str, NDArray[Any]]:
        return self.process.cells("state")

    @property
    def held_up_s(self) -> float:
        """Duration (s) of a stall before the last `tick` or `write`; 0: no significant stall."""
        return self.process.held_up_s

    # -- output --

    def write(self, pose: ArrayLike | None = None, twist: ArrayLike | None = None, *, gripper: float | None = None,
              setpoint: ArrayLike | None = None, jaw: float | None = None, joints: ArrayLike | None = None) -> None:
        """Publish the tip pose, and answer commands received meanwhile.

        `pose`: 4×4 or x y z qx qy qz qw in its own base (m); None: not known now. `twist`: linear (m/s), angular
        (rad/s), in axes of the base. `gripper` (rad) of a master. For a slave: `setpoint`, its goal pose (default: its
        present pose), `jaw` (rad) and `joints`, setpoints. ValueError for invalid values; then nothing is published.
        After a pause since the last `write` or `tick` the pose counts as unknown, see `held_up_s`.
        """
        values: dict[str, Any] = {"reference_valid": pose is not None}
        if pose is not None:
            values["measured_cp"] = self._in_reference(pose)
            values["setpoint_cp"] = values["measured_cp"] if setpoint is None else self._in_reference(setpoint)
        values["measured_cv"] = np.zeros(6) if twist is None else self._turned(_finite(six_numbers(twist, "a twist")))
        if gripper is not None:
            values |= {"gripper_valid": True, "gripper_position": _finite(numbers(gripper))[0]}
        if jaw is not None:
            values |= {"has_jaw": True, "jaw_setpoint_position": _finite(numbers(jaw))[0]}
        if joints is not None:
            values["setpoint_position"] = _padded(_finite(numbers(joints)), len(self._fields["setpoint_position"]))
        self.process.look_for_stall()
        self.serve()
        if self.held_up_s:  # where the tip was before that
            values["reference_valid"] = False
        self.process.beat()
        self.process.publish("state", **values)
        if self._unreported:
            self._report_buttons()

    def set_state(self, state: str, *, homed: bool = True, busy: bool = False, words: str = "") -> None:
        """Set DISABLED, ENABLED, PAUSED or FAULT from the next record on; `words`: a description of that state."""
        known_state(state)
        self._set(state=state.encode(), sub_state=(words or state).encode()[:40], is_homed=homed and state == "ENABLED",
                  is_busy=busy)

    def set_tool(self, name: str) -> None:
        """Set the name of the attached instrument."""
        self._set(tool=name.encode()[:40])

    @property
    def buttons(self) -> tuple[str, ...]:
        """The buttons that consoles read from this program."""
        return self._place.inputs

    def press(self, button: str, pressed: bool = True) -> None:
        """Report a button as pressed or released from the next record on."""
        cells, place = self._fields["input"], self._button(button)
        if bool(cells[place]) != pressed:
            cells[place] = pressed
            self._unreported.append((button, *PRESSED[pressed]))

    def click(self, button: str) -> None:
        """Report with the next record that a button was tapped: too short to count as pressed."""
        self._button(button)
        self._unreported.append((button, *CLICKED))

    def status(self, text: str) -> None:
        """Publish a status message for operators."""
        self.process.status(text)

    def error(self, text: str) -> None:
        """Report a failure; teleoperations that use this arm stop until an operator enables them again."""
        self.process.node.events.report(codes.THIRD_PARTY_ERROR, text, self.name)

    def _button(self, button: str) -> int:
        if button not in self._place.inputs:
            raise unknown("button", button, self._place.inputs)
        return self._place.inputs.index(button)

    def _report_buttons(self) -> None:
        """Events follow the record, and consoles read both at once."""
        for button, kind, value in self._unreported:
            self.process.node.events.emit("button", kind, code=kind, component=button, value=value)
        self._unreported.clear()
        for console in self._consoles:
            console.wake()

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            self._fields[name][...] = value

    def _in_reference(self, pose: ArrayLike) -> Array:
        given = np.asarray(pose, dtype=np.float64)
        if given.shape == (POSE,):
            given = matrix_from_pose(normalised(given))
        check_matrix(given)
        return pose_from_matrix(given if self._base is None else self._base @ given)

    def _turned(self, twist: Array) -> Array:
        return twist if self._base is None else (self._base[:3, :3] @ twist.reshape(2, 3).T).T.reshape(6)

    # -- commands --

    def serve(self) -> None:
        """Answer received commands: execute those with a handler, refuse the rest with a reason."""
        self.process.process_messages(COMMANDS_DEPTH)  # a teleoperation sends several a millisecond: take all there is

    def _carry_out(self, command: Received) -> object:
        name, is_own = command.name, command.sender == self._leader
        if name == END and name not in self._handlers:
            if not is_own or HOLD not in self._handlers:
                return None  # it is about another program's present action, or there is nothing to end
            name = HOLD
        if command.command.is_stop(command.text, command.values):
            who = command.origin.program or command.holder.program or "a program"
            self._set(stops=self._fields["stops"] + 1, stopped_by=f"{who} ({command.name})".encode()[:48])
        handler = self._handlers.get(name)
        try:
            if handler is not None:
                self._leader = command.sender
                return handler(command.values, command.text)
            self._by_itself(command)
        except (Refused, ValueError) as reason:
            raise ValueError(f"{command.name}: {reason}") from None
        return None

    def _by_itself(self, command: Received) -> None:
        ready = bool(self._fields["is_homed"]) and self._fields["state"].item() == b"ENABLED"
        if command.name == "state_command" and command.text in READY and ready:
            return
        what = f"{command.name} {command.text}".rstrip()
        raise Refused(f"{self.name} is {self._fields['program'].item().decode(errors='replace')}, a program that does "
                      f"not support {what}")

    # -- lifetime --

    def tick(self) -> bool:
        """End this cycle and wait for the next one, `rate` times a second; False: the system ends."""
        self.process.tick()
        self.now_ns = monotonic_ns()
        return self.alive()

    def alive(self) -> bool:
        """Whether the system is up and still needs this program."""
        node = self.process.node
        if node.stop_reason or node.silent_s > lost_s(node.document, simulated=False):
            return False
        return node.is_child or node.supervisor_state not in ("STOPPING", "STOPPED", "FAILED")

    def close(self) -> None:
        """Stop providing it; teleoperations that use it stop. In a process of the system, no effect until it ends."""
        if not self.process.node.is_child:
            self.process.node.page.show("STOPPED")
            self.process.node.close()


def provide(name: str | UserLoop, system: str | None = None, timeout: float = 5.0, *, rate: float = 200.0,
            commands: Mapping[str, Handler] | None = None, program: str = "") -> Provider:
    """Provide the arm `name` of a _GENERIC type, or a console's buttons, in a running system; see Provider.

    A process declared with this name in the system file calls this in its `setup`, with itself as `name`.

    `rate`: records a second, kept by `tick`. `commands`: its command handlers, by name. `program`: its name.
    TimeoutError after `timeout` s if there is no such arm or console; Problem at once if another program provides it.
    """
    if isinstance(name, UserLoop):
        return Provider(name, commands, program)
    return connected(lambda: taken(asked_for(system), name, rate, commands, program), timeout, name)


def taken(system: str, name: str, rate: float, commands: Mapping[str, Handler] | None, program: str) -> Provider:
    """A place for this program; Problem if there is none of this name, PlaceTaken if another program has it."""
    _checked(name, commands or {})
    if not SLOWEST <= rate <= FASTEST:
        raise ValueError(f"{name}: rate {rate:g} per second; allowed: {SLOWEST:g} to {FASTEST:g}")
    _places(document := document_of(system), name)
    _check_free(system, name)
    node = Node(document, name, period_s=1.0 / rate)
    try:
        return Provider(UserLoop(node), commands, program)
    except BaseException:
        node.close()
        raise


def _check_free(system: str, name: str) -> None:
    """PlaceTaken names the program that has the place."""
    with contextlib.closing(ControlPage(system, name)) as page:
        first = page.segment.identity()
        if not page.segment.claimed():
            return
    reader = directory.reader(system, name, "state")
    try:
        known = reader.field("program").item().decode(errors="replace") if reader.newest() else ""
    finally:
        reader.close()
    raise PlaceTaken(f"{name}: {f'program {known}' if known else 'a program'} (pid {first.pid}) has this place "
                     f"already; end it first: kill {first.pid}")


def _places(document: SystemConfig, name: str) -> dict[str, ThirdParty]:
    """All there are, this one among them."""
    places = {row.name: row for row in document.third_parties}
    if name not in places:
        raise unknown("place for your own program", name, places)
    return places


def _program() -> str:
    name = Path(sys.argv[0]).name
    return name if name[:1] not in ("", "-") else "python"


def _checked(name: str, commands: Mapping[str, Handler]) -> dict[str, Handler]:
    """The handlers; ValueError for a command that there is not."""
    strange = set(commands) - {row.name for row in COMMANDS[KIND]}
    if strange:
        raise ValueError(f"{name}: there is no command {', '.join(sorted(strange))}")
    return dict(commands)


def _finite(values: Array) -> Array:
    if not np.isfinite(values).all():
        raise ValueError(f"{values.tolist()} must be finite numbers")
    return values


def _padded(values: Array, room: int) -> Array:
    if len(values) > room:
        raise ValueError(f"{len(values)} joints; allowed: up to {room}")
    return np.pad(values, (0, room - len(values)))
