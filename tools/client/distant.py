"""The ways to instances of a system on another machine: its socket bridge (docs/socket.md). Python and numpy only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from trocar.procs.crtk.names import none_such
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.commands import ENDINGS, became
from trocar.shm.mailbox.messages import Reply
from trocar.tools.client.connection import BridgeConnection
from trocar.tools.client.values import FRESH_S, Array, JointState, Stamped, numbers
from trocar.tools.output.errors import Disconnected, NotThere, Problem, Refused

EVENT: Final = "event"
AROUND: Final = ("op", "topic", "age_s")
"""Fields of a received record that an event does not have."""
STEP_S: Final = 0.2
STEPS: Final = {"disabled": ("disable",), "enabled": ("enable",), "homed": ("enable", "home")}
PARTS: Final = {"pose": ("position", "orientation"), "twist": ("linear", "angular"), "wrench": ("force", "torque")}
FLAGS: Final = {"gripper/closed": "closed", "orientation_locked": "locked"}


def _reply(number: int, found: dict[str, Any]) -> Reply:
    if found["op"] == "error":
        return Reply(number, "refused", str(found["error"]))
    return Reply(number, str(found["outcome"]), str(found["text"]))


class DistantRemote:
    """Commands to one instance."""

    def __init__(self, connection: BridgeConnection, instance: str) -> None:
        """Sends nothing yet."""
        self.instance, self._connection = instance, connection

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The rows of its table, as its mailbox lists them."""
        rows: list[dict[str, Any]] = self._connection.ask("commands", FRESH_S, of=self.instance)["commands"]
        return rows

    def _sent(self, command: str, values: ArrayLike, text: str) -> int:
        given = [value if math.isfinite(value) else None for value in numbers(values).tolist()]
        return self._connection.say("call", to=self.instance, command=command, values=given, text=text)

    def ask(self, command: str, values: ArrayLike = (), text: str = "", timeout: float = 2.0) -> Reply:
        """Send and make sure that it was accepted: Refused carries the reason. Returns the first answer."""
        number = self._sent(command, values, text)
        found = self._connection.first(number, timeout)
        if found is None:
            raise Problem(f"{self.instance} did not answer {command} within {timeout:g} s")
        reply = _reply(number, found)
        if reply.outcome not in ("accepted", "done"):
            raise Refused(reply.text or f"{self.instance}: {command} {became(reply.outcome)}")
        return reply

    def settled(self, command: str, values: ArrayLike = (), text: str = "", timeout: float = 60.0) -> Reply:
        """Send and wait for the end: refused, done or failed; Problem if it does not arrive in time."""
        number = self._sent(command, values, text)
        limit = self._connection.deadline(self.instance, timeout)
        while (found := self._connection.first(number, STEP_S, ENDINGS)) is None:
            if limit.is_over():
                raise Problem(f"{self.instance}: {command} {text} is not done after {timeout:g} s")
        return _reply(number, found)

    def replies_to(self, number: int) -> list[Reply]:
        """Answers to one command that were not collected yet."""
        return [_reply(number, found) for found in self._connection.heard(number)]

    def close(self) -> None:
        """The connection is closed by the record."""


@dataclass(frozen=True, slots=True)
class DistantShown:
    """A state record as received."""

    row: Mapping[str, Any]

    @property
    def state(self) -> str:
        """The operating state."""
        return str(self.row["state"])

    @property
    def homed(self) -> bool:
        """Whether the arm is homed and powered."""
        return bool(self.row["is_homed"])

    @property
    def busy(self) -> bool:
        """Whether a move or transition is in progress."""
        return bool(self.row["is_busy"])

    @property
    def stamp_ns(self) -> int:
        """When it was written, on the clock of its machine."""
        return int(self.row["stamp_ns"])

    def text(self, field: str) -> str:
        """A text field."""
        return str(self.row[field])

    def number(self, field: str) -> float:
        """A field that is one number."""
        return _number(self.row[field])


