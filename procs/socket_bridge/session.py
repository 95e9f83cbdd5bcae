"""One client: identity, rights, subscriptions, and the answers to its messages."""

from __future__ import annotations

import hmac
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from trocar.procs.crtk.calls import Calls, ClientCounts, CommandOwner
from trocar.procs.crtk.held import HeldDown
from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.crtk.messages import Message, NoMessage, WrongMessage, parsed, said
from trocar.procs.document.bridges import COMMAND, VIEW, Rights
from trocar.procs.document.user_process import PROPERTIES, SET_PROPERTY
from trocar.procs.socket_bridge.connection import Connection
from trocar.procs.socket_bridge.feeds import Feed, Reading, subscribed
from trocar.procs.socket_bridge.messages import OPS
from trocar.procs.socket_bridge.topics import SharedTopic, Topics
from trocar.shm.mailbox.command_row import listed
from trocar.shm.memory.header import SegmentError
from trocar.shm.ring.ring import RingError
from trocar.shm.time.clock import monotonic_ns

PROTOCOL: Final = 1
MAX_STREAMS: Final = 256
KEEP_NS: Final = 1_000_000_000
"""So long a topic that was read is kept open: it may be read again."""
MANY_WRONG: Final = 20
"""Messages that are no JSON, one after the other: that is another protocol."""


@dataclass(frozen=True, slots=True)
class ClientService:
    """Shared by all sessions."""

    system: str
    clock: str
    token: bytes
    topics: Topics
    instances: dict[str, str]
    owners: dict[str, CommandOwner]
    is_over: Callable[[], bool]
    first: FirstMessages
    wake: Callable[[], None]
    counts: ClientCounts = field(default_factory=ClientCounts)


