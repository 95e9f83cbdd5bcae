"""Handles of one process share a place: replies reach their sender, threads and forks harm nobody, stops come out."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import KEPT, Client, LoopClient
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMANDS_DEPTH, MailboxMap, create_mailbox
from trocar.shm.mailbox.origins import program_name
from trocar.shm.mailbox.place import MailboxFull, Places, take_place
from trocar.shm.memory.segment import SegmentError, segment_name, unlink

Open = Callable[..., Any]


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    create_mailbox(world.name, "PSM1", "arm", COMMANDS["arm"])
    yield world.name
    unlink(segment_name(world.name, "PSM1", "mailbox"))


@pytest.fixture
def open_now(system: str) -> Iterator[Open]:
    """Opens what is closed after the test: a Client unless told otherwise."""
    with contextlib.ExitStack() as stack:
        yield lambda make=Client, *words: stack.enter_context(contextlib.closing(make(system, "PSM1", *words)))


@pytest.fixture
def box(open_now: Open) -> Mailbox:
    owner: Mailbox = open_now(Mailbox, COMMANDS["arm"])
    return owner


def taken(system: str) -> list[int]:
    """Places that somebody has."""
    hand = MailboxMap(system, "PSM1")
    locks = Places(hand.segment, hand.locks, CLIENTS)
    found = []
    for place in range(CLIENTS):
        if locks.take(place):
            locks.give_back(place)
        else:
            found.append(place)
    hand.segment.close()
    return found


def serve(box: Mailbox) -> list[str]:
    """Runs what came in; each is done, and says its numbers."""
    ran = []
    for got in box.drain():
        ran.append(got.name)
        got.done(str(got.values.tolist()))
    return ran


def in_child(work: Callable[[], object]) -> str:
    """What a forked child says of its work."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        reported = ""
        try:
            reported = str(work())
        except BaseException as error:
            reported = f"{type(error).__name__}: {error}"
        finally:
            os.write(writing, reported.encode())
            os._exit(0)
    os.close(writing)
    os.waitpid(pid, 0)
    with os.fdopen(reading) as reported_by_child:
        return reported_by_child.read()


def test_a_process_has_one_place_however_many_handles(system: str, box: Mailbox, open_now: Open) -> None:
    handles = [open_now() for _ in range(3 * CLIENTS)]
    assert taken(system) == []
    for handle in handles:
        assert handle.send("hold")
    assert taken(system) == [0]
    for handle in handles[1:]:
        handle.close()
        handle.close()
    assert taken(system) == [0]
    handles[0].close()
    assert taken(system) == []


def test_replies_reach_the_handle_that_sent_the_command(box: Mailbox, open_now: Open) -> None:
    one, other = open_now(), open_now()
    for i in range(4):
        (one, other)[i % 2].send("crtk_version", (i,))
    serve(box)
    assert [r.text for r in other.poll()] == ["[1.0]", "[3.0]"]
    assert [r.text for r in one.poll()] == ["[0.0]", "[2.0]"]
    assert one.poll() == other.poll() == []


def test_a_command_under_way_is_answered_twice(box: Mailbox, open_now: Open) -> None:
    one, other = open_now(), open_now()
    number = one.send("move_jp", (1.0,))
    (got,) = box.drain()
    got.accept()
    assert other.poll() == [] and [r.outcome for r in one.poll()] == ["accepted"]
    other.send("crtk_version")
    serve(box)
    got.done()
    assert [(r.id, r.outcome) for r in one.poll()] == [(number, "done")] and len(other.poll()) == 1


def test_answers_to_the_dead_and_to_the_closed_reach_nobody(system: str, box: Mailbox, open_now: Open) -> None:
    with contextlib.closing(take_place(system, "PSM1")) as dead:
        dead.send("hold")
    closed, heir = open_now(), open_now()
    closed.send("hold")
    closed.close()
    heir.send("hold")
    assert len(serve(box)) == 3
    assert [r.id for r in heir.poll()] == [3]


def test_commands_nobody_answers_are_forgotten_in_the_end(box: Mailbox, open_now: Open) -> None:
    handle = open_now()
    for _ in range(KEPT + 100):
        handle.send("crtk_version")
        list(box.drain())
    assert len(handle._place._senders) == KEPT


def test_a_system_that_was_made_anew_gets_a_place_of_its_own(system: str, open_now: Open) -> None:
    old = open_now()
    old.send("hold")
    unlink(segment_name(system, "PSM1", "mailbox"))
    with pytest.raises(SegmentError, match="there is no such segment"):
        open_now()
    create_mailbox(system, "PSM1", "arm", COMMANDS["arm"])
    box, new = open_now(Mailbox, COMMANDS["arm"]), open_now()
    assert new.send("hold") == 1 and old.send("hold") == 2
    assert serve(box) == ["hold"] and len(new.poll()) == 1
    old.close()
    assert taken(system) == [0]


@pytest.mark.slow
def test_threads_with_a_handle_each_lose_nothing(box: Mailbox, open_now: Open) -> None:
    count, heard, over = 200, [0] * 4, threading.Event()

    def work(which: int, handle: Client) -> None:
        for i in range(count):
            number = handle.send("crtk_version", (which, i))
            replies: list[Any] = []
            while not replies and not over.wait(1e-4):
                replies = handle.poll()
            if [(r.id, r.text) for r in replies] != [(number, f"[{which}.0, {i}.0]")]:
                return
            heard[which] += 1

    threads = [threading.Thread(target=work, args=(which, open_now())) for which in range(len(heard))]
    for thread in threads:
        thread.start()
    timer = threading.Timer(30.0, over.set)
    timer.start()
    while any(thread.is_alive() for thread in threads):
        serve(box)
    timer.cancel()
    assert heard == [count] * len(heard)


