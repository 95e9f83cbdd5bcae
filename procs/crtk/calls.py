"""Commands of one client, and their outcomes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.crtk.messages import WrongMessage
from trocar.procs.crtk.names import none_such
from trocar.procs.crtk.user_rows import commands_of
from trocar.procs.document.bridges import Rights
from trocar.procs.document.system import SystemConfig
from trocar.procs.document.user_process import SET_PROPERTY
from trocar.shm.commands import COMMANDS, ENDINGS, may_power
from trocar.shm.mailbox.client import Client, MailboxFull, Reply
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.parts import parts_of
from trocar.shm.time.clock import monotonic_ns

PEERS: Final = itertools.count(1)
"""Numbers of this bridge's clients: a stop by one of them also ends the streams of the others."""
KEPT: Final = 1000
"""Maximum number of commands without a reported outcome."""
MAY_NOT: Final = "this connection may not power, home or release anything (trocar.socket.may_power)"
SOON_NS: Final = 1_000_000_000
"""How long the first answer is polled at the higher rate."""


@dataclass(frozen=True, slots=True)
class CommandOwner:
    """An instance that accepts commands: its kind, the commands of the kind by name, and, of an arm, its type."""

    kind: str
    rows: Mapping[str, CommandRow]
    type: str = ""

    def lacks(self, to: str, command: str) -> str:
        """That `to` has no such command, with similar ones of its type."""
        if command == SET_PROPERTY:
            return f"{to} has no properties"
        names = [row.name for row in self.rows.values() if not self.type or self.type in (row.types or (self.type,))]
        return none_such("command", command[:80], names, to)


@dataclass(slots=True)
class Call:
    """A command under way: the client's id, the receiver, the command, and when an answer is due."""

    id: Any
    to: str
    command: str
    due_ns: int


@dataclass(slots=True)
class ClientCounts:
    """Messages of all clients of a bridge since its start: received, sent and lost ones, and commands."""

    received: int = 0
    sent: int = 0
    lost: int = 0
    commands: int = 0
    refused: int = 0


class Calls:
    """The connections of one client to all owners; its commands are operators' commands."""

    def __init__(self, system: str, owners: Mapping[str, CommandOwner], rights: Rights,
                 is_over: Callable[[], bool], holder: str = "socket_bridge", first: FirstMessages | None = None
                 ) -> None:
        """`is_over`: whether commands are outdated after a stall, and refused. `holder`: name of the bridge. `first`:
        messages may have waited for its start.
        """
        self._peer, self._first = next(PEERS), first
        self.has_waited = False
        """The present message came with the first bytes of its connection, which may have waited for our start."""
        self.program = "socket"
        """The name that other programs see."""
        self._system, self._owners, self._rights, self._is_over, self._holder = system, owners, rights, is_over, holder
        self._clients: dict[str, Client] = {}
        self._calls: dict[tuple[str, int], Call] = {}
        self._due_ns = 0

    def owner(self, name: str) -> CommandOwner:
        """The owner of this name; otherwise WrongMessage, with similar names."""
        if name not in self._owners:
            raise WrongMessage(none_such("component", name[:80], self._owners))
        return self._owners[name]

    def send(self, number: Any, to: str, command: str, values: list[float], text: str, seen: int | None = None) -> None:
        """Pass on a command, or raise WrongMessage with the reason. `seen`: see Client.seen."""
        owner = self.owner(to)
        row = owner.rows.get(command)
        if row is None:
            raise WrongMessage(owner.lacks(to, command))
        if not self._rights.commands:
            raise WrongMessage("this connection is read-only (trocar.socket.grants)")
        if not self._rights.powers and may_power(row, text, values):
            raise WrongMessage(f"{to} {command}: {MAY_NOT}")
        if self._is_over():
            raise WrongMessage("the bridge stalled; requests received meanwhile were dropped")
        try:
            if to not in self._clients:
                self._clients[to] = Client(self._system, to, self.program, peer=self._peer, holder=self._holder)
            client = self._clients[to]
            client.sent_ns, client.seen = 0, seen
            if self._first is not None and self.has_waited:
                self._first.mark(client)
            sent = client.send(command, values, text)
        except (SegmentError, MailboxFull, ValueError, KeyError) as error:
            raise WrongMessage(str(error)) from None
        self._due_ns = monotonic_ns() + SOON_NS
        self._calls[to, sent] = Call(number, to, command, self._due_ns)
        if len(self._calls) > KEPT:
            del self._calls[next(iter(self._calls))]

    @property
    def are_under_way(self) -> bool:
        """Whether there are commands without a known outcome."""
        return bool(self._calls)

    def replies(self) -> Iterator[tuple[Call, Reply]]:
        """The replies since the last call."""
        if not self._calls:
            return
        for to, client in self._clients.items():
            for reply in client.poll():
                key = to, reply.id
                call = self._calls.get(key)
                if call is None:
                    continue
                call.due_ns = 0
                if reply.outcome in ENDINGS:
                    del self._calls[key]
                yield call, reply
        if self._due_ns and all(call.due_ns == 0 for call in self._calls.values()):
            self._due_ns = 0

    def wait_s(self, now_ns: int) -> float:
        """Time until replies must be polled again, s; infinite when none are expected."""
        if self._due_ns > now_ns:
            return 0.001
        return 0.01 if self._calls else float("inf")

    def close(self) -> None:
        """Close all connections; commands under way finish without a report."""
        for client in self._clients.values():
            client.close()
        self._clients.clear()
        self._calls.clear()


def owners_of(document: SystemConfig) -> dict[str, CommandOwner]:
    """All instances that accept commands, by name."""
    found, types = {}, {arm.name: arm.type for arm in document.arms}
    for name in sorted({instance for _, instance, what in parts_of(document.name) if what == "mailbox"}):
        if name == "supervisor":
            kind, rows = name, COMMANDS[name]
        else:
            kind, user = document.process(name).kind, document.user(name)
            rows = COMMANDS.get(kind, ()) + (commands_of(user) if user is not None else ())
        found[name] = CommandOwner(kind, {row.name: row for row in rows}, types.get(name, ""))
    return found
