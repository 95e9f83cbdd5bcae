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
from typing import Any, Literal

import pytest

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import Process
from trocar.procs.node import runtime
from trocar.procs.node.realtime import (
    LOCKED,
    NOT_LOCKED,
    REGION,
    SCRATCH,
    USED_TOGETHER,
    _ranges,
    cores,
    in_words,
    lock_memory,
    realtime,
    step_back,
)
from trocar.procs.tables.manifest import Proc

DEADLINE = 6
MEGABYTE, ROOM = 1 << 20, 2 * SCRATCH
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

    def child() -> tuple[str, dict[str, tuple[int, int]]]:
        with file.open("r+b") as opened:
            shared = mmap.mmap(opened.fileno(), MEGABYTE)
        own, scratch = mmap.mmap(-1, MEGABYTE, flags=mmap.MAP_PRIVATE), mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
        own[:], scratch[ROOM // 2] = b"x" * MEGABYTE, 1
        words = lock_memory()
        later = mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
        return words, {"shared": pages(shared), "own": pages(own), "later": pages(later), "scratch": pages(scratch),
                       "used": pages(scratch, ROOM // 2)}

    words, found = forked(child)
    if words == NOT_LOCKED:
        pytest.skip("nobody may lock memory here")
    assert words == LOCKED
    assert found["shared"] == (MEGABYTE, 0)
    assert found["own"][0] == found["own"][1] >= MEGABYTE
    assert found["scratch"] == (0, 0) and found["later"][1] < MEGABYTE  # nor does what is in one piece with it
    assert found["used"][0] == found["used"][1] >= USED_TOGETHER


@pytest.mark.slow
def test_who_may_not_look_at_itself_locks_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: Any) -> int:
        raise PermissionError

    def child() -> tuple[str, tuple[int, int]]:
        monkeypatch.setattr(os, "open", refuse)
        scratch = mmap.mmap(-1, ROOM, flags=mmap.MAP_PRIVATE)
        return lock_memory(), pages(scratch)

    words, (there, locked) = forked(child)
    assert words == NOT_LOCKED or there == locked >= ROOM


def pages(place: mmap.mmap, offset: int = 0) -> tuple[int, int]:
    """How many bytes of the region that a place of a map lies in are there, and how many are locked."""
    here = ctypes.addressof(ctypes.c_char.from_buffer(place)) + offset
    sizes: dict[str, int] = {}
    within = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if found := REGION.match(line):
            within = int(found[1], 16) <= here < int(found[2], 16)
        elif within and line.startswith(("Rss:", "Locked:")):
            sizes[line.split(":")[0]] = int(line.split()[1]) << 10
    return sizes["Rss"], sizes["Locked"]


@pytest.mark.parametrize(("priority", "collects"), [("arm", False), ("", True)])
@pytest.mark.slow
def test_only_real_time_kinds_collect_no_garbage(
    monkeypatch: pytest.MonkeyPatch, priority: Literal["arm", ""], collects: bool
) -> None:
    seen: list[bool] = []
    kind = Proc("clockwork", "procs.clockwork.loop", 0.01, 0.03, 3.0, "restart", priority=priority)
    monkeypatch.setattr(runtime, "proc", lambda name: kind)
    monkeypatch.setattr(runtime, "process", lambda name: contextlib.nullcontext())
    monkeypatch.setattr(runtime, "live", lambda node, make: seen.append(gc.isenabled()))
    try:
        runtime.run("clockwork", runtime.Loop)  # type: ignore[type-abstract]
        assert seen == [collects] and bool(gc.get_freeze_count()) is not collects
    finally:
        gc.unfreeze()
        gc.enable()


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
    assert runtime._spin_ns(system, system.ios[0].name) == (50_000 if spins else 0)
    assert runtime._spin_ns(system, "PSM1") == 0