def test_a_forked_child_does_not_use_its_parents_place(system: str, box: Mailbox, open_now: Open) -> None:
    handle = open_now()
    handle.send("hold")

    def child() -> object:
        with pytest.raises(SegmentError, match=rf"opened by the process that forked us \(pid {os.getppid()}\)"):
            handle.send("hold")
        assert handle.poll() == []
        handle.close()
        with contextlib.closing(Client(system, "PSM1")) as own:
            return own.send("hold"), taken(system), len(os.listdir("/proc/self/fd"))  # noqa: PTH208

    before = len(list(Path("/proc/self/fd").iterdir()))
    reported = in_child(child)
    assert reported.startswith("(1, [0, 1], "), reported
    assert int(reported.split(", ")[-1].strip(")")) <= before + 2
    assert taken(system) == [0]
    handle.send("hold")
    assert serve(box) == ["hold"] * 3 and len(handle.poll()) == 2


def test_a_place_is_free_when_its_process_dies_though_a_child_lives(world: Any, system: str) -> None:
    parent = world.start("""
import os, sys
from trocar.shm.mailbox.client import Client
client = Client(sys.argv[1], "PSM1")
client.send("hold")
child = os.fork()
if child == 0:
    print(os.getpid(), flush=True)
    os.close(1)
sys.stdin.read()
""")
    child = int(parent.stdout.readline())
    assert taken(system) == [0]
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert Path(f"/proc/{child}").exists() and taken(system) == []
    world.kill(parent)  # closes what the child reads from


def test_without_a_place_reading_is_possible_and_moving_is_refused(system: str, box: Mailbox, open_now: Open) -> None:
    for _ in range(CLIENTS):
        open_now(take_place, "plan.py")
    handle = open_now()
    assert handle.commands and handle.poll() == []
    with pytest.raises(SegmentError, match=rf"^PSM1: all 16 places .* taken: plan.py \(pid {os.getpid()}, 16"):
        handle.send("move_jp", (1.0,))
    number = handle.send("hold")
    assert number < 0 and serve(box) == ["hold"]
    assert [(r.id, r.outcome) for r in handle.poll()] == [(number, "done")]
    with pytest.raises(SegmentError, match="all 16 places"):
        open_now(LoopClient)


@pytest.mark.parametrize("kind", [Client, LoopClient])
def test_a_stop_passes_a_full_queue_and_empties_it(box: Mailbox, open_now: Open, kind: type[Client]) -> None:
    handle = open_now(kind)
    moves = [handle.send("move_jp", (1.0,)) for _ in range(COMMANDS_DEPTH)]
    if kind is LoopClient:
        assert handle.send("move_jp", (1.0,)) == 0
    else:
        with pytest.raises(MailboxFull):
            handle.send("move_jp", (1.0,))
    stop = handle.send("hold")
    assert [name for _ in range(5) for name in serve(box)] == ["hold"]
    replies = handle.poll()
    assert {(r.id, r.outcome) for r in replies} == {(stop, "done"), *((n, "refused") for n in moves)}
    assert len(replies) == COMMANDS_DEPTH + 1


@pytest.mark.parametrize("where", ["send", "claim"])
def test_a_stop_sent_by_what_interrupts_a_command_goes_out(
    box: Mailbox, open_now: Open, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """As a signal's handler does, in the middle of another command of the same thread."""
    handle, stops = open_now(), []
    place, nested = type(handle._place), []
    honest = getattr(place, where)

    def interrupted(this: Any, *words: Any, **more: Any) -> Any:
        result = honest(this, *words, **more)
        if not nested:
            nested.append(True)
            stops.append(handle.send("hold"))
            with pytest.raises(MailboxFull, match="another command is being sent"):
                handle.send("move_jp", (2.0,))
        return result

    monkeypatch.setattr(place, where, interrupted)
    number = handle.send("crtk_version", (1.0,))
    assert stops and stops[0] < 0 < number
    assert sorted(serve(box)) == ["crtk_version", "hold"]
    assert {r.id for r in handle.poll()} == {number, stops[0]}


def test_what_is_no_stop_and_what_is_no_command_is_told_as_such(box: Mailbox, open_now: Open) -> None:
    handle = open_now()
    with pytest.raises(KeyError, match="arm has no command fly; it has: state_command"):
        handle.send("fly")
    with pytest.raises(ValueError, match="65 values"):
        handle.send("servo_jp", [0.0] * 65)
    assert handle.send("hold") == 1


@pytest.mark.parametrize(("words", "called"), [
    (["/usr/bin/trocar", "send", "PSM1", "hold"], "trocar send"), (["/x/trocar/__main__.py", "down"], "trocar down"),
    (["/x/trocar", "--help"], "trocar"), (["/home/me/plan.py", "fast"], "plan.py"), (["-c"], "python"),
    ([""], "python"), ([], "python"),
])
def test_what_a_process_calls_itself(monkeypatch: pytest.MonkeyPatch, words: list[str], called: str) -> None:
    monkeypatch.setattr("sys.argv", words)
    assert program_name() == called


def test_clients_of_a_bridge_share_a_place_under_its_own_name(system: str, box: Mailbox) -> None:
    clients = [Client(system, "PSM1", program, peer=peer, holder="bridge")
               for peer, program in enumerate(("gone.py", "plan.py"), 1)]
    for client in clients:
        client.send("hold")
    assert [(got.holder.program, got.origin.program) for got in box.drain()] == [
        ("bridge", "gone.py"), ("bridge", "plan.py")]
    for client in clients:
        client.close()
