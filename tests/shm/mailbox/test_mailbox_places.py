"""Places of a mailbox that were left out of step, full or half answered: put right, and nothing runs twice."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.conftest import World
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import mailbox as m
from trocar.shm.mailbox.command_row import READ, CommandRow
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import MailboxMap, create_mailbox
from trocar.shm.mailbox.place import take_place
from trocar.shm.memory.segment import SegmentError, segment_name, unlink


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    create_mailbox(world.name, "IO1", "io", COMMANDS["io"])
    yield world.name
    unlink(segment_name(world.name, "IO1", "mailbox"))


@pytest.mark.parametrize(("value", "before", "attempts"), [(1, 0, 1), (1, 3, 2), (33, 3, 1), (2**64 - 1, 0, 2)])
@pytest.mark.parametrize("which", m.CURSORS[:3])
def test_a_place_out_of_step_is_put_right_and_used_again(
    system: str, which: str, value: int, before: int, attempts: int
) -> None:
    owner, hand = Mailbox(system, "IO1", COMMANDS["io"]), MailboxMap(system, "IO1")
    for _ in range(3):  # what was put right once can be spoilt again
        with contextlib.closing(take_place(system, "IO1")) as first:
            for _ in range(before):
                first.send("power_off", (1,))
            for got in owner.drain():
                got.done()
            hand.words[hand.cursor(which, 0)] = value
        for _ in range(attempts):
            with contextlib.closing(take_place(system, "IO1")):
                pass
        assert [got for _ in range(5) for got in owner.drain()] == []
        with contextlib.closing(take_place(system, "IO1")) as heir:
            assert heir._sent == hand.cursor("sent", 0)
            number = heir.send("power_off", (2,), "heir")
            (got,) = owner.drain()
            got.done("fine")
            assert (got.id, got.text) == (number, "heir")
            reply = heir.poll()[-1]
            assert (reply.id, reply.outcome, reply.text) == (number, "done", "fine")
    owner.close()
    hand.segment.close()


def test_a_place_that_looks_full_is_passed_over(system: str) -> None:
    owner, hand = Mailbox(system, "IO1", COMMANDS["io"]), MailboxMap(system, "IO1")
    hand.words[hand.cursor("sent", 0)] = 2 * m.COMMANDS_DEPTH
    assert list(owner.drain()) == []
    hand.words[hand.cursor("taken", 0)] = m.COMMANDS_DEPTH
    for place in (1, 0):
        with contextlib.closing(take_place(system, "IO1")) as client:
            assert client._sent == hand.cursor("sent", place)
            number = client.send("power_off", (), "now")
            assert [got.id for got in owner.drain() if got.text == "now"] == [number]
        owner.close()
        owner = Mailbox(system, "IO1", COMMANDS["io"])
        owner.refuse_waiting("just started")
    owner.close()
    hand.segment.close()


def test_what_a_dead_client_filled_its_place_with_is_run(system: str) -> None:
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    with contextlib.closing(take_place(system, "IO1")) as client:
        for i in range(m.COMMANDS_DEPTH):
            client.send("power_off", (i,))
    with contextlib.closing(take_place(system, "IO1")) as heir:
        heir.send("power_off", (-1,))
        got = [int(c.values[0]) for _ in range(5) for c in owner.drain()]
    assert sorted(got) == [-1, *range(m.COMMANDS_DEPTH)]
    owner.close()


def test_a_place_nobody_used_since_is_put_right_again(system: str) -> None:
    owner, hand = Mailbox(system, "IO1", COMMANDS["io"]), MailboxMap(system, "IO1")
    for garbage in (1, 5, 1, 7):
        hand.words[hand.cursor("taken", 0)] = garbage
        with contextlib.closing(take_place(system, "IO1")) as elsewhere:
            assert elsewhere._sent == hand.cursor("sent", 1)
        assert list(owner.drain()) == []
        with contextlib.closing(take_place(system, "IO1")) as here:
            assert here._sent == hand.cursor("sent", 0)
    assert owner.resets == 4
    owner.close()
    hand.segment.close()


@pytest.mark.parametrize("forged", [1, 7, m.COMMANDS_DEPTH])
def test_what_was_run_is_not_run_again_when_a_cursor_says_so(system: str, forged: int) -> None:
    owner, client = Mailbox(system, "IO1", COMMANDS["io"]), take_place(system, "IO1")
    for _ in range(2 * m.COMMANDS_DEPTH):
        client.send("power_off", (1,))
        for got in owner.drain():
            got.done()
    client.poll()
    client._words[client._sent] += forged
    ran = [got for _ in range(5) for got in owner.drain()]
    assert ran == []
    replies = client.poll()
    assert [r.id for r in replies] == list(range(65, 65 + forged)) and {r.outcome for r in replies} == {"refused"}
    assert replies[0].text == "the slot of command 65 holds command 33"
    owner.close()
    client.close()


@pytest.mark.parametrize("before", [0, 1, m.REPLIES_DEPTH - 1, m.REPLIES_DEPTH, 2 * m.REPLIES_DEPTH])
def test_an_answer_whose_cursor_was_not_moved_counts(system: str, before: int) -> None:
    owner, client = Mailbox(system, "IO1", COMMANDS["io"]), take_place(system, "IO1")
    for _ in range(before):
        client.send("power_off")
        for got in owner.drain():
            got.done()
        client.poll()
    number = client.send("power_off")
    (got,) = owner.drain()
    got.done("just in time")
    owner._words[owner._answered_at[0]] = before  # as it is between A3 and A4
    owner.close()
    assert client.poll() == []
    heir = Mailbox(system, "IO1", COMMANDS["io"])  # V1
    assert [(r.id, r.outcome, r.text) for r in client.poll()] == [(number, "done", "just in time")]
    next_number = client.send("power_off")
    (got,) = heir.drain()
    got.done("next")
    assert [(r.id, r.text) for r in client.poll()] == [(next_number, "next")] and client.lost == 0
    heir.close()
    client.close()


@pytest.mark.parametrize("waiting", [0, 3])
def test_a_command_its_owner_died_of_fails_once(system: str, waiting: int) -> None:
    owner, client = Mailbox(system, "IO1", COMMANDS["io"]), take_place(system, "IO1")
    fatal = client.send("power_off", (1,), "fatal")
    (got,) = owner.drain()  # N3 is done, N4 is not
    assert got.id == fatal
    later = [client.send("power_off", (2,)) for _ in range(waiting)]
    owner.close()
    run: list[int] = []
    for _ in range(3):
        heir = Mailbox(system, "IO1", COMMANDS["io"])  # V2
        for got in heir.drain():
            run.append(got.id)
            got.done()
        heir.close()
    assert run == later
    replies = [(r.id, r.outcome, r.text) for r in client.poll()]
    assert replies == [(fatal, "failed", m.DIED), *((number, "done", "") for number in later)]
    client.close()


def test_an_owner_sees_whether_somebody_is_in_the_place_of_a_command(system: str) -> None:
    owner = Mailbox(system, "IO1", COMMANDS["io"])
    with contextlib.closing(take_place(system, "IO1")) as client:
        client.send("power_off")
        (got,) = owner.drain()
        assert got.has_client
    assert not got.has_client
    with contextlib.closing(take_place(system, "IO1")):
        assert got.has_client and got.pid
    owner.close()


def test_an_owner_with_another_command_table_is_refused(system: str) -> None:
    rows = COMMANDS["io"]
    with pytest.raises(SegmentError, match="its commands are not those of this program"):
        Mailbox(system, "IO1", (rows[0], CommandRow("new", READ, "one more"), *rows[1:]))


def test_a_sender_goes_by_the_table_that_the_mailbox_lists(world: World) -> None:
    rows = (CommandRow("new", READ, "one more"), *COMMANDS["io"])
    create_mailbox(world.name, "IO2", "io", rows)
    owner, sender = Mailbox(world.name, "IO2", rows), take_place(world.name, "IO2")
    sender.send("new")
    assert [command.name for command in owner.drain(time.monotonic_ns())] == ["new"]
    sender.close()
    owner.close()
    world.remove()
