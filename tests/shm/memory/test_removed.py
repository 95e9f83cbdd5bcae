"""Segments whose names another program has removed: a supervisor keeps them, and passes them to trusted users."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from trocar.shm.memory import owners, removed
from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.parts import held_names, parts_of, removed_of
from trocar.shm.memory.process_start import start_time
from trocar.shm.memory.removed import KeptSegments, address
from trocar.shm.memory.segment import Segment, create, open_file, owner_of, path_of, segment_name, unlink
from trocar.shm.system.directory import publish_document
from trocar.shm.topics import ARM_STATE

COUNT = 70
"""More than a message has."""


def held(system: str) -> socket.socket:
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    lock.bind(address(system))
    return lock


def files_of(names: list[str]) -> dict[str, Path]:
    return {name: path_of(name) for name in names}


@contextlib.contextmanager
def silent_keeper(system: str, names: list[str], group: int = -1) -> Iterator[KeptSegments]:
    """A supervisor's keeper; what it knows is forgotten here, as in another process."""
    known = removed._answers.known
    before = dict(known)
    with held(system) as lock, KeptSegments(lock, system, files_of(names), group) as keeper:
        known.clear()
        known.update(before)
        yield keeper


@contextlib.contextmanager
def keeper_of(system: str, names: list[str], group: int = -1) -> Iterator[KeptSegments]:
    """The same with its beats, in a thread."""
    with silent_keeper(system, names, group) as keeper:
        over = threading.Event()

        def beats() -> None:
            while not over.wait(0.002):
                keeper.beat()

        thread = threading.Thread(target=beats)
        thread.start()
        try:
            yield keeper
        finally:
            over.set()
            thread.join()


def attaches(name: str) -> bool:
    try:
        os.close(open_file(name, os.O_RDONLY))
    except FileNotFoundError:
        return False
    return True


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.fixture
def names(world: Any) -> Iterator[list[str]]:
    made = [segment_name(world.name, f"PSM{number}", "state") for number in range(COUNT)]
    for name in made:
        create(name, "ring", schema_of(ARM_STATE), 2)
    yield made
    removed._answers.drop(world.name)
    for name in made:
        unlink(name)


def test_what_lost_its_name_is_attached_and_claimed_as_before(names: list[str], world: Any) -> None:
    with keeper_of(world.name, names) as keeper, Segment(names[-1], write=True) as first:
        first.claim("PSM69")
        unlink(names[-1])
        assert keeper.removed() == [names[-1]]
        with Segment(names[-1], write=True) as again:
            assert again.claimed()
            again.view[-1] = 7
            with pytest.raises(SegmentError, match=r"PSM69 .* writes it already"):
                again.claim("other")
        assert first.view[-1] == 7
        with pytest.raises(SegmentError, match="no such segment"):
            Segment(segment_name(world.name, "PSM99", "state"))
    with pytest.raises(SegmentError, match="no such segment"):  # its supervisor has gone
        Segment(names[-1])


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_the_owner_of_a_segment_without_a_name_is_known(names: list[str], world: Any) -> None:
    with keeper_of(world.name, names):
        os.chown(path_of(names[0]), 4242, -1)
        unlink(names[0])
        assert owner_of(names[0]) == "user 4242"


