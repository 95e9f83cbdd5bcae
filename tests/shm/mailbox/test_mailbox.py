"""The mailbox: nothing lost, nothing run twice, order kept, and no client can disturb the owner's loop."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import mailbox as m
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMAND_HEAD, create_mailbox
from trocar.shm.mailbox.place import MailboxFull, Place, take_place
from trocar.shm.mailbox.received import DONE
from trocar.shm.memory.segment import SegmentError, segment_name, unlink

CLIENT = """
import sys
from trocar.shm.mailbox.place import take_place
client = take_place(sys.argv[1], "IO1")
for i in range(int(sys.argv[2])):
    client.send("power_off", (i,), "child")
print("sent", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """A system with one mailbox, of an io process."""
    create_mailbox(world.name, "IO1", "io", COMMANDS["io"])
    yield world.name
    unlink(segment_name(world.name, "IO1", "mailbox"))


@pytest.fixture
def box(system: str) -> Iterator[Mailbox]:
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    yield owner
    owner.close()


@pytest.fixture
def client(system: str) -> Iterator[Place]:
    sender = take_place(system, "IO1")
    yield sender
    sender.close()


def test_a_command_arrives_as_it_was_sent(box: Mailbox, client: Place) -> None:
    number = client.send("bias_encoders", (1, 0.5, -2e9), "PSM1 · größer")
    (got,) = box.drain()
    assert (got.name, got.text, got.id) == ("bias_encoders", "PSM1 · größer", number)
    assert got.values.dtype == np.float64 and got.values.tolist() == [1.0, 0.5, -2e9]
    assert list(box.drain()) == []


@examples(100)
@given(values=st.lists(st.floats(allow_nan=False), max_size=64),
       text=st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=16))
def test_any_numbers_and_text_survive(values: list[float], text: str) -> None:
    name = f"tmail{os.getpid()}"
    create_mailbox(name, "IO1", "io", COMMANDS["io"])
    owner, sender = Mailbox(name, "IO1", COMMANDS["io"]), take_place(name, "IO1")
    try:
        sender.send("bias_encoders", values, text)
        sender.send("bias_encoders", np.array(values), text)
        for got in owner.drain():
            assert got.values.tolist() == values and got.text == text
    finally:
        owner.close()
        sender.close()
        unlink(segment_name(name, "IO1", "mailbox"))


def test_a_command_stays_that_of_its_sender_where_another_takes_the_place(
        system: str, box: Mailbox, client: Place) -> None:
    client.send("power_off")
    (received,) = box.drain()
    before = received.pid
    box._map.sign(received.place, before + 1, "another")
    assert received.pid == before == os.getpid()


def test_received_values_are_our_own(box: Mailbox, client: Place) -> None:
    client.send("bias_encoders", (1, 2))
    (got,) = box.drain()
    for _ in range(40):
        client.send("bias_encoders", (7, 7))
        list(box.drain())
    assert got.values.tolist() == [1.0, 2.0]


def test_order_of_one_client_is_kept(box: Mailbox, client: Place) -> None:
    for i in range(20):
        client.send("power_off", (i,))
    rounds = [[int(c.values[0]) for c in box.drain()] for _ in range(4)]
    assert rounds == [list(range(8)), list(range(8, 16)), list(range(16, 20)), []]


def test_each_client_gets_its_share(system: str, box: Mailbox) -> None:
    clients = [take_place(system, "IO1") for _ in range(3)]
    for sender in clients:
        for i in range(10):
            sender.send("power_off", (i,))
    assert [len(list(box.drain())) for _ in range(3)] == [24, 6, 0]
    for sender in clients:
        sender.close()


def test_a_drain_left_early_loses_nothing(box: Mailbox, client: Place) -> None:
    for i in range(4):
        client.send("power_off", (i,))
    assert next(box.drain()).values[0] == 0
    assert [int(c.values[0]) for c in box.drain()] == [1, 2, 3]


def test_full_means_refused_and_nothing_lost(box: Mailbox, client: Place) -> None:
    for i in range(m.COMMANDS_DEPTH):
        client.send("power_off", (i,))
    with pytest.raises(MailboxFull, match="IO1 has not taken the last 32"):
        client.send("power_off", (99,))
    first = [int(c.values[0]) for c in box.drain()]
    client.send("power_off", (100,))
    rest = [int(c.values[0]) for _ in range(5) for c in box.drain()]
    assert first + rest == [*range(m.COMMANDS_DEPTH), 100]


def test_every_outcome_comes_back(box: Mailbox, client: Place) -> None:
    ids = [client.send("power_on", text="PSM1") for _ in range(4)]
    for answer, got in zip(("accept", "refuse", "done", "fail"), box.drain(), strict=True):
        getattr(got, answer)(f"{answer} it")
    replies = client.poll()
    assert [r.id for r in replies] == ids
    assert [r.outcome for r in replies] == ["accepted", "refused", "done", "failed"]
    assert [r.text for r in replies] == ["accept it", "refuse it", "done it", "fail it"]
    assert client.poll() == []


