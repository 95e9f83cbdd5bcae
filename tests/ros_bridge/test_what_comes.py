"""What comes from DDS may be anything, and the time of day may be set: the bridge goes on."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, cast
from uuid import UUID

import pytest
from cyclonedds.core import DDSException

from tests.conftest import World
from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.last_look import LastLook
from trocar.procs.crtk.views import Stamps
from trocar.procs.document.bridges import RosBridge
from trocar.procs.ros_bridge import carrying_out
from trocar.procs.ros_bridge.events import REPEAT_NS, ToldState
from trocar.procs.ros_bridge.outgoing import FIELD_TOPICS
from trocar.procs.ros_bridge.publishing import RecordTopics
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import JointStates, Joy, OperatingState, Time
from trocar.procs.ros_messages.refusals import KEPT, SILENT_NS, Refusals
from trocar.shm.system import directory

HOUR_NS = 3600 * 10**9


@pytest.fixture
def participant() -> Iterator[Participant]:
    made = Participant(1 + os.getpid() % 230, name="test")
    yield made
    made.close()


class Spoilt(JointStates):
    """A joint's name that is no text."""

    def serialize(self, *_: Any, **__: Any) -> bytes:
        return bytes(JointStates(name=["QQQQ"], position=[1.0]).serialize()).replace(b"QQQQ", b"\xff\xfe\xff\x80")


def test_a_message_that_cannot_be_read_takes_no_other_with_it(participant: Participant) -> None:
    writer, reader = participant.writer("x", JointStates), participant.reader("x", JointStates)
    told: list[str] = []
    for message in (JointStates(position=[1.0]), Spoilt(), JointStates(position=[2.0]), Spoilt()):
        writer.write(message)
    assert [message.position for message in reader.take(told.append)] == [[1.0], [2.0]]
    assert len(told) == 2 and "rt/x" in told[0] and "cannot be read" in told[0]
    writer.write(Spoilt())
    assert reader.take() == []


def test_the_buttons_of_a_console_have_the_stamp_of_their_record(world: World) -> None:
    directory.create_ring(world.name, "console", directory.topic_of("console", "state"), {"teleops": 1}, {})
    record = directory.writer(world.name, "console", "state", "console")
    record.field("operator_present")[...] = True
    record.publish(7_000_000_001)
    written: dict[str, list[Any]] = {}
    taker = SimpleNamespace(writer=lambda name, *_: SimpleNamespace(write=written.setdefault(name, []).append))
    told = [(row, row.topic, -1) for row in FIELD_TOPICS if row.kind == "console"]
    reader = directory.reader(world.name, "console", "state", "console")
    topics = RecordTopics(cast("Participant", taker), Wanted(world.name, "test"), "console", reader, (), told)
    topics.step(Stamps(simulated=True))
    (message,) = written["operator_present"]
    assert (message.buttons, message.header.stamp) == ([1], Time(7, 1))
    reader.close()
    record.close()
    world.remove()


def test_a_message_that_is_too_large_goes_nowhere(participant: Participant) -> None:
    writer, reader = participant.writer("x", JointStates), participant.reader("x", JointStates)
    with contextlib.suppress(DDSException):
        writer.write(JointStates(position=[0.0] * 100_000))
    writer.write(JointStates(position=[1.0]))
    assert [message.position for message in reader.take()] == [[1.0]]


def test_a_refusal_is_told_once_a_second_and_few_are_remembered() -> None:
    told: list[tuple[str, str, bool]] = []
    now = 0
    refusals = Refusals(lambda *said: told.append(said), lambda: now)
    for _ in range(10):
        refusals.say("PSM1", "no")
    now += SILENT_NS
    refusals.say("PSM1", "no")
    assert told == [("PSM1", "no", False)] * 2
    for k in range(3 * KEPT):
        refusals.say("PSM1", str(k))
    assert len(refusals._silent_until) <= KEPT and len(told) == 2 + 3 * KEPT