def test_memory_is_taken_from_trusted_users_only(
        names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with keeper_of(world.name, names):
        unlink(names[0])
        with monkeypatch.context() as context:
            context.setattr(owners, "accepted", lambda: frozenset({os.getuid() + 1}))
            assert not attaches(names[0])
        removed._answers.drop(world.name)
        assert attaches(names[0])


@pytest.mark.parametrize(("group", "is_given"), [(-1, False), (54321, False), (os.getgid(), True)])
def test_memory_is_given_to_trusted_users_and_the_group_only(
        names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch, group: int, is_given: bool) -> None:
    monkeypatch.setattr(owners, "accepted", lambda: frozenset({os.getuid() + 1}))
    with keeper_of(world.name, names, group):
        monkeypatch.undo()
        unlink(names[0])
        assert attaches(names[0]) == is_given


def test_an_account_that_is_not_found_any_more_ends_no_supervisor(
        names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> frozenset[int]:
        raise SegmentError("no such user")

    with silent_keeper(world.name, names) as keeper, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as asking:
        monkeypatch.setattr(owners, "accepted", fail)
        asking.connect(address(world.name))
        keeper.beat()
        assert asking.recv(10) == b"70 /trocar"


def test_a_keeper_that_cannot_open_all_closes_all(names: list[str], world: Any) -> None:
    with held(world.name) as lock:
        before = open_files()
        with pytest.raises(SegmentError, match="No such file"):
            KeptSegments(lock, world.name, {**files_of(names), "gone": Path("/dev/shm/there-is-none")})
        assert open_files() == before


def silent(lock: socket.socket) -> None:
    time.sleep(0.1)


def incomplete(lock: socket.socket) -> None:
    with lock.accept()[0] as peer:
        socket.send_fds(peer, [b"70 /trocar~x~PSM1~state"], [lock.fileno()])


@pytest.mark.parametrize("behave", [silent, incomplete])
def test_a_supervisor_that_does_not_answer_is_asked_again_later(
        names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch, behave: Callable[[socket.socket], None]) -> None:
    monkeypatch.setattr(removed, "PATIENCE", struct.pack("ll", 0, 50_000))
    before = open_files()
    with held(world.name) as lock:
        lock.listen()
        lock.setblocking(True)
        thread = threading.Thread(target=behave, args=(lock,))
        thread.start()
        unlink(names[0])
        assert not attaches(names[0])
        thread.join()
    assert open_files() == before
    with keeper_of(world.name, names[1:]):
        unlink(names[1])
        assert not attaches(names[1]), "asked within a second"
        removed._answers.known[world.name].until = time.monotonic()
        assert attaches(names[1])


def test_one_beat_answers_many_and_a_full_queue_is_waited_for(names: list[str], world: Any) -> None:
    with silent_keeper(world.name, names) as keeper, contextlib.ExitStack() as strangers:
        while True:
            stranger = strangers.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            stranger.setblocking(False)
            try:
                stranger.connect(address(world.name))
            except OSError as error:
                assert error.errno == errno.EAGAIN
                break
        unlink(names[0])
        found: list[bool] = []
        asking = threading.Thread(target=lambda: found.append(attaches(names[0])))
        asking.start()
        time.sleep(0.05)
        for _ in range(20):
            keeper.beat()
            time.sleep(0.01)
        asking.join()
        assert found == [True]


def test_a_program_keeps_no_memory_of_a_system_that_lost_no_name(
        names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    ask = removed._asked
    monkeypatch.setattr(removed, "_asked", lambda system: (asked.append(system), ask(system))[1])
    with keeper_of(world.name, names):
        before = open_files()
        for _ in range(3):
            assert not attaches(segment_name(world.name, "PSM99", "state"))
        assert open_files() == before and len(asked) == 1


def test_memory_of_a_supervisor_that_has_ended_is_released(names: list[str], world: Any) -> None:
    before = open_files()
    ear, mouth = os.pipe()
    child = os.fork()
    if child == 0:
        with held(world.name) as lock, KeptSegments(lock, world.name, files_of(names)) as keeper:
            os.write(mouth, b"x")
            while True:
                keeper.beat()
                time.sleep(0.002)
    os.read(ear, 1)
    os.close(ear)
    os.close(mouth)
    unlink(names[0])
    try:
        assert attaches(names[0]) and open_files() == before + COUNT
    finally:
        os.kill(child, 9)
    os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)  # ended, and still in the list of processes
    assert start_time(child)
    assert not attaches(names[1].replace(world.name, f"{world.name}other")) and open_files() == before
    assert not attaches(names[0])
    os.waitpid(child, 0)


def test_threads_close_an_old_answer_once(names: list[str], world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {name: os.open(path_of(name), os.O_PATH) for name in names}
    numbers = list(files.values())
    unlink(names[0])
    closed: list[int] = []
    close = os.close

    def slow_close(fd: int) -> None:
        closed.append(fd)
        time.sleep(0.0005)
        close(fd)

    with keeper_of(world.name, names[1:]):
        unlink(names[1])
        removed._answers.known[world.name] = removed._Answer(os.getpid(), 1, files)
        monkeypatch.setattr(os, "close", slow_close)
        found: list[bool] = []
        threads = [threading.Thread(target=lambda: found.append(attaches(names[1]))) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        monkeypatch.undo()
    assert found == [True] * 8
    assert closed[:COUNT] == numbers


def test_a_child_that_was_forked_while_another_thread_asked_attaches(names: list[str], world: Any) -> None:
    is_held, over = threading.Event(), threading.Event()

    def asks() -> None:
        with removed._answers.lock:
            is_held.set()
            over.wait(10)

    with keeper_of(world.name, names):
        unlink(names[0])
        thread = threading.Thread(target=asks)
        thread.start()
        is_held.wait(10)
        child = os.fork()
        if child == 0:
            signal.alarm(5)
            os._exit(0 if attaches(names[0]) else 1)
        assert os.waitpid(child, 0)[1] == 0
        over.set()
        thread.join()


def test_a_system_has_the_parts_of_its_list(names: list[str], world: Any) -> None:
    publish_document(world.name, b"{}", segments=names)
    document = segment_name(world.name, "supervisor", "document")
    whole = parts_of(world.name)
    assert len(whole) == COUNT + 1 and not removed_of(world.name)
    with keeper_of(world.name, [*names, document]):
        assert world.name in held_names()
        for name in (names[1], document):
            unlink(name)
            assert parts_of(world.name) == whole
        assert removed_of(world.name) == [(world.name, "PSM1", "state"), (world.name, "supervisor", "document")]
    with held(world.name):
        assert world.name not in held_names(), "its supervisor still starts"
