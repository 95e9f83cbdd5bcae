"""The ways to instances of a system on another machine: its socket bridge (docs/socket.md). Python and numpy only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from trocar.procs.crtk.names import none_such
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.bring_up import DISABLE, DISABLED, LIMITS_S, WORDS, late, next_word, obstacle, reached
from trocar.shm.commands import ENDINGS, became
from trocar.shm.mailbox.messages import Reply
from trocar.tools.client.connection import BridgeConnection
from trocar.tools.client.values import FRESH_S, Array, numbers
from trocar.tools.client.ways import InstanceRecord, ShownState
from trocar.tools.output.errors import Disconnected, NotThere, Problem, Refused

EVENT: Final = "event"
AROUND: Final = ("op", "topic", "age_s")
"""Fields of a received record that an event does not have."""
STEP_S: Final = 0.2
LOOK_S: Final = 0.005
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
class DistantView:
    """A view as received."""

    row: Mapping[str, Any]

    @property
    def stamp_ns(self) -> int:
        """When it was written, on the clock of its machine."""
        return int(self.row["stamp_ns"])

    def part(self, name: str) -> Array:
        """A part of it; null as NaN."""
        return np.concatenate([np.array(self.row[key] if self.row[key] is not None else [], dtype=np.float64)
                               for key in PARTS.get(name, (name,))])

    def labels(self) -> list[str]:
        """Its joint names."""
        return [str(name) for name in self.row["name"]]


class DistantRecord(InstanceRecord):
    """The records of one instance; every read requests the newest record."""

    def __init__(self, connection: BridgeConnection, name: str) -> None:
        """Problem if there is no such record."""
        super().__init__(name)
        self._connection = connection
        self.look()

    def _read(self, topic: str) -> dict[str, Any]:
        row = self._connection.ask("read", topic=f"{self._name}/{topic}")
        if not is_fresh(row):
            raise self._too_old()
        return row

    def look(self) -> ShownState:
        """See InstanceRecord."""
        return _shown(self._read("state"))

    def row(self) -> Mapping[str, Any]:
        """The newest state record as plain values; TimeoutError if it is too old."""
        return self._read("state")

    def is_fresh(self) -> bool:
        """Whether there is a new record."""
        try:
            self.look()
        except (TimeoutError, Problem):
            return False
        return True

    def stamp_ns(self) -> int:
        """The robot's time in the newest record, of any age; 0: there is none."""
        return self._connection.stamp_ns(self._name)

    def view(self, name: str) -> DistantView:
        """See InstanceRecord."""
        row = self._read(name)
        if not row.get("valid", True):
            raise self._invalid(name)
        return DistantView(row)

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
        """Detach, and end all subscriptions."""
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

    def events(self, name: str) -> DistantEvents:
        """Events of an instance."""
        return DistantEvents(self.connection, name)

    def type_of(self, name: str) -> str:
        """The type of an arm; "": not an arm."""
        found = self.instances.get(name, "")
        return found if found in ARM_TYPES else ""

    def bring(self, name: str, goal: str, timeout: float) -> None:
        """Enable, home or disable an instance and wait for it; Problem gives the reason for a failure."""
        if goal == DISABLED:  # also if its record is old
            self._settle(name, DISABLE, timeout)
            return
        asked, limit = "", self.connection.deadline(name, timeout or LIMITS_S[""])
        while not reached(WORDS[goal], asked, True, (now := self._now(name)).state, now.homed, now.busy):
            if problem := obstacle(WORDS[goal], asked, now.state, name, now.text("reason")):
                raise Problem(f"{name}: {problem}")
            if word := next_word(WORDS[goal], asked, now.state):
                self._settle(name, word, timeout)
                asked, limit = word, self.connection.deadline(name, timeout or LIMITS_S[word])
            elif limit.is_over():
                how = late(WORDS[goal], now.state, now.text("sub_state"), now.text("reason"))
                raise Problem(f"{name}: {how}")
            else:
                self.connection.hear(LOOK_S)

    def _now(self, name: str) -> ShownState:
        """The newest record of an arm; without a state if it is old, which may pass within the time limit."""
        row = self.connection.ask("read", topic=f"{name}/state")
        return _shown(row if is_fresh(row) else {**row, "state": ""})

    def _settle(self, name: str, word: str, timeout: float) -> None:
        reply = self.remote(name).settled("state_command", text=word, timeout=timeout or LIMITS_S[word])
        if reply.outcome != "done":
            raise Problem(f"{name}: {word} {became(reply.outcome)}: {reply.text}")

    def statistics(self, name: str) -> dict[str, dict[str, float]]:
        """Known on its own machine only."""
        raise Problem(f"{name}: statistics are not available from here; run trocar status on the robot's machine")

    def gripper_zero(self, name: str) -> float:
        """Unknown here: the master's report counts."""
        return math.inf


def is_fresh(row: Mapping[str, Any]) -> bool:
    """Whether a received record is fresh."""
    return row["age_s"] is not None and row["age_s"] <= FRESH_S


def _shown(row: Mapping[str, Any]) -> ShownState:
    return ShownState(row.__getitem__, int(row["stamp_ns"]))
