"""Whose command it was: who guards its mailbox carries out only what a person asked for after its last fault."""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from tests.conftest import World
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import client as sending
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.client import Client, LoopClient
from trocar.shm.mailbox.command_row import RELAX
from trocar.shm.mailbox.generations import FaultCell, Faults, create_faults
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import COMMANDS_DEPTH, create_mailbox
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.directory import create_ring, reader, topic_of, writer


@pytest.fixture
def system(world: World) -> Iterator[str]:
    create_mailbox(world.name, "PSM1", "arm", COMMANDS["arm"])
    create_faults(world.name, ("PSM1",))
    create_ring(world.name, "PSM1", topic_of("arm", "audit"), {}, {"kind": "arm"})
    yield world.name
    world.remove()


@pytest.fixture
def faults(system: str) -> Iterator[Faults]:
    page = Faults(system, write=True)
    yield page
    page.close()


@pytest.fixture
def cell(faults: Faults) -> FaultCell:
    return FaultCell(faults, "PSM1")


@pytest.fixture
def audit(system: str) -> Iterator[RingReader]:
    ring = reader(system, "PSM1", "audit", "arm")
    yield ring
    ring.close()


@pytest.fixture
def box(system: str, cell: FaultCell) -> Iterator[Mailbox]:
    ring = writer(system, "PSM1", "audit", "arm")
    owner = Mailbox(system, "PSM1", COMMANDS["arm"], guard=cell, audit=Audit(ring, time.monotonic_ns))
    yield owner
    owner.close()
    ring.close()


@pytest.fixture
def person(system: str, box: Mailbox) -> Iterator[Client]:
    client = Client(system, "PSM1")
    yield client
    client.close()


@pytest.fixture
def loop(system: str, box: Mailbox) -> Iterator[LoopClient]:
    client = LoopClient(system, "PSM1")
    yield client
    client.close()


def ran(box: Mailbox) -> list[str]:
    found = list(box.drain())
    for command in found:
        command.done()
    return [command.name for command in found]


def test_a_person_is_served_and_known_by_number_and_program(box: Mailbox, person: Client) -> None:
    person.send("state_command", (), "enable")
    (got,) = box.drain()
    assert got.origin.id and got.origin.generation == 0 and got.origin.program


def test_streams_of_two_handles_of_a_process_are_both_told(system: str, box: Mailbox, audit: RingReader) -> None:
    """They come through the same place."""
    one, other = (Client(system, "PSM1", time_ns=lambda: 0) for _ in range(2))  # no stream pauses, on no machine
    for client in (one, one, other, other):
        client.send("servo_jp", (0.1,) * 6)
        ran(box)
    told = []
    while audit.next():
        told.append(int(audit.field("origin")[()]))
    assert told == [one.origin.id, other.origin.id]
    one.close()
    other.close()


def test_a_process_that_nobody_asked_is_refused(box: Mailbox, loop: LoopClient) -> None:
    loop.send("state_command", (), "enable")
    assert ran(box) == []
    (reply,) = loop.poll()
    assert (reply.outcome, reply.text) == (
        "refused",
        "state_command: not authorized: needs an operator's command given after the last fault, power-off or hold")


def test_a_process_passes_on_whose_command_it_carries_out(box: Mailbox, loop: LoopClient) -> None:
    loop.on_behalf(Origin(77, 0, "trocar home"))
    loop.send("state_command", (), "home")
    (got,) = box.drain()
    assert got.origin == Origin(77, 0, "trocar home")


def test_what_was_queued_at_a_fault_is_refused_and_what_comes_later_runs(
    box: Mailbox, person: Client, cell: FaultCell
) -> None:
    person.send("move_jp", (0.1,) * 6)
    cell.fault()
    person.send("state_command", (), "enable")
    assert ran(box) == ["state_command"]
    assert [reply.outcome for reply in person.poll()] == ["refused", "done"]


def test_an_order_from_before_a_fault_counts_for_nothing_whoever_passes_it_on_when(
    box: Mailbox, loop: LoopClient, cell: FaultCell
) -> None:
    loop.on_behalf(Origin(77, 0, "trocar home"))
    cell.fault()
    loop.send("state_command", (), "enable")
    assert ran(box) == []
    (reply,) = loop.poll()
    assert "not authorized" in reply.text and "trocar home" in reply.text
    cell.void_earlier(Origin(77, 0, "trocar home"))  # a stop is never refused, but makes no void command valid
    loop.send("state_command", (), "enable")
    assert ran(box) == []


def test_a_stream_from_before_a_fault_is_told_to_pause(box: Mailbox, person: Client, cell: FaultCell) -> None:
    for command in ("servo_jp", "move_jp"):
        person.send(command, (0.1,) * 6)
        cell.fault()
        assert ran(box) == []
    streamed, moved = person.poll()
    assert "servo_jp" in streamed.text and "pause" in streamed.text
    assert "move_jp" in moved.text and "pause" not in moved.text