def test_overwritten_replies_are_counted(box: Mailbox, client: Place) -> None:
    client.send("power_on")
    (got,) = box.drain()
    for i in range(m.REPLIES_DEPTH + 5):
        got.done(str(i))
    replies = client.poll()
    assert [r.text for r in replies] == [str(i) for i in range(5, m.REPLIES_DEPTH + 5)] and client.lost == 5


def test_long_reasons_are_cut_between_characters(box: Mailbox, client: Place) -> None:
    client.send("power_on")
    (got,) = box.drain()
    got.refuse("ü" * 300)
    assert client.poll()[0].text == "ü" * 98 + "…"


def test_more_streams_than_are_remembered_keep_their_texts_numbers_and_senders(box: Mailbox, client: Place) -> None:
    for round in range(2):
        for i in range(m.MAX_HEADS + 5):
            values = [float(i)] * (i % 12)
            client.send("bias_encoders", values, f"robot {i}", peer=i % 3)
            (got,) = box.drain()
            assert (got.name, got.text, got.values.tolist()) == ("bias_encoders", f"robot {i}", values), round
            assert got.sender == (0, i % 3)


def test_optional_numbers_are_checked_only_where_given() -> None:
    row = next(row for row in COMMANDS["arm"] if row.name == "servo_cf")
    for count, last, wrong in ((6, 1e8, ""), (8, 1.0, ""), (8, 0.5, "axes"), (8, 2.0, "axes"), (5, 0.0, "takes"),
                               (6, np.nan, "fx"), (6, 1e10, "fx"), (7, np.inf, "time it lasts")):
        for _ in range(2):
            values = np.zeros(count)
            values[-1] = last
            said = row.objection(values, 7)
            assert said.startswith(wrong) and bool(said) == bool(wrong), (count, last, said)


def test_what_cannot_be_sent_is_refused_at_once(client: Place) -> None:
    with pytest.raises(KeyError, match="io has no command fly; it has: power_on"):
        client.send("fly")
    with pytest.raises(ValueError, match="65 values; allowed are 64"):
        client.send("bias_encoders", [0.0] * 65)
    with pytest.raises(ValueError, match="65 bytes; allowed are 64"):
        client.send("power_on", text="x" * 65)
    with pytest.raises(ValueError, match="not numbers"):
        client.send("bias_encoders", ["a"])
    assert client._words[client._map.cursor("sent", 0)] == 0


@pytest.mark.parametrize(("code", "count", "reason"), [
    (len(COMMANDS["io"]), 0, "is not in the table"), (0xFFFF, 3, "command 65535"), (0, 65, "65 values"),
    (0, 0xFFFF, "65535 values"),
])
def test_garbage_in_a_slot_is_refused(box: Mailbox, client: Place, code: int, count: int, reason: str) -> None:
    COMMAND_HEAD.pack_into(client._view, client._queue[1] + m.COMMAND_START, 0, 1, 1, 0, code, count, 0)
    client._words[client._sent] = 1
    assert list(box.drain()) == []
    (reply,) = client.poll()
    assert (reply.id, reply.outcome) == (1, "refused") and reason in reply.text


def test_at_most_sixteen_clients_have_a_place(system: str) -> None:
    clients = [take_place(system, "IO1") for _ in range(CLIENTS)]
    with pytest.raises(SegmentError, match="IO1: all 16 places for commands are taken: "):
        take_place(system, "IO1")
    clients.pop().close()
    clients.append(take_place(system, "IO1"))
    for client in clients:
        client.close()


def test_a_dead_client_s_place_is_reclaimed(world: Any, system: str, box: Mailbox) -> None:
    child = world.start(CLIENT, "5")
    assert child.stdout.readline() == "sent\n"
    others = [take_place(system, "IO1") for _ in range(CLIENTS - 1)]
    with pytest.raises(SegmentError, match="places for commands are taken"):
        take_place(system, "IO1")
    world.kill(child)
    heir = take_place(system, "IO1")
    number = heir.send("power_off", (9,), "heir")
    got = [(c.text, int(c.values[0])) for c in box.drain()]
    assert got == [*(("child", i) for i in range(5)), ("heir", 9)]  # accepted commands still run, before the heir's
    assert number == 6 and heir.poll() == []
    for client in (*others, heir):
        client.close()


def test_commands_wait_for_a_restarted_owner(system: str, client: Place) -> None:
    first = Mailbox(system, "IO1", COMMANDS["io"])
    for i in range(3):
        client.send("power_off", (i,))
    drained = first.drain()
    next(drained).done()
    drained.close()
    first.close()
    second = Mailbox(system, "IO1", COMMANDS["io"])
    for got in second.drain():
        got.done()
    assert [r.id for r in client.poll()] == [1, 2, 3]  # each exactly once
    second.close()


