"""What came from ROS, carried out: each message becomes a command of a person, like those of `trocar send`.

Whoever gets the command checks it as it does any other: sizes, limits, jumps of streams, dead-men. Here only what
powers and homes is looked at: where people on the network may not do that, the bridge refuses it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from procs.ros.dds import Participant, TopicReader
from procs.ros_bridge.incoming import COMMAND_TOPICS, STREAM, CommandTopic, no_text
from procs.ros_bridge.publishing import ros_topic
from procs.ros_bridge.refusals import Refusals
from shm.client import Client, MailboxFull
from shm.segment import SegmentError

POWERS: Final = frozenset(("power_on", "home", "teleop_enable", "pid_enable", "brake_release"))
SWITCHES: Final = frozenset(("teleop_enable", "pid_enable"))
"""Of those whoever switches off may do that."""
POWERING_STATES: Final = frozenset(("enable", "home", "resume"))
MAY_NOT: Final = "the ROS bridge may not power or home (trocar: {ros: {may_power: …}})"


@dataclass(frozen=True, slots=True)
class Addressee:
    """An instance that can be asked, with what is said of it where topics differ."""

    name: str
    kind: str
    type: str = ""  # of an arm: PSM…, of a teleoperation: that of its slave
    parts: tuple[tuple[str, str], ...] = ()
    """Setup arms or robots: how topics call them, and commands."""
    prefix: str = ""
    """Of its topics, where that is not its name."""


def powers(command: str, numbers: Sequence[float], text: str) -> bool:
    """Whether power, homing or following may come of it."""
    if command == "state_command":
        return text.strip() in POWERING_STATES
    return command in POWERS and (command not in SWITCHES or any(numbers))


@dataclass(slots=True)
class AskedTopic:
    """One topic."""

    reader: TopicReader[Any]
    row: CommandTopic
    client: Client
    fixed_text: str = ""


class RosWish(NamedTuple):
    """What somebody asked over ROS, not carried out yet."""

    is_of_stream: bool
    carry_out: Callable[[], None]


class Commands:
    """All that ROS may ask of a system."""

    def __init__(self, participant: Participant, system: str, addressees: Iterable[Addressee], *, may_power: bool,
                 refusals: Refusals) -> None:
        self._may_power, self._say = may_power, refusals.say
        self._clients: list[Client] = []
        self._open: dict[Client, set[int]] = {}
        """Of whom an answer is awaited, and to which commands."""
        self._asked: list[AskedTopic] = []
        for to in addressees:
            client = Client(system, to.name, "ros_bridge")
            self._clients.append(client)
            self._asked += [AskedTopic(participant.reader(ros_topic(f"{to.prefix or to.name}/{topic}"), row.message,
                                                          row.depth), row,
                                  client, text) for row, topic, text in topics_of(to)]

    def take(self) -> list[RosWish]:
        """All that came."""
        return [RosWish(asked.row.depth == STREAM, partial(self._carry_out, asked, message))
                for asked in self._asked for message in asked.reader.take(self._say)]

    def hear(self) -> None:
        """What became of what was asked."""
        for client in list(self._open):
            for reply in client.poll():
                if reply.outcome != "accepted":
                    self._open[client].discard(reply.id)
                if reply.outcome in ("refused", "failed"):
                    self._say(f"{client.instance}: {reply.text}")
            if not self._open[client]:
                del self._open[client]

    def _carry_out(self, asked: AskedTopic, message: Any) -> None:
        row, to = asked.row, asked.client.instance
        text = asked.fixed_text or row.text(message)
        numbers = np.asarray(row.numbers(message), dtype=np.float64)
        if not self._may_power and powers(row.asks, numbers.tolist(), text):
            self._say(f"{to} {row.asks}: {MAY_NOT}")
            return
        try:
            self._open.setdefault(asked.client, set()).add(asked.client.send(row.asks, numbers, text))
        except (MailboxFull, SegmentError, ValueError) as error:
            self._say(f"{to} {row.asks}: {error}")

    def close(self) -> None:
        """Give the places in mailboxes back."""
        for client in self._clients:
            client.close()


def topics_of(to: Addressee) -> list[tuple[CommandTopic, str, str]]:
    """What an instance can be asked: row, topic, and the text that is always the same."""
    found = []
    for row in COMMAND_TOPICS:
        if row.kind != to.kind or (row.types and to.type not in row.types):
            continue
        if "{part}" in row.topic:
            found += [(row, row.topic.format(part=called), "" if row.text is not no_text else name)
                      for called, name in to.parts]
        else:
            found.append((row, row.topic, ""))
    return found
