"""Execution of ROS messages: each becomes a command of a person, like those of `trocar send`.

The owner of the command checks it like any other: sizes, limits, jumps of streams, dead-man switches. Two things are
checked here: `may_power` (if people on the network may not power or home, the bridge refuses commands that can cause
either), and the names of joints, which only messages have.
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
from trocar.procs.crtk.joint_order import JointNames, WrongNames, in_order
from trocar.procs.crtk.last_look import LastLook
from trocar.procs.document.bridges import RosBridge
from trocar.procs.ros_bridge.incoming import COMMAND_TOPICS, STREAM, CommandTopic
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_messages.command_messages import frame_of, no_text
from trocar.procs.ros_messages.dds import Participant, TopicReader
from trocar.procs.ros_messages.messages import JointStates
from trocar.procs.ros_messages.nodes import NodeNames
from trocar.procs.ros_messages.refusals import Refusals
from trocar.shm.commands import may_power
from trocar.shm.mailbox.client import Client, MailboxFull
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns

MAY_NOT: Final = "the ROS bridge may not power, home or release anything (trocar: {ros: {may_power: …}})"
BY_ORDER: Final = "trocar: {ros: {check_names: false}} ignores names"
JOINING_NS: Final = 5_000_000_000
"""After its start the bridge finds nodes that were there before: a stream of theirs may have begun earlier."""
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
    joints: JointNames | None = None
    """Of the view beside it, for messages with joint names."""


class PendingCommand(NamedTuple):
    """A command received over ROS, not executed yet."""

    is_of_stream: bool
    carry_out: Callable[[], None]
    leave_out: Callable[[], None]


class Commands:
    """All commands that ROS may give to a system."""

    def __init__(self, participant: Participant, system: str, addressees: Iterable[Addressee], bridge: RosBridge,
                 refusals: Refusals, joints: Callable[[str], JointNames], last_look: LastLook,
                 refuse_move: Callable[[str], None]) -> None:
        """`joints` returns the joint names of a view, by its name; `refuse_move` ends a move that an arm never got."""
        self._refuse_move = refuse_move
        self._last_look, self._joined_ns = last_look, monotonic_ns() + JOINING_NS
        self._streaming: set[int] = set()  # peers whose first message, soon after our start, was one of a stream
        self._bridge, self._say, self._system = bridge, refusals.say, system
        self._peers, self._peer_of = itertools.count(1), lru_cache(MAX_PEERS)(self._next_peer)
        self._nodes = NodeNames(participant)
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
                name = f"{to.prefix or to.name}/{topic}"
                reader = participant.reader(ros_topic(name), row.taken.message, row.depth)
                named = joints(f"{name.rpartition('/')[0]}/measured_js") if row.taken.message is JointStates else None
                self._asked.append(AskedTopic(reader, row, to.name, text, named))

    def take(self) -> list[PendingCommand]:
        """All received commands, those of each node in the order in which it published them."""
        self._nodes.look()
        came = [(asked, message) for asked in self._asked
                for message in asked.reader.take(partial(self._say, asked.to))]
        came.sort(key=lambda each: int(each[1].sample_info.source_timestamp))
        return [PendingCommand(asked.row.depth == STREAM, partial(self._carry_out, asked, message),
                               partial(self._leave_out, asked, message)) for asked, message in came]

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
                    self._say(client.instance, f"{client.instance}: {reply.text}", has_remedy=True)
            if not self._open[client]:
                del self._open[client]

    def _carry_out(self, asked: AskedTopic, message: Any) -> None:
        row, taken, to = asked.row.row, asked.row.taken, asked.to
        try:
            if asked.joints is not None:
                arrange(message, asked.joints.now(), by_name=self._bridge.check_names)
            text = asked.fixed_text or taken.text(message)
            if taken.text is frame_of and text:
                text = self._frame(row, text)
            numbers = np.asarray(taken.numbers(message), dtype=np.float64)
            if not self._bridge.may_power and may_power(row, text, numbers):
                raise ValueError(MAY_NOT)
            client = self._sender(asked, message)
            self._open.setdefault(client, set()).add(client.send(row.name, numbers, text))
            if row.ended_by and (pressed := presses(row, numbers.tolist())) is not None:
                self._held.pop(held := ending(to, row, text), None)
                if pressed:
                    self._held[held] = asked.reader, message.sample_info.publication_handle
        except (MailboxFull, SegmentError, ValueError) as error:
            remedy = f"; {BY_ORDER}" if isinstance(error, WrongNames) else ""
            self._say(to, f"{to}: {row.name}: {error}{remedy}")
            if row.name.rpartition("/")[2].startswith("move_"):
                self._refuse_move(to)

    def _leave_out(self, asked: AskedTopic, message: Any) -> None:
        """Drop a goal of a stream; the next goal continues this stream, instead of beginning a new one."""
        if asked.row.row.stream:
            with suppress(SegmentError):
                self._sender(asked, message).pass_over()

    def _sender(self, asked: AskedTopic, message: Any) -> Client:
        peer, name = self._peer(asked.reader, message)
        if asked.row.row.stream and monotonic_ns() < self._joined_ns and all(key[1] != peer for key in self._clients):
            self._streaming.add(peer)
        client = self._client(asked.to, peer)
        client.program = name or client.program
        self._last_look.mark(client)
        return client

    def _frame(self, row: CommandRow, frame: str) -> str:
        """The frame as the command gets it; ValueError if it takes none."""
        if not self._bridge.check_frames:
            return ""
        if not row.text:
            raise ValueError(f"frame {frame}; it takes no frame; trocar: {{ros: {{check_frames: false}}}} ignores it")
        return frame

    def _peer(self, reader: TopicReader[Any], message: Any) -> tuple[int, str]:
        """Which ROS participant sent it, and its name: nodes of one process are one; 0: it has gone."""
        writer = reader.writer(message.sample_info.publication_handle)
        if writer is None:
            return 0, ""
        return self._peer_of(writer.participant_key), self._nodes.of(writer.participant_key)

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
            client = self._clients[to, peer] = Client(self._system, to, "ros_bridge", peer=peer, holder="ros_bridge")
            if peer in self._streaming:
                client.join()
        return client

    def close(self) -> None:
        """Release the places in mailboxes."""
        for client in self._clients.values():
            client.close()


def arrange(message: JointStates, joints: tuple[str, ...], *, by_name: bool) -> None:
    """Put all numbers of a message in the order of `joints`; ValueError if names or numbers do not fit.

    Without names, positions with velocities must be for all joints, as two lists for half of them are as many numbers
    as one for all; and positions for no more than all, as twice as many would count as positions and velocities.
    """
    if by_name and (names := message.name):
        for part in ("position", "velocity", "effort"):
            if numbers := getattr(message, part):
                setattr(message, part, in_order(numbers, names, joints))
    elif joints and (len(message.position) > len(joints) or (message.position and message.velocity and (
            {len(message.position), len(message.velocity)} != {len(joints)}))):
        raise ValueError(f"{len(message.position)} positions and {len(message.velocity)} velocities; "
                         f"its joints are: {', '.join(joints)}")


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
