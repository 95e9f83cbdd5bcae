"""The scheduling that processes ask for, tried in processes of their own."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import gc
import mmap
import multiprocessing
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import Process
from trocar.procs.node import runtime
from trocar.procs.node.realtime import (
    LOCKED,
    NOT_LOCKED,
    REGION,
    _ranges,
    cores,
    in_words,
    lock_memory,
    realtime,
    spin_ns,
    step_back,
)
from trocar.procs.tables.manifest import Proc

DEADLINE = 6
MEGABYTE, ROOM = 1 << 20, 8 << 20
Pages = dict[str, int]
FIFO_ASKED = Process(name="io", kind="io", period_s=1 / 1500, priority=1)


def forked(ask: Callable[[], Any]) -> Any:
    """The answer of a process of its own."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=lambda: sender.send(ask()))
    process.start()
    assert receiver.poll(30.0)
    answer = receiver.recv()
    process.join(30.0)
    return answer


def asked(clock: str, reserved: float) -> tuple[str, int]:
    """What a process says it got, and what the kernel says."""
    def child() -> tuple[str, int]:
        notes = realtime(FIFO_ASKED, clock, reserved=reserved)
        return in_words(notes).decode(), os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

    answer: tuple[str, int] = forked(child)
    return answer


@pytest.mark.parametrize("reserved", [0.8, 0.0])
def test_what_is_said_of_scheduling_is_what_the_kernel_does(reserved: float) -> None:
    notes, policy = asked("wall", reserved)
    if policy == DEADLINE:
        assert reserved and notes == "deadline"
    elif policy == os.SCHED_FIFO:
        assert notes == "FIFO 1"
    else:
        assert notes.startswith("no FIFO") and policy == os.SCHED_OTHER


def test_who_steps_back_has_its_priority_again_when_it_asks_again() -> None:
    def child() -> list[tuple[int, int]]:
        found = []
        for step in (step_back, ask, step_back, ask):
            step()
            found.append((os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority))
        return found

    def ask() -> None:
        realtime(dataclasses.replace(FIFO_ASKED, priority=7), "wall")

    if asked("wall", 0.0)[1] == os.SCHED_FIFO:
        assert forked(child) == [(os.SCHED_OTHER, 0), *((os.SCHED_FIFO, priority) for priority in (7, 1, 7))]
    else:
        assert forked(child) == [(os.SCHED_OTHER, 0)] * 4


def test_a_share_that_nobody_can_have_leaves_the_usual_priority() -> None:
    notes, policy = asked("wall", 1.5)
    assert notes != "deadline" and policy != DEADLINE


def test_in_lockstep_nobody_has_priority() -> None:
    assert asked("lockstep", 0.8) == ("other", os.SCHED_OTHER)


@pytest.mark.slow
def test_own_memory_is_locked_and_shared_memory_is_there(tmp_path: Path) -> None:
    file = tmp_path / "shared"
    file.write_bytes(b"x" * MEGABYTE)
    inherited = mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
    inherited[:] = b"x" * ROOM

    def child() -> tuple[str, dict[str, Pages]]:
        with file.open("r+b") as opened:
            shared = mmap.mmap(opened.fileno(), MEGABYTE)
        own = mmap.mmap(-1, MEGABYTE, flags=mmap.MAP_PRIVATE)
        own[:] = b"x" * MEGABYTE
        words = lock_memory()
        later = mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
        later[0] = 1
        return words, {"shared": pages(shared), "own": pages(own), "inherited": pages(inherited),
                       "later": pages(later)}

    words, found = forked(child)
    if words == NOT_LOCKED:
        pytest.skip("nobody may lock memory here")
    assert words == LOCKED
    assert found["shared"]["Rss"] == MEGABYTE and not found["shared"]["Locked"]  # the supervisor locks it
    assert found["own"]["Locked"] >= MEGABYTE
    assert found["inherited"]["Rss"] >= ROOM and found["inherited"]["Locked"] > ROOM // 4  # each counts its part
    assert found["inherited"]["Private_Dirty"] < 2 * MEGABYTE, "a page that only our parent has written is not copied"
    assert found["later"]["Locked"] > 0 and found["later"]["Rss"] < 3 * MEGABYTE