def test_a_loop_hears_no_answers_to_a_predecessor_in_its_place(system: str, box: Mailbox) -> None:
    first = LoopClient(system, "IO1")
    first.send("power_on")
    (begun,) = box.drain()
    begun.accept()
    first.close()
    second = LoopClient(system, "IO1")
    number = second.send("power_off")
    begun.fail("power_off was requested")
    (ended,) = box.drain()
    ended.done()
    assert [(reply.id, reply.outcome) for reply in second.poll()] == [(number, "done")]
    second.close()


def test_a_second_owner_is_refused(system: str, box: Mailbox) -> None:
    with pytest.raises(SegmentError, match=rf"IO1 \(pid {os.getpid()}\)"):
        Mailbox(system, "IO1", COMMANDS["io"])


def test_the_mailbox_describes_its_commands(client: Place) -> None:
    assert [c["name"] for c in client.commands] == [c.name for c in COMMANDS["io"]]
    assert all(c["doc"] for c in client.commands)


def test_a_new_owner_refuses_what_its_predecessor_was_told(system: str, client: Place) -> None:
    for i in range(m.COMMANDS_DEPTH):
        client.send("power_off", (i,))
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    owner.refuse_waiting("just started")
    assert list(owner.drain()) == []
    replies = client.poll()
    assert {(r.outcome, r.text) for r in replies} == {("refused", "just started")}
    last = client.send("power_off", (1,))
    assert [c.id for c in owner.drain()] == [last]
    owner.close()


@pytest.mark.parametrize("before", [0, m.REPLIES_DEPTH - 1, m.REPLIES_DEPTH, 3 * m.REPLIES_DEPTH])
def test_an_answer_cut_short_is_given_anew(system: str, client: Place, before: int) -> None:
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    for i in range(before):
        client.send("power_off", (i,))
        for got in owner.drain():
            got.done()
    client.poll()
    last = client.send("power_off", (99,))
    next(owner.drain())
    n = owner._answered[0] + 1
    at = owner._replies[0][n % m.REPLIES_DEPTH]
    owner._words[at >> 3] = 0  # A1
    m.REPLY_BODY.pack_into(owner._view, at + m.REPLY_START, last, DONE, b"")  # A2; it dies before A3
    owner.close()
    heir = Mailbox(system, "IO1", COMMANDS["io"])
    assert [(r.id, r.outcome, r.text) for r in client.poll()] == [(last, "failed", m.DIED)]
    heir.close()


def test_what_the_dead_had_accepted_is_answered_by_the_successor(system: str, client: Place) -> None:
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    for _ in range(4):
        client.send("power_off")
    quick, slow, slower, last = owner.drain()
    slow.accept()
    quick.accept()
    slower.accept()
    quick.done()
    slow.fail("changed its mind")
    owner.close()
    client.poll()
    heir = Mailbox(system, "IO1", COMMANDS["io"])
    assert [(r.id, r.outcome, r.text) for r in client.poll()] == [(i, "failed", m.DIED) for i in (slower.id, last.id)]
    heir.close()
    Mailbox(system, "IO1", COMMANDS["io"]).close()
    assert client.poll() == []  # once is enough


LATE = m.LATE_NS + 1_000_000


@pytest.mark.parametrize(("name", "values", "text", "runs"), [
    ("power_on", (), "PSM1", False), ("pid_enable", (1,), "PSM1", False), ("power_off", (1,), "PSM1", True),
    ("servo_zero", (), "PSM1", True), ("clear_fault", (), "PSM1", True),
])
def test_what_may_move_the_robot_is_refused_when_it_comes_late(
    box: Mailbox, client: Place, name: str, values: tuple[float, ...], text: str, runs: bool
) -> None:
    client.send(name, values, text)
    got = [c.name for c in box.drain(time.monotonic_ns() + LATE)]
    assert got == ([name] if runs else [])
    assert runs or ["refused" in r.outcome and "late" in r.text for r in client.poll()] == [True]


def test_in_time_and_without_a_clock_nothing_is_late(box: Mailbox, client: Place) -> None:
    client.send("power_on", (), "PSM1")
    assert [c.name for c in box.drain(time.monotonic_ns())] == ["power_on"]
    client.send("power_on", (), "PSM1")
    assert [c.name for c in box.drain()] == ["power_on"]


@pytest.mark.parametrize(("text", "late"), [("home", False), ("enable", False), ("disable", True), ("pause", True)])
def test_a_late_state_command_only_stops(text: str, late: bool) -> None:
    row = next(c for c in COMMANDS["arm"] if c.name == "state_command")
    assert row.expires(text, ()) != late
