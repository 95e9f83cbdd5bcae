"""ROS messages from the events of an instance, in order of occurrence."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from cyclonedds.idl import IdlStruct

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.views import Stamps
from trocar.procs.ros_bridge.outgoing import EVENT_MESSAGES, OF_EVENT, stamped
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_bridge.shown import ShownTopics
from trocar.procs.ros_messages.dds import LATCHED, Participant, TopicWriter
from trocar.procs.ros_messages.messages import Bool, Joy, Log, OperatingState, String, log_line, time_of
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import STATUS

PRESS: Final = b"button"
"""The event of io's digital inputs; `component` is the name of one."""
REMEMBERED: Final = 20
NOT_SHOWN: Final[tuple[None, list[TopicWriter[Any]]]] = (None, [])
RECENT_NS: Final = 1_000_000_000
"""An instance that has reported a refusal itself has done so at most this long before its answer."""
REPEAT_NS: Final = 100_000_000
"""Between two messages of an operating state: late subscribers must receive it too."""


@dataclass(slots=True)
class ToldState:
    """The operating state last published; its stamps increase strictly, as clients compare them."""

    writers: list[TopicWriter[OperatingState]]
    message: OperatingState
    stamp_ns: int = 0
    due_ns: int = 0

    @property
    def is_read(self) -> bool:
        """Whether the topic has a subscriber."""
        return any(writer.is_read for writer in self.writers)

    def tell(self, ros_ns: int, now_ns: int) -> None:
        """Publish again, or a new state. If the time of day is set back, stamps still increase, without a wait."""
        self.stamp_ns = max(ros_ns, self.stamp_ns + 1)
        self.due_ns = now_ns + REPEAT_NS
        self.message.header.stamp = time_of(self.stamp_ns)
        for writer in self.writers:
            writer.write(self.message)


class EventTopics:
    """The events of one instance, in order of occurrence."""

    def __init__(self, participant: Participant, instance: str, shown: ShownTopics, ring: RingReader,
                 names: Iterable[str], rosout: Callable[[Log], None], repeats: Iterable[str] = ()) -> None:
        """`names` are those of the events that there are; `repeats`: processes whose messages it repeats."""
        self._repeats = {name.encode() for name in repeats}
        self._ring, self._name, self._rosout = ring, instance, rosout
        self._fields = {name: ring.field(name) for name in ring.dtype.names or () if name not in ("sequence",)}
        self._rows: dict[bytes, tuple[type[IdlStruct], list[TopicWriter[Any]]]] = {}
        self._refused: list[str] = []
        self._refused_moves = 0
        self._reported: deque[tuple[int, str]] = deque(maxlen=REMEMBERED)
        """Its own warnings and errors, with their stamps."""
        self.state: ToldState | None = None
        for name in names:
            message, topics = EVENT_MESSAGES.get(name), shown.events(instance, name)
            if message is None or not topics:
                continue
            writers: list[TopicWriter[Any]]
            writers = [participant.writer(ros_topic(topic), message, LATCHED) for topic in topics]
            self._rows[name.encode()] = message, writers
            if message is OperatingState:
                self.state = ToldState(writers, OperatingState())
        self._buttons = {name.encode(): (Joy, [participant.writer(ros_topic(topic), Joy, LATCHED) for topic in topics])
                         for name, topics in shown.buttons(instance).items()}

    def begin(self, state: str, is_homed: bool, is_busy: bool) -> None:
        """The operating state before its first event."""
        if self.state is not None:
            self.state.message = OperatingState(state=state, is_homed=is_homed, is_busy=is_busy)

    def step(self, stamps: Stamps, now_ns: int) -> None:
        """All events since the last call; none is left out or merged with the next."""
        fields, ring = self._fields, self._ring
        while ring.next():
            event = {name: cell[()] for name, cell in fields.items()}
            self._tell(event, stamps.ns(ring.stamp_ns), now_ns)
            if event["severity"] and bytes(event["component"]) not in self._repeats:
                self._log(event, stamps.ns(ring.stamp_ns))
            if event["severity"] > STATUS:
                self._reported.append((ring.stamp_ns, str(plain(event["text"]))))
        if self._refused:
            self._tell_refusals(now_ns)
        if self._refused_moves:
            self._tell_refused_moves(stamps.ns(now_ns), now_ns)
        if self.state is not None and now_ns >= self.state.due_ns and self.state.is_read:
            self.state.tell(stamps.ns(now_ns), now_ns)

    def refuse(self, text: str) -> None:
        """Publish a refusal as its warning in the next `step`, unless it has reported that itself."""
        self._refused.append(text)

    def refuse_move(self) -> None:
        """A move that never reached it: as for its own refusals, clients that wait for its end continue at once."""
        self._refused_moves += 1

    def _tell_refused_moves(self, ros_ns: int, now_ns: int) -> None:
        told, self._refused_moves = self.state, 0
        if told is None or told.message.is_busy:  # its own move will end
            return
        told.message.is_busy = True
        told.tell(ros_ns, now_ns)
        for writer in self._rows.get(b"goal_reached", NOT_SHOWN)[1]:
            writer.write(Bool(False))
        told.message.is_busy = False
        told.tell(ros_ns, now_ns)

    def _tell_refusals(self, now_ns: int) -> None:
        said = [text for stamp_ns, text in self._reported if now_ns - stamp_ns < RECENT_NS]
        for refusal in self._refused:
            if not any(refusal.startswith(text) for text in said):
                for writer in self._rows.get(b"warning", NOT_SHOWN)[1]:
                    writer.write(String(refusal))
        self._refused.clear()

    def _tell(self, event: dict[str, Any], ros_ns: int, now_ns: int) -> None:
        what = bytes(event["event"])
        kind, writers = self._buttons.get(bytes(event["component"]), NOT_SHOWN) if what == PRESS else self._rows.get(
            what, NOT_SHOWN)
        if kind is None:
            return
        message = OF_EVENT[kind](event)
        if self.state is not None and writers is self.state.writers:
            self.state.message = message
            self.state.tell(ros_ns, now_ns)
        else:
            for writer in writers:
                writer.write(stamped(message, ros_ns))

    def _log(self, event: dict[str, Any], ros_ns: int) -> None:
        text, hint = (bytes(event[name]).rstrip(b"\0").decode(errors="replace") for name in ("text", "hint"))
        self._rosout(log_line(ros_ns, self._name, int(event["severity"]), text, hint))