class Session:
    """Messages of a client and their effects."""

    def __init__(self, served: ClientService, link: Connection, rights: Rights, is_known: bool) -> None:
        """An unidentified client must first send the token."""
        self.link, self.rights, self.is_known = link, rights, is_known
        self.streams: dict[str, Feed] = {}
        self.reads: list[Reading] = []
        self._kept: dict[str, tuple[SharedTopic, int]] = {}
        self.calls = Calls(served.system, served.owners, rights, served.is_over, first=served.first)
        self._held = HeldDown(self.calls)
        self._served, self._counts, self._wrong, self._is_first = served, served.counts, 0, True
        self._ops: dict[str, Callable[[Message], None]] = {
            "hello": self._hello, "ping": self._ping, "list": self._list, "commands": self._commands,
            "read": self._read, "subscribe": self._subscribe, "unsubscribe": self._unsubscribe,
            "call": self._call, "get": self._get, "set": self._set}

    def handle(self, message: bytes, has_waited: bool = False) -> None:
        """Handle one message; an error in it is answered, and has no other effect. `has_waited`: see `Calls`."""
        self._counts.received += 1
        self.calls.has_waited = has_waited
        number: Any = None
        try:
            asked = parsed(message, OPS)
            number = asked.id
            if not self.is_known and asked.op != "hello":
                raise WrongMessage("say hello with the token first")
            self._ops[asked.op](asked)
        except NoMessage as error:
            self._refuse(None, str(error))
            self._wrong += 1
            if self._is_first or self._wrong > MANY_WRONG:
                self.link.end()  # a web page may make a browser send this
            return
        except WrongMessage as error:
            self._refuse(error.id if number is None else number, str(error))
        except (SegmentError, RingError, OSError, ValueError) as error:  # as no more files may be open
            self._refuse(number, str(error))
        self._wrong, self._is_first = 0, False
        self._served.wake()

    def _refuse(self, number: Any, why: str) -> None:
        self._counts.refused += 1
        self.link.send(said("error", number, error=why))

    def _answer(self, asked: Message, **parts: Any) -> None:
        self.link.send(said("answer", asked.id, **parts))

    def _hello(self, asked: Message) -> None:
        token = self._served.token
        if not self.is_known:
            if not token or not hmac.compare_digest(asked.parts["token"].encode(errors="replace"), token):
                self._refuse(asked.id, "the token is wrong")
                self.link.end()
                return
            self.is_known = True
        self.calls.program = asked.parts["name"]
        self._answer(asked, protocol=PROTOCOL, system=self._served.system, clock=self._served.clock,
                     instances=self._served.instances,
                     grants=COMMAND if self.rights.commands else VIEW, may_power=self.rights.powers)

    def _ping(self, asked: Message) -> None:
        self._answer(asked, now_ns=monotonic_ns())

    def _list(self, asked: Message) -> None:
        entries = self._served.topics.entries.values()
        self._answer(asked, topics=[{"topic": entry.name, "kind": entry.kind, "rate_hz": entry.rate_hz}
                                    for entry in entries])

    def _commands(self, asked: Message) -> None:
        rows = self.calls.owner(asked.parts["of"]).rows.values()
        self._answer(asked, commands=[listed(row) for row in rows])

    def _read(self, asked: Message) -> None:
        self._check_room()
        topics, name, now_ns = self._served.topics, asked.parts["topic"], monotonic_ns()
        source = topics.share(topics.find(name))
        self.reads.append(Reading(topics, source, asked.id, now_ns))
        if name in self._kept or len(self._kept) < MAX_STREAMS:
            kept = self._kept.pop(name, None)
            self._kept[name] = kept[0] if kept is not None else topics.share(source.entry), now_ns + KEEP_NS

    def _check_room(self) -> None:
        if len(self.streams) + len(self.reads) >= MAX_STREAMS:
            raise WrongMessage(f"a client has {MAX_STREAMS} subscriptions at most")

    def _subscribe(self, asked: Message) -> None:
        name = asked.parts["topic"]
        if name not in self.streams:
            self._check_room()
        made = subscribed(self._served.topics, name, asked.parts["rate_hz"], asked.parts["last"])
        if (former := self.streams.pop(name, None)) is not None:
            former.close()
        self._answer(asked, topic=name)
        self.streams[name] = made

    def _unsubscribe(self, asked: Message) -> None:
        stream = self.streams.pop(asked.parts["topic"], None)
        if stream is None:
            raise WrongMessage("there is no such subscription")
        stream.close()
        self._answer(asked, topic=asked.parts["topic"])

    def _call(self, asked: Message) -> None:
        parts = asked.parts
        to, command, values, text = parts["to"], parts["command"], list(parts["values"]), parts["text"]
        self.calls.send(asked.id, to, command, values, text)
        self._held.note("", to, command, values, text)
        self._counts.commands += 1

    def _get(self, asked: Message) -> None:
        topics, of = self._served.topics, asked.parts["of"]
        topic = topics.each(topics.find(f"{of}/{PROPERTIES}"))
        try:
            row = topic.as_dict() if topic.newest() else {}
        finally:
            topic.close()
        self._answer(asked, of=of, properties={name: row[name] for name in row if name not in ("stamp_ns", "sequence")})

    def _set(self, asked: Message) -> None:
        parts = asked.parts
        self.calls.send(asked.id, parts["of"], SET_PROPERTY, [parts["value"]], parts["property"])
        self._counts.commands += 1

    @property
    def is_waiting(self) -> bool:
        """Whether a request is not answered yet."""
        return bool(self.reads) or self.calls.are_under_way

    def serve(self, now_ns: int, turn: int) -> float:
        """Send due data; returns the time until the next data is due, s."""
        counts, link, next_ns = self._counts, self.link, now_ns + 1_000_000_000
        for stream in (*self.streams.values(), *self.reads):
            if stream.due_ns <= now_ns:
                sent, lost = stream.serve(link, now_ns, turn)
                counts.sent += sent
                counts.lost += lost
            next_ns = min(next_ns, stream.due_ns)
        for reading in [reading for reading in self.reads if reading.is_done]:
            self.reads.remove(reading)
            reading.close()
        while self._kept and (oldest := next(iter(self._kept.items())))[1][1] <= now_ns:
            self._served.topics.leave(self._kept.pop(oldest[0])[0])
        for call, reply in self.calls.replies():
            link.send(said("reply", call.id, to=call.to, command=call.command, outcome=reply.outcome, text=reply.text))
        return min((next_ns - now_ns) * 1e-9, self.calls.wait_s(now_ns))

    def gone(self) -> None:
        """The client has left: its subscriptions end, and buttons it holds down are released.

        Commands under way finish.
        """
        for stream in (*self.streams.values(), *self.reads):
            stream.close()
        for source, _ in self._kept.values():
            self._served.topics.leave(source)
        self.streams.clear()
        self.reads.clear()
        self._kept.clear()
        self._held.end()
        self.calls.close()