class DistantRecord:
    """The records of one instance; every read requests the newest record."""

    def __init__(self, connection: BridgeConnection, name: str) -> None:
        """Problem if there is no such record."""
        self._connection, self._name = connection, name
        self.look()

    def _read(self, topic: str) -> dict[str, Any]:
        row = self._connection.ask("read", topic=f"{self._name}/{topic}")
        age_s = row["age_s"]
        if age_s is None or age_s > FRESH_S:
            raise TimeoutError(f"{self._name} has not shown its state for {FRESH_S:g} s")
        return row

    def look(self) -> DistantShown:
        """The newest record; TimeoutError if it is too old."""
        return DistantShown(self._read("state"))

    def row(self) -> Mapping[str, Any]:
        """The newest record as plain values; TimeoutError if it is too old."""
        return self._read("state")

    def stamp_ns(self) -> int:
        """The robot's time in the newest record, of any age; 0: there is none."""
        return self._connection.stamp_ns(self._name)

    def is_fresh(self) -> bool:
        """Whether there is a new one."""
        try:
            self.look()
        except (TimeoutError, Problem):
            return False
        return True

    def _valid(self, view: str) -> dict[str, Any]:
        row = self._read(view)
        if not row.get("valid", True):
            raise TimeoutError(f"{self._name}/{view} is not valid now (is the arm powered and homed?)")
        return row

    def part(self, view: str, name: str) -> Stamped:
        """A part of a view; TimeoutError if it is too old or not valid now."""
        row = self._valid(view)
        found = [_array(row[key]) for key in PARTS.get(name, (name,))]
        return found[0] if len(found) == 1 else np.concatenate(found), int(row["stamp_ns"])

    def pose(self, view: str) -> Stamped:
        """The pose (4, 4) that a view shows."""
        pose, stamp_ns = self.part(view, "pose")
        return matrix_from_pose(pose), stamp_ns

    def joint_state(self, view: str) -> tuple[JointState, int]:
        """Joint values of a view."""
        row = self._valid(view)
        return JointState(*(_array(row[name]) for name in JointState._fields)), int(row["stamp_ns"])

    def joint_names(self, view: str) -> list[str]:
        """Names of the joints of a view."""
        return [str(name) for name in self._valid(view)["name"]]

    def reported(self, event: str) -> bool:
        """The last flag of an event of this name; False if there was none."""
        try:
            return bool(self._connection.ask("read", topic=f"{self._name}/{event}")[FLAGS[event]])
        except Disconnected:
            raise
        except Problem:
            return False

    def parts(self) -> list[str]:
        """Names of the setup arms that it shows."""
        topics = [str(row["topic"]).split("/") for row in self._connection.ask("list")["topics"]]
        return [words[1] for words in topics if words[0] == self._name and words[2:] == ["measured_js"]]

    def close(self) -> None:
        """Leave."""
        self._connection.close()


class DistantEvents:
    """Events of one instance."""

    def __init__(self, connection: BridgeConnection, name: str) -> None:
        """Sends nothing yet."""
        self._connection, self._name = connection, name
        self._followed: set[str] = set()

    def names(self) -> list[str]:
        """Events that there are."""
        topics = self._connection.ask("list")["topics"]
        ours = [row for row in topics if row["kind"] == EVENT and row["topic"].partition("/")[0] == self._name]
        return [str(row["topic"]).partition("/")[2] for row in ours]

    def follow(self, event: str) -> None:
        """Take in each event of this name, one of `names`, from now on."""
        self._connection.ask("subscribe", topic=f"{self._name}/{event}", last=False)
        self._followed.add(event)

    def leave(self, event: str) -> None:
        """End the subscription."""
        if event in self._followed:
            self._followed.remove(event)
            self._connection.ask("unsubscribe", topic=f"{self._name}/{event}")

    def taken(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Those since the last call, with their names, in order; `lost`: number of unsent ones before an event."""
        came = [(event, {key: row[key] for key in row if key not in AROUND})
                for event in self._followed for row in self._connection.records(f"{self._name}/{event}")]
        return sorted(came, key=lambda found: int(found[1]["sequence"]))

    def close(self) -> None:
        """The connection is closed by the record."""


class DistantWays:
    """Both ways to the instances of one system, by one connection."""

    def __init__(self, connection: BridgeConnection) -> None:
        """It is closed with the first record."""
        self.connection, self.name = connection, str(connection.hello["system"])
        self.is_simulated = connection.is_simulated
        self.instances: dict[str, str] = dict(connection.hello["instances"])
        """Type of each: that of the arm, else the kind of its process."""

    def checked(self, kind: str, name: str) -> Self:
        """Ourselves; NotThere unless there is one of this kind and name."""
        known = [each for each, what in self.instances.items() if ("arm" if what in ARM_TYPES else what) == kind]
        if name not in known:
            raise NotThere(none_such(kind, name, known))
        return self

    def record(self, name: str) -> DistantRecord:
        """Records of an instance; Problem if it is not there (yet)."""
        return DistantRecord(self.connection, name)

    def remote(self, name: str) -> DistantRemote:
        """Commands to it."""
        return DistantRemote(self.connection, name)

    def rows(self, name: str) -> DistantRecord:
        """The same, for an instance that is not an arm."""
        return DistantRecord(self.connection, name)

    def events(self, name: str) -> DistantEvents:
        """Events of an instance."""
        return DistantEvents(self.connection, name)

    def type_of(self, name: str) -> str:
        """The type of an arm; "": not an arm."""
        found = self.instances.get(name, "")
        return found if found in ARM_TYPES else ""

    def bring(self, name: str, goal: str, timeout: float) -> None:
        """Enable, home or disable an instance and wait for it; Problem gives the reason for a failure."""
        record, remote = DistantRecord(self.connection, name), self.remote(name)
        now = record.look()
        steps = (("disable",) if now.state == "FAULT" and goal != "disabled" else ()) + STEPS[goal]
        for word in steps:
            if word == "enable" and record.look().state == "ENABLED":
                continue
            reply = remote.settled("state_command", text=word, timeout=timeout)
            if reply.outcome != "done":
                raise Problem(f"{name}: {word} {became(reply.outcome)}: {reply.text}")

    def statistics(self, name: str) -> dict[str, dict[str, float]]:
        """Known on its own machine only."""
        raise Problem(f"{name}: trocar status on the robot's machine shows it")

    def gripper_zero(self, name: str) -> float:
        """Unknown here: the master's report counts."""
        return math.inf


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _array(value: Any) -> Array:
    """A received list, null as NaN."""
    return np.array(value if value is not None else [], dtype=np.float64)
