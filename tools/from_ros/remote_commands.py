"""Commands of this system to an arm on ROS: each becomes a message on the arm's topic of that name.

ROS has no answers. A command counts as done when its message is published; a move or a change of state when the arm
shows its end. Streams are arbitrated here (procs/node/streams.py), because for the arm all programs of this system are
one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np

from trocar.procs.document.arms import ThirdParty
from trocar.procs.kinematics.poses import Array, inverse, matrix_from_pose, normalised, pose_from_matrix
from trocar.procs.node.streams import StreamKind, Streams
from trocar.procs.ros_messages.command_messages import MESSAGES
from trocar.procs.ros_messages.dds import Participant, TopicWriter
from trocar.procs.ros_messages.messages import time_of
from trocar.procs.user.process import UserLoop
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import JOINTS, CommandRow
from trocar.shm.mailbox.received import Received
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.tools.client.provider import KIND, Handler
from trocar.tools.from_ros.remote_arm import RemoteArm
from trocar.tools.output.errors import Refused

WAIT_NS: Final = 60_000_000_000
"""A move or a change of state that shows no end after this long has failed."""
SECOND_NS: Final = 1_000_000_000
ABSOLUTE: Final = ("servo_cp", "move_cp")
"""Commands whose numbers are a pose: a base frame of the system file is taken off."""
WRENCH: Final = 6

Reached = Callable[[RemoteArm], bool]
REACHED: Final[Mapping[str, Reached]] = {
    "enable": lambda arm: arm.state == "ENABLED",
    "disable": lambda arm: arm.state == "DISABLED",
    "home": lambda arm: arm.state == "ENABLED" and arm.is_homed and not arm.is_busy,
    "unhome": lambda arm: not arm.is_homed,
    "pause": lambda arm: arm.state == "PAUSED",
    "resume": lambda arm: arm.state == "ENABLED",
}
"""What the arm shows at the end of each state command."""


class Pending:
    """A command that the arm still carries out."""

    def __init__(self, request: Received, reached: Reached | None, now_ns: int) -> None:
        """`reached`: None for a move."""
        self._request, self._reached, self._until_ns, self._was_busy = request, reached, now_ns + WAIT_NS, False

    def look(self, arm: RemoteArm, now_ns: int) -> bool:
        """Answer the request once the arm shows its end; returns whether it did."""
        self._was_busy = self._was_busy or arm.is_busy
        if self._reached is not None:
            is_done = self._reached(arm)
        else:
            is_done = arm.goal_reached is True or (arm.goal_reached is None and self._was_busy and not arm.is_busy)
        if is_done:
            self._request.done()
        elif arm.goal_reached is False and self._reached is None:
            self._request.fail("the arm has not reached the goal; its own reports say why")
        elif now_ns >= self._until_ns:
            self._request.fail(f"no end of it on ROS within {WAIT_NS // SECOND_NS} s")
        else:
            return False
        return True

    def fail(self, reason: str) -> None:
        """It has failed."""
        self._request.fail(reason)


class RemoteCommands:
    """All commands that an arm of this type has on ROS; `handlers` for the Provider."""

    def __init__(self, participant: Participant, place: ThirdParty, arm: RemoteArm, process: UserLoop) -> None:
        """`place.ros` says where the arm is; `process` carries the commands out."""
        assert place.ros is not None
        self._name, self._arm, self._process = place.name, arm, process
        self._base = None if place.base_frame is None else inverse(np.array(place.base_frame))
        self._streams, self._pending = Streams(), list[Pending]()
        self._newest: dict[str, tuple[CommandRow, TopicWriter[Any], Array, str]] = {}
        self.handlers: dict[str, Handler] = {}
        for row in COMMANDS[KIND]:
            if row.ros is not None and (not row.types or place.type.split("_")[0] in row.types):
                topic = f"{place.ros.namespace}/{row.name}"
                writer: TopicWriter[Any] = participant.writer(topic, MESSAGES[row.ros.message].message)
                self.handlers[row.name] = partial(self._send, row, writer)

    def flush(self) -> None:
        """Once a period, and before other commands: publish the newest goal of each stream."""
        for row, writer, numbers, frame in self._newest.values():
            self._publish(row, writer, numbers, frame)
        self._newest.clear()

    def look(self, now_ns: int) -> None:
        """Once a period: answer commands whose end the arm shows."""
        self._pending = [each for each in self._pending if not each.look(self._arm, now_ns)]

    def lose(self, why: str) -> None:
        """The arm is lost: what it was doing has failed, and each stream must begin again."""
        for each in self._pending:
            each.fail(why)
        self._pending.clear()
        self._newest.clear()
        self._streams.end(why)

    def _send(self, row: CommandRow, writer: TopicWriter[Any], values: Array, text: str) -> object:
        request, now_ns = self._process.request, monotonic_ns()
        assert request is not None and row.ros is not None
        is_stop = row.is_stop(text, values)
        if not (is_stop or self._arm.is_there):
            raise Refused(f"{self._name} is not there: {self._arm.problem or 'no message of it has arrived'}")
        if row.name == "state_command" and text not in REACHED:
            raise Refused(f"{text!r}: allowed are {', '.join(REACHED)}")
        if why := row.objection(values):
            raise Refused(why)
        numbers, frame = (values, text) if row.ros.message == "framed pose" else self._for_arm(row, values, text)
        if is_stop:
            self._newest.clear()
            self._streams.end(f"{request.holder.acting_for(request.origin.program)} stopped the arm ({row.name})",
                              spared=request.sender)
        if row.stream:
            self._check_stream(row, request, now_ns)
        if row.ros.newest:
            self._newest[row.name] = row, writer, numbers, frame
            return None
        self.flush()
        self._publish(row, writer, numbers, frame)
        if row.move:
            for each in self._pending:
                each.fail("replaced by another command")
            self._arm.goal_reached = None
        if not row.move and row.name != "state_command":
            return None
        self._pending = [*([] if row.move else self._pending), Pending(request, REACHED.get(text), now_ns)]
        return UserLoop.LATER

    def _publish(self, row: CommandRow, writer: TopicWriter[Any], numbers: Array, text: str) -> None:
        assert row.ros is not None
        message = MESSAGES[row.ros.message].made(numbers.tolist(), text)
        if hasattr(message, "header"):
            message.header.stamp = time_of(local_ns())
        writer.write(message)

    def _check_stream(self, row: CommandRow, request: Received, now_ns: int) -> None:
        if why := self._streams.objection(StreamKind(row.stream), request.sender, request, now_ns):
            raise Refused(why)
        self._streams.take(now_ns)

    def _for_arm(self, row: CommandRow, values: Array, text: str) -> tuple[Array, str]:
        """The numbers and the frame as the arm takes them: without a base frame that only this system knows."""
        assert row.ros is not None
        if not row.text or row.name == "state_command":
            return self._joints(row, values), text
        frame = self._arm.frame or ""
        if row.ros.message == "wrench":
            in_reference = len(values) > WRENCH + 1 and values[WRENCH + 1] == 1.0
            return values[:WRENCH], text or (frame if in_reference else "")
        if text and text != frame:
            return values, text
        if self._base is None:
            return values, frame
        if row.name not in ABSOLUTE:
            raise Refused(f"not with a base_frame in the system file; possible are {', '.join(ABSOLUTE)}")
        pose = pose_from_matrix(self._base @ matrix_from_pose(normalised(values[:7])))
        return pose, frame

    def _joints(self, row: CommandRow, values: Array) -> Array:
        """Positions alone: velocities that follow them would look like more joints."""
        joints = self._arm.value("setpoint_js")
        if row.arguments and row.arguments[0].size == JOINTS and joints is not None:
            if len(values) not in (len(joints), 2 * len(joints) if row.name == "servo_jp" else 0):
                raise Refused(f"takes {len(joints)} joints; {len(values)} given")
            return values[: len(joints)]
        return values