def test_a_power_off_voids_older_orders_but_not_the_one_that_it_was_part_of(
    box: Mailbox, loop: LoopClient, person: Client, cell: FaultCell
) -> None:
    person.send("move_jp", (0.1,) * 6)  # before
    loop.on_behalf(Origin(77, 0, "trocar home"))
    cell.void_earlier(Origin(77, 0, "trocar home"))
    loop.send("state_command", (), "enable")
    assert ran(box) == ["state_command"]
    cell.fault()
    loop.send("state_command", (), "enable")
    assert ran(box) == []


@pytest.mark.parametrize(("name", "values", "text"), [
    ("state_command", (), "disable"), ("hold", (), ""), ("crtk_version", (), ""), ("body/servo_cf", (0.0,) * 6, ""),
    ("unlock_orientation", (), ""),
])
def test_stopping_asking_and_letting_go_need_nobody(
    box: Mailbox, loop: LoopClient, cell: FaultCell, name: str, values: tuple[float, ...], text: str
) -> None:
    cell.fault()
    loop.on_behalf(NO_ORIGIN)
    loop.send(name, values, text)
    assert ran(box) == [name]


def test_a_wrench_that_pushes_needs_a_person(box: Mailbox, loop: LoopClient) -> None:
    loop.send("body/servo_cf", (0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    assert ran(box) == []


def test_a_stream_that_began_before_a_fault_does_not_go_on_after_it(
    box: Mailbox, cell: FaultCell, system: str
) -> None:
    now = SimpleNamespace(ns=10**12)
    person = Client(system, "PSM1", time_ns=lambda: now.ns)

    def goal() -> list[str]:
        person.send("servo_jp", (0.1,) * 6)
        return ran(box)

    assert goal() == ["servo_jp"]
    cell.fault()
    for _ in range(5):
        now.ns += 90_000_000
        assert goal() == []  # one command of a person, of before the fault
    now.ns += 200_000_000
    assert goal() == ["servo_jp"]  # another one
    person.close()


def test_another_command_of_the_same_person_does_not_renew_a_stream(
    box: Mailbox, person: Client, cell: FaultCell
) -> None:
    person.send("servo_jp", (0.1,) * 6)
    cell.fault()
    person.send("state_command", (), "home")
    person.send("servo_jp", (0.1,) * 6)
    assert ran(box) == ["state_command"]


def test_the_steps_of_one_command_have_one_origin_and_none_is_carried_out_after_a_fault(
    system: str, box: Mailbox, person: Client, cell: FaultCell
) -> None:
    person.on_behalf(sending.begin(system))
    origins = []
    for word in ("enable", "home"):
        person.send("state_command", (), word)
        origins += [command.origin for command in box.drain()]
    assert len(origins) == 2 and origins[0] == origins[1] and origins[0].id
    cell.fault()
    person.send("state_command", (), "home")
    assert ran(box) == []
    person.on_behalf(sending.begin(system))
    person.send("state_command", (), "home")
    assert ran(box) == ["state_command"]


def test_the_audit_ring_tells_who_asked_for_what_and_what_became_of_it(
    box: Mailbox, loop: LoopClient, audit: RingReader
) -> None:
    loop.on_behalf(Origin(77, 0, "trocar home"))
    loop.send("state_command", (), "home")
    (got,) = box.drain()
    got.accept()
    got.fail("no power")
    rows = audit.since(0)
    assert [(r["command"], r["text"], r["outcome"], r["reason"], int(r["origin"]), r["program"]) for r in rows] == [
        (b"state_command", b"home", b"accepted", b"", 77, b"trocar home"),
        (b"state_command", b"home", b"failed", b"no power", 77, b"trocar home")]


def test_the_audit_ring_keeps_the_first_of_a_stream_and_its_changes(
    box: Mailbox, person: Client, audit: RingReader, cell: FaultCell
) -> None:
    for _ in range(20):
        person.send("servo_jp", (0.1,) * 6)
        ran(box)
    cell.fault()
    for _ in range(20):
        person.send("servo_jp", (0.1,) * 6)
        ran(box)
    assert [row["outcome"] for row in audit.since(0)] == [b"done", b"refused"]


def test_the_audit_ring_has_the_numbers_of_commands(box: Mailbox, person: Client, audit: RingReader) -> None:
    for values in ((0.5,) * 6, tuple(range(8))):
        person.send("move_jp", values)
        ran(box)
    rows = audit.since(0)
    assert rows["count"].tolist() == [6, 8] and rows["values"][0].tolist() == [0.5] * 6 + [0.0] * 58
    assert rows["values"][1][:9].tolist() == [*range(8), 0.0]


def test_in_lock_step_all_goals_of_a_persons_stream_are_in_the_audit_ring(
    box: Mailbox, person: Client, loop: LoopClient, audit: RingReader
) -> None:
    assert box.audit is not None
    box.audit._every = True
    loop.on_behalf(Origin(77, 0, "teleop"))
    for k in range(5):
        person.send("servo_jp", (k * 0.1,) * 6)
        ran(box)
    for _ in range(5):
        loop.send("servo_jp", (0.3,) * 6)
        ran(box)
    assert audit.since(0)["values"][:, 0].tolist() == [k * 0.1 for k in range(5)] + [0.3], "what is passed on once"


def test_every_command_that_may_power_or_move_needs_an_operator_unless_it_only_ends_something() -> None:
    free = {(kind, row.name) for kind, rows in COMMANDS.items() for row in rows
            if row.effect >= RELAX and not row.needs_operator("", (0.5,))}
    assert free == {("io", "power_off"), ("io", "servo_zero"), ("arm", "hold"), ("third_party", "hold"),
                    ("console", "unselect_teleop"), ("system", "power_off"), ("system", "hold"),
                    ("boards", "release_tip"), ("supervisor", "stop")}


def test_clients_of_one_bridge_are_different_senders(system: str, box: Mailbox) -> None:
    handles = [Client(system, "PSM1", peer=peer) for peer in (0, 7, 8, 7)]
    for handle in handles:
        handle.send("crtk_version")
    senders = [got.sender for got in box.drain()]
    assert senders[1] == senders[3] and len(set(senders)) == 3 and {each.place for each in senders} == {0}
    for handle in handles:
        handle.close()


def test_a_stop_through_the_place_for_stops_is_that_of_its_program(system: str, box: Mailbox, person: Client) -> None:
    for _ in range(COMMANDS_DEPTH):
        person.send("crtk_version")
    assert person.send("hold") < 0
    senders = {got.sender for _ in range(5) for got in box.drain()}
    assert len(senders) == 1


class MovedClock:
    """The machine's time, which a test moves on."""

    def __init__(self) -> None:
        self.more_ns = 0

    def __call__(self) -> int:
        return time.monotonic_ns() + self.more_ns


LONG_NS = 150_000_000  # a stream that pauses so long has ended


@pytest.fixture
def clock() -> MovedClock:
    return MovedClock()


@pytest.fixture
def streamer(system: str, box: Mailbox, clock: MovedClock) -> Iterator[Client]:
    client = Client(system, "PSM1", time_ns=clock)
    yield client
    client.close()


def test_a_message_that_waited_counts_from_when_it_may_have_been_sent(
        person: Client, system: str, box: Mailbox) -> None:
    other = Client(system, "PSM1", peer=7)
    person.sent_ns = time.monotonic_ns()
    other.send("hold")
    assert ran(box) == ["hold"]
    person.send("move_jp", [0.0] * 6)
    assert ran(box) == [] and person.poll()[-1].text.startswith("stopped by")
    person.sent_ns = time.monotonic_ns()
    person.send("move_jp", [0.0] * 6)
    assert ran(box) == ["move_jp"]
    other.close()


def test_a_stop_that_waited_voids_all_that_was_sent_until_now_but_what_its_sender_sends_after_it(
        person: Client, system: str, box: Mailbox) -> None:
    other = Client(system, "PSM1", peer=7)
    person.sent_ns = time.monotonic_ns()
    other.send("move_jp", [0.0] * 6)
    person.send("hold")
    person.send("move_jp", [0.0] * 6)
    other.sent_ns = person.sent_ns
    other.send("move_jp", [0.0] * 6)
    assert ran(box) == ["move_jp", "hold", "move_jp"]
    outcomes = sorted(reply.outcome for reply in other.poll())
    assert outcomes == ["done", "refused"], "one came before the stop, one too late"
    other.close()


def test_a_stream_whose_bridge_stalls_does_not_begin_anew(
        streamer: Client, box: Mailbox, cell: FaultCell, clock: MovedClock) -> None:
    streamer.send("servo_jp", [0.0] * 6)
    assert ran(box) == ["servo_jp"]
    streamer.sent_ns = clock()
    cell.fault()
    clock.more_ns += LONG_NS
    streamer.send("servo_jp", [0.0] * 6)
    assert ran(box) == [], "it only seems to have paused"
    streamer.sent_ns = clock()
    clock.more_ns += LONG_NS
    streamer.pass_over()
    streamer.sent_ns = clock()
    streamer.send("servo_jp", [0.0] * 6)
    assert ran(box) == [], "a goal that was left out is one of the stream"
    clock.more_ns += LONG_NS
    streamer.sent_ns = 0
    streamer.send("servo_jp", [0.0] * 6)
    assert ran(box) == ["servo_jp"]


def test_a_stream_that_a_new_bridge_finds_has_no_origin_until_it_pauses(
        streamer: Client, box: Mailbox, clock: MovedClock) -> None:
    streamer.join()
    for _ in range(3):
        streamer.send("servo_jp", [0.0] * 6)
        assert ran(box) == []
    clock.more_ns += LONG_NS
    streamer.send("servo_jp", [0.0] * 6)
    assert ran(box) == ["servo_jp"]
