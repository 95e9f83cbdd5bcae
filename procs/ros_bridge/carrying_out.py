"""Execution of ROS messages: each becomes a command of a person, like those of `trocar send`.

The owner of the command checks it like any other: sizes, limits, jumps of streams, dead-man switches. Only `may_power`
is checked here: if people on the network may not power or home, the bridge refuses commands that can cause either.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np

from trocar.procs.crtk.held import Held, ending, presses
from trocar.procs.ros_bridge.incoming import COMMAND_TOPICS, STREAM, CommandTopic, no_text
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_bridge.refusals import Refusals
from trocar.procs.ros_messages.dds import Participant, TopicReader
from trocar.shm.commands import may_power
from trocar.shm.mailbox.client import Client, MailboxFull
from trocar.shm.memory.segment import SegmentError

MAY_NOT: Final = "the ROS bridge may not power, home or release anything (trocar: {ros: {may_power: …}})"
MAX_PEERS: Final = 256
"""Maximum number of participants distinguished, and of handles kept."""


@dataclass(frozen=True, slots=True)
class Addressee:
    """An instance that accepts commands, with its properties if topics depend on them."""

    name: str
    kind: str
    type: str = ""  # of an arm: PSM…, of a teleoperation: that of its slave
    parts: tuple[tuple[str, str], ...] = ()
    """Setup arms or robots: how topics call them, and commands."""
    prefix: str = ""
    """Prefix of its topics, if it is not the name."""


@dataclass(slots=True)
class AskedTopic:
    """One topic."""

    reader: TopicReader[Any]
    row: CommandTopic
    to: str
    fixed_text: str = ""


class PendingCommand(NamedTuple):
    """A command received over ROS, not executed yet."""

    is_of_stream: bool
    carry_out: Callable[[], None]


class Commands:
    """All commands that ROS may give to a system."""

    def __init__(self, participant: Participant, system: str, addressees: Iterable[Addressee], *, may_power: bool,
                 refusals: Refusals) -> None:
        self._may_power, self._say, self._system = may_power, refusals.say, system
        self._peers, self._peer_of = itertools.count(1), lru_cache(MAX_PEERS)(self._next_peer)
        self._clients: dict[tuple[str, int], Client] = {}
        """By instance and peer; that without a peer keeps our place in the mailbox."""
        self._open: dict[Client, set[int]] = {}
        """Of whom an answer is awaited, and to which commands."""
        self._asked: list[AskedTopic] = []
        self._held: dict[Held, tuple[TopicReader[Any], int]] = {}
        """Releases for commands that ROS nodes hold down, with the readers and handles of their publishers."""
        for to in addressees:
            self._clients[to.name, 0] = Client(system, to.name, "ros_bridge")
            for row, topic, text in topics_of(to):
                name = ros_topic(f"{to.prefix or to.name}/{topic}")
                reader = participant.reader(name, row.taken.message, row.depth)
                self._asked.append(AskedTopic(reader, row, to.name, text))

    def take(self) -> list[PendingCommand]:
        """All received commands."""
        return [PendingCommand(asked.row.depth == STREAM, partial(self._carry_out, asked, message))
                for asked in self._asked for message in asked.reader.take(partial(self._say, asked.to))]

    def hear(self) -> None:
        """Collect the outcomes; release commands held down by nodes that have left."""
        for held, (reader, handle) in list(self._held.items()):
            if reader.writer(handle) is None:
                to, command, values, text = held
                with suppress(MailboxFull, SegmentError):  # then again next time
                    self._clients[to, 0].send(command, values, text)
                    del self._held[held]
        for client in list(self._open):
            for reply in client.poll():
                if reply.outcome != "accepted":
                    self._open[client].discard(reply.id)
                if reply.outcome in ("refused", "failed"):
                    self._say(client.instance, f"{client.instance}: {reply.text}")
            if not self._open[client]:
                del self._open[client]

    def _carry_out(self, asked: AskedTopic, message: Any) -> None:
        row, taken, to = asked.row.row, asked.row.taken, asked.to
        text = asked.fixed_text or taken.text(message)
        numbers = np.asarray(taken.numbers(message), dtype=np.float64)
        if not self._may_power and may_power(row, text, numbers):
            self._say(to, f"{to}: {row.name}: {MAY_NOT}")
            return
        try:
            client = self._client(to, self._peer(asked.reader, message))
            self._open.setdefault(client, set()).add(client.send(row.name, numbers, text))
            if row.ended_by and (pressed := presses(row, numbers.tolist())) is not None:
                self._held.pop(held := ending(to, row, text), None)
                if pressed:
                    self._held[held] = asked.reader, message.sample_info.publication_handle
        except (MailboxFull, SegmentError, ValueError) as error:
            self._say(to, f"{to}: {row.name}: {error}")

    def _peer(self, reader: TopicReader[Any], message: Any) -> int:
        """Which ROS participant sent it: nodes of one process are one; 0: it has gone."""
        writer = reader.writer(message.sample_info.publication_handle)
        return 0 if writer is None else self._peer_of(writer.participant_key)

    def _next_peer(self, participant: UUID) -> int:
        return next(self._peers)

    def _client(self, to: str, peer: int) -> Client:
        """A handle for each participant, so that each has streams of its own."""
        client = self._clients.get((to, peer))
        if client is None:
            others = [key for key in self._clients if key[1]]
            if len(others) >= MAX_PEERS:
                gone = self._clients.pop(others[0])
                self._open.pop(gone, None)
                gone.close()
            client = self._clients[to, peer] = Client(self._system, to, "ros_bridge", peer=peer)
        return client

    def close(self) -> None:
        """Release the places in mailboxes."""
        for client in self._clients.values():
            client.close()


def topics_of(to: Addressee) -> list[tuple[CommandTopic, str, str]]:
    """Commands of an instance: row, topic, and the text that is always the same."""
    found = []
    for row in COMMAND_TOPICS:
        if row.kind != to.kind or (row.row.types and to.type not in row.row.types):
            continue
        if "{part}" in row.topic:
            found += [(row, row.topic.format(part=called), "" if row.taken.text is not no_text else name)
                      for called, name in to.parts]
        else:
            found.append((row, row.topic, ""))
    return found
