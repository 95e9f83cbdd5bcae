"""Who finds no place is told who has them; a stop always gets through, and nothing asked before it is done after it."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.cases import cases
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import place as p
from trocar.shm.mailbox.mailbox import MAX_STOPS, Mailbox
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMANDS_DEPTH, RESERVED, MailboxMap, create_mailbox
from trocar.shm.mailbox.place import MailboxFull, Place, StopPlace, take_place
from trocar.shm.memory.segment import SegmentError, segment_name, unlink

HOLDER = """
import sys
from trocar.shm.mailbox.place import take_place
kept = [take_place(sys.argv[1], "PSM1", sys.argv[2]) for _ in range(int(sys.argv[3]))]
print("there", flush=True)
sys.stdin.read()
"""
IN_THE_PLACE = """
import sys
from trocar.shm.mailbox.place import StopPlace
stops = StopPlace(sys.argv[1], "PSM1", "plan.py")
stops._enter(1)
print("there", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """A system with the mailboxes of an arm, an io and a console."""
    for instance, kind in (("PSM1", "arm"), ("IO1", "io"), ("console", "console")):
        create_mailbox(world.name, instance, kind, COMMANDS[kind])
    yield world.name
    for instance in ("PSM1", "IO1", "console"):
        unlink(segment_name(world.name, instance, "mailbox"))


@pytest.fixture
def open_now(system: str) -> Iterator[Any]:
    """Opens what is closed after the test: `open_now(Mailbox, "PSM1", COMMANDS["arm"])`."""
    with contextlib.ExitStack() as stack:
        yield lambda make, *words: stack.enter_context(contextlib.closing(make(system, *words)))


def names(box: Mailbox) -> list[str]:
    return [got.name for got in box.drain()]


def replies(place: Place) -> list[tuple[int, str, str]]:
    return [(r.id, r.outcome, r.text) for r in place.poll()]


@pytest.mark.slow
def test_who_has_all_places_is_named(world: Any, open_now: Any) -> None:
    children = []
    for program, count in (("trocar attach", "3"), ("plan\x1b[31m.py", "1")):
        children.append(world.start(HOLDER, program, count))
        assert children[-1].stdout.readline() == "there\n"
    for _ in range(CLIENTS - 4):
        open_now(take_place, "PSM1", "here.py")
    with pytest.raises(SegmentError) as reported:
        open_now(take_place, "PSM1")
    several, one = (child.pid for child in children)
    assert str(reported.value) == ("PSM1: all 16 places for commands are taken: "
                                   f"trocar attach (pid {several}, 3 places), "
                                   f"plan\ufffd[31m.py (pid {one}), here.py (pid {os.getpid()}, 12 places); close one")
    world.kill(children[1])
    open_now(take_place, "PSM1")
    world.kill(children[0])


def test_a_holder_that_does_not_say_so_is_not_called_by_the_name_of_the_dead(world: Any, open_now: Any) -> None:
    child = world.start(HOLDER, "gone.py", "16")
    assert child.stdout.readline() == "there\n"
    world.kill(child)
    hand = MailboxMap(world.name, "PSM1")
    locks = p.Places(hand.segment, hand.locks, CLIENTS)
    assert all(locks.take(place) for place in range(CLIENTS))  # takes a place and writes nothing down
    with pytest.raises(SegmentError, match=r"taken: a program that does not say its name \(16 places\); close one"):
        open_now(take_place, "PSM1")
    hand.segment.close()


def test_places_out_of_step_are_told_apart_from_those_that_are_taken(system: str, open_now: Any) -> None:
    hand = MailboxMap(system, "PSM1")
    taken = [open_now(take_place, "PSM1", "here.py") for _ in range(CLIENTS - 1)]
    hand.words[hand.cursor("taken", CLIENTS - 1)] = 7
    with pytest.raises(SegmentError, match=r"here.py \(pid \d+, 15 places\); 1 are out of step until PSM1 runs again"):
        open_now(take_place, "PSM1")
    hand.segment.close()
    assert len(taken) == 15


def test_a_stop_gets_through_when_all_places_are_taken(open_now: Any) -> None:
    box, stops = open_now(Mailbox, "PSM1", COMMANDS["arm"]), open_now(StopPlace, "PSM1", "trocar send")
    for _ in range(CLIENTS):
        open_now(take_place, "PSM1")
    numbers = [stops.stop("hold"), stops.stop("state_command", (), "disable")]
    assert numbers == [-1, -2]
    for got in box.drain():
        got.accept()
        got.done(got.name)
    assert [(r.id, r.outcome, r.text) for r in stops.answers()] == [
        (-1, "accepted", ""), (-1, "done", "hold"), (-2, "accepted", ""), (-2, "done", "state_command")]
    assert stops.answers() == []


def test_two_who_stop_get_their_own_answers(open_now: Any) -> None:
    box = open_now(Mailbox, "PSM1", COMMANDS["arm"])
    one, other = open_now(StopPlace, "PSM1"), open_now(StopPlace, "PSM1")
    sent = [stops.stop("hold") for stops in (one, other, one)]
    for got in box.drain():
        got.done(str(-got.id))
    assert [(r.id, r.text) for r in one.answers()] == [(n, str(n)) for n in (sent[0], sent[2])]
    assert [(r.id, r.text) for r in other.answers()] == [(sent[1], str(sent[1]))]


@pytest.mark.parametrize(("name", "values", "text"), [
    ("move_jp", (0.0,), ""), ("state_command", (), "enable"), ("crtk_version", (), ""), ("free", (), "")])
def test_nothing_but_stops_goes_through_their_place(open_now: Any, name: str, values: Any, text: str) -> None:
    box, stops = open_now(Mailbox, "PSM1", COMMANDS["arm"]), open_now(StopPlace, "PSM1")
    stops.stop(name, values, text)
    assert names(box) == []
    assert [(r.outcome, r.text) for r in stops.answers()] == [
        ("refused", f"{name}: this mailbox slot accepts only stop commands")]


def test_what_was_asked_before_a_stop_is_not_done_after_it(open_now: Any) -> None:
    box = open_now(Mailbox, "PSM1", COMMANDS["arm"])
    mine, foreign = open_now(take_place, "PSM1", "plan.py"), open_now(take_place, "PSM1")
    for _ in range(COMMANDS_DEPTH):
        mine.send("move_jp", (1.0,))
    foreign.send("state_command", (), "enable")
    foreign.send("crtk_version")
    open_now(StopPlace, "PSM1", "trocar send").stop("hold")
    later = foreign.send("move_jp", (2.0,))
    ran = [got for _ in range(6) for got in box.drain()]
    assert [(got.name, got.id) for got in ran] == [("hold", 1), ("crtk_version", 2), ("move_jp", later)]
    printed = f"stopped by trocar send (pid {os.getpid()})"
    assert {r.text for r in mine.poll()} == {printed}
    assert replies(foreign) == [(1, "refused", printed)]


def test_a_stop_in_a_place_of_ones_own_ends_what_others_asked_before(open_now: Any) -> None:
    box = open_now(Mailbox, "PSM1", COMMANDS["arm"])
    mine, foreign = open_now(take_place, "PSM1", "plan.py"), open_now(take_place, "PSM1")
    foreign.send("move_jp", (1.0,))
    mine.send("hold")
    mine.send("move_jp", (2.0,))
    box._last = 0  # so that our place is looked at first
    assert [(got.name, got.values.tolist()) for got in box.drain()] == [("hold", []), ("move_jp", [2.0])]
    assert replies(foreign) == [(1, "refused", f"stopped by plan.py (pid {os.getpid()})")]


def test_a_command_that_was_held_up_on_its_way_is_not_done_after_a_stop(
    open_now: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, held_up = open_now(Mailbox, "PSM1", COMMANDS["arm"]), open_now(take_place, "PSM1")
    before = p.monotonic_ns()
    open_now(StopPlace, "PSM1").stop("hold")
    assert names(box) == ["hold"]
    monkeypatch.setattr(p, "monotonic_ns", lambda: before)
    held_up.send("move_jp", (1.0,))
    assert names(box) == [] and replies(held_up)[0][1] == "refused"


def test_a_stop_from_the_future_does_not_block_what_comes_after(
    open_now: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, mine = open_now(Mailbox, "PSM1", COMMANDS["arm"]), open_now(take_place, "PSM1")
    with monkeypatch.context() as patch:
        patch.setattr(p, "monotonic_ns", lambda: 2**62)
        mine.send("hold")
    assert names(box) == ["hold"]
    mine.send("move_jp", (1.0,))
    assert names(box) == ["move_jp"]


def test_a_stop_of_one_robot_leaves_the_others_alone(open_now: Any) -> None:
    box, mine = open_now(Mailbox, "IO1", COMMANDS["io"]), open_now(take_place, "IO1")
    for robot in ("PSM1", "PSM2"):
        mine.send("power_on", (), robot)
        mine.send("set_gains", (0.0, 1.0), f"{robot} p_gain")
    open_now(StopPlace, "IO1").stop("power_off", (1.0,), "PSM1")
    assert [(got.name, got.text) for got in box.drain()] == [
        ("power_off", "PSM1"), ("power_on", "PSM2"), ("set_gains", "PSM2 p_gain")]


def test_stops_of_things_that_are_not_there_do_not_fill_the_memory(open_now: Any) -> None:
    box, mine = open_now(Mailbox, "IO1", COMMANDS["io"]), open_now(take_place, "IO1")
    mine.send("power_on", (), "PSM1")
    stops = open_now(StopPlace, "IO1")
    for i in range(3 * MAX_STOPS):
        stops.stop("servo_zero", (), f"robot {i} of none")
        while box.has_news:
            list(box.drain())
    assert len(box._stops) <= MAX_STOPS


@cases(("kind", "name", "values", "text", "stops"), [
    ("arm", "hold", (), "", True), ("arm", "state_command", (), "disable", True),
    ("arm", "state_command", (), "pause", True), ("arm", "state_command", (), "enable", False),
    ("arm", "servo_jf", (0.0, 0.0), "", False), ("arm", "free", (), "", False),
    ("console", "teleop_enable", (0.0,), "", True), ("console", "teleop_enable", (1.0,), "", False),
    ("console", "teleop_enable", (float("nan"),), "", False), ("console", "unselect_teleop", (), "left", True),
    ("io", "power_off", (1.0,), "PSM1", True), ("system", "power_off", (), "", True),
    ("suj", "clutch", (0.0,), "PSM1", True), ("suj", "clutch", (1.0,), "PSM1", False),
    ("suj", "set_lift_velocity", (0.0,), "", True), ("teleop", "clutch", (0.0,), "", False),
    ("supervisor", "stop", (), "", True), ("supervisor", "restart", (), "PSM1", False),
])
def test_what_is_a_stop(kind: str, name: str, values: tuple[float, ...], text: str, stops: bool) -> None:
    (row,) = [row for row in COMMANDS[kind] if row.name == name]
    assert row.is_stop(text, values) == stops
    assert not (stops and row.expires(text, values))


def test_who_does_not_leave_the_place_for_stops_is_named(world: Any, open_now: Any) -> None:
    child, stops = world.start(IN_THE_PLACE), open_now(StopPlace, "PSM1", "trocar send")
    assert child.stdout.readline() == "there\n"
    with pytest.raises(SegmentError, match=rf"^PSM1: the place for stops is taken: plan.py \(pid {child.pid}\)$"):
        stops.stop("hold", (), "", 3)
    world.kill(child)
    assert stops.stop("hold") == -1


def test_a_place_for_stops_out_of_step_is_used_when_its_owner_has_looked(
    system: str, open_now: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, stops = open_now(Mailbox, "PSM1", COMMANDS["arm"]), open_now(StopPlace, "PSM1")
    hand = MailboxMap(system, "PSM1")
    hand.words[hand.cursor("taken", RESERVED)] = 9
    with pytest.raises(SegmentError, match="PSM1: the place for stops is out of step until PSM1 runs again"):
        stops.stop("hold", (), "", 2)
    monkeypatch.setattr(p, "pause", lambda seconds: list(box.drain()))  # the owner runs while we wait
    stops.stop("hold")
    assert [got.name for got in box.drain()] == ["hold"]
    hand.segment.close()


def test_stops_that_nobody_takes_fill_their_place_too(open_now: Any) -> None:
    stops = open_now(StopPlace, "PSM1")
    for _ in range(COMMANDS_DEPTH):
        stops.stop("hold")
    with pytest.raises(MailboxFull, match=re.escape("PSM1 has not taken the last 32 commands")):
        stops.stop("hold")
    box = open_now(Mailbox, "PSM1", COMMANDS["arm"])
    assert sum(len(names(box)) for _ in range(4)) == COMMANDS_DEPTH
    assert stops.stop("hold") == -33