@pytest.mark.slow
def test_who_may_not_look_at_itself_locks_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: Any) -> int:
        raise PermissionError

    def child() -> tuple[str, Pages]:
        monkeypatch.setattr("trocar.procs.node.realtime.regions", refuse)
        scratch = mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
        return lock_memory(), pages(scratch)

    words, found = forked(child)
    assert words == NOT_LOCKED or found["Rss"] == found["Locked"] >= ROOM


def pages(place: mmap.mmap) -> Pages:
    """Sizes of the region that a map lies in, bytes, by the words of /proc/self/smaps."""
    here = ctypes.addressof(ctypes.c_char.from_buffer(place))
    sizes: Pages = {}
    within = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if found := REGION.match(line):
            within = int(found[1], 16) <= here < int(found[2], 16)
        elif within and line.endswith(" kB"):
            sizes[line.split(":")[0]] = int(line.split()[1]) << 10
    return sizes


@pytest.mark.parametrize(("priority", "collects"), [("arm", False), ("", True)])
@pytest.mark.slow
def test_only_real_time_kinds_collect_no_garbage(
    monkeypatch: pytest.MonkeyPatch, priority: Literal["arm", ""], collects: bool
) -> None:
    seen: list[tuple[bool, bool]] = []
    node = SimpleNamespace(ask=str, row=SimpleNamespace(priority=0), simulated=True, close=str)
    kind = Proc("clockwork", "procs.clockwork.loop", 0.01, 0.03, 3.0, "restart", priority=priority)
    monkeypatch.setattr(runtime, "proc", lambda name: kind)
    for name, fake in (("arguments", lambda kind: SimpleNamespace(system="", name="")), ("document_of", str),
                       ("Node", lambda document, name: node), ("lived", lambda *given: contextlib.nullcontext())):
        monkeypatch.setattr(runtime, name, fake)
    monkeypatch.setattr(runtime, "live",
                        lambda node, make: seen.append((gc.isenabled(), bool(gc.get_freeze_count()))))
    runtime.run("clockwork", runtime.Loop)
    assert seen == [(collects, not collects)] and gc.isenabled()


def test_processors_are_asked_for_and_told_in_ranges() -> None:
    allowed = sorted(os.sched_getaffinity(0))
    row = Process("io", "io", 0.001, cpus=tuple(allowed))
    notes, after = forked(lambda: (realtime(row, "wall"), sorted(os.sched_getaffinity(0))))
    assert after == allowed
    assert in_words(["FIFO 60", *notes, "locked"]).decode().startswith(f"FIFO 60, locked, cpu {allowed[0]}")
    assert _ranges((0, 2, 3, 4, 9)) == "0,2-4,9"


def test_threads_of_a_core_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for cpu in range(6):
        (tmp_path / f"cpu{cpu}/topology").mkdir(parents=True)
        (tmp_path / f"cpu{cpu}/topology/thread_siblings_list").write_text(f"{cpu % 3},{cpu % 3 + 3}\n")
    monkeypatch.setattr("trocar.procs.node.realtime.CPUS", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 3, 4, 5})
    assert cores() == ((0, 3), (1, 4), (5,))


def test_where_nobody_tells_each_is_a_core_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.procs.node.realtime.CPUS", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {2, 0})
    assert cores() == ((0,), (2,))


@pytest.mark.parametrize(("file", "spins"), [("kinematic.yaml", False), ("demo.yaml", True)])
def test_an_io_spins_for_its_boards_only(file: str, spins: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: {0, 1})
    system = load_system(PROJECT_CONFIGS / "systems" / file, name="spins", boards="emulated" if spins else None).system
    assert system is not None
    assert spin_ns(system, system.ios[0].name) == (50_000 if spins else 0)
    assert spin_ns(system, "PSM1") == 0