def test_operating_states_go_on_with_newer_stamps_when_the_time_of_day_is_set_back() -> None:
    stamps: list[Time] = []
    writer: Any = SimpleNamespace(write=lambda message: stamps.append(message.header.stamp))
    state = ToldState([writer], OperatingState())
    now, ahead = 10 * HOUR_NS, 100 * HOUR_NS
    for step in range(6):
        if step == 3:
            ahead -= HOUR_NS
        state.tell(now + ahead, now)
        assert state.due_ns == now + REPEAT_NS, "whoever comes late does not wait for an hour"
        now = state.due_ns
    told = [(stamp.sec, stamp.nanosec) for stamp in stamps]
    assert told == sorted(set(told))


def test_writers_are_asked_who_reads_them_only_where_something_has_changed(participant: Participant) -> None:
    writers = [participant.writer(f"x{k}", JointStates) for k in range(3)]
    participant.look()
    assert not any(writer.is_read for writer in writers)
    reader = participant.reader("x1", JointStates)
    participant.look()
    assert [writer.is_read for writer in writers] == [False, True, False]
    asked: list[str] = []
    for writer in participant.writers:
        writer.look = partial(asked.append, writer.name)  # type: ignore[method-assign]
    participant.look()
    assert not asked and reader.take() == []


class FakeReader:
    """One topic, and the publishers that are there."""

    def __init__(self, name: str, writers: set[int]) -> None:
        self.name, self.messages, self._writers = name, [], writers

    def take(self, tell: Any = None) -> list[Any]:
        found, self.messages = self.messages, []
        return found

    def writer(self, handle: int) -> Any:
        return SimpleNamespace(participant_key=UUID(int=handle)) if handle in self._writers else None


def test_what_a_node_holds_down_is_let_go_when_it_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[str, list[float]]] = []

    class FakeRosClient:
        def __init__(self, system: str, to: str, called: str, peer: int = 0, holder: str = "") -> None:
            self.instance, self.sent_ns, self.seen, self.program = to, 0, None, called

        def join(self) -> None: ...

        def send(self, name: str, values: Any, text: str) -> int:
            sent.append((name, list(values)))
            return len(sent)

        def poll(self) -> list[Any]:
            return []

    monkeypatch.setattr(carrying_out, "Client", FakeRosClient)
    writers, readers = {5, 6}, dict[str, FakeReader]()
    node: Any = SimpleNamespace(reader=lambda name, *_: readers.setdefault(name, FakeReader(name, writers)),
                                read_as=lambda name, *_, **__: FakeReader(name, writers))
    absent: Any = None
    commands = carrying_out.Commands(node, "x", [carrying_out.Addressee("console", "console")], RosBridge(),
                                     Refusals(lambda *said: None, lambda: 0), joints=lambda view: absent,
                                     last_look=LastLook(int), refuse_move=lambda to: None)

    def say(name: str, pressed: int | None, handle: int) -> None:
        message = Joy(buttons=[] if pressed is None else [pressed])
        message.sample_info = SimpleNamespace(publication_handle=handle, source_timestamp=0)  # type: ignore[attr-defined]
        readers[f"console/{name}"].messages.append(message)
        for wish in commands.take():
            wish.carry_out()
        commands.hear()

    def leave(handle: int) -> None:
        writers.discard(handle)
        sent.clear()
        commands.hear()

    say("emulate_operator_present", 1, 5)
    say("emulate_operator_present", None, 5)  # refused, as it has no button
    say("emulate_clutch", 1, 6)
    leave(6)
    assert sent == []
    leave(5)
    assert sent == [("emulate_operator_present", [0.0])]
    leave(5)
    assert sent == [], "once"
    writers.add(5)
    say("emulate_operator_present", 1, 5)
    say("emulate_operator_present", 0, 5)
    leave(5)
    assert sent == [], "it has let go itself"
