"""The scheduling that processes ask for, tried in processes of their own."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
from collections.abc import Callable
from typing import Literal

import pytest

from procs import runtime
from procs.document.system import Process
from procs.manifest import Proc
from procs.realtime import realtime

DEADLINE = 6
FIFO_ASKED = Process(name="io", kind="io", period_s=1 / 1500, priority=1)


def asked(clock: str, reserved: float, *, locked: bool = False) -> tuple[str, int]:
    """What a process says it got, and what the kernel says."""
    def child(send: Callable[[tuple[str, int]], None]) -> None:
        notes = realtime(FIFO_ASKED, clock, locked=locked, reserved=reserved)
        send((notes, os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK))

    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=child, args=(sender.send,))
    process.start()
    assert receiver.poll(30.0)
    answer: tuple[str, int] = receiver.recv()
    process.join(30.0)
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


def test_a_share_that_nobody_can_have_leaves_the_usual_priority() -> None:
    notes, policy = asked("wall", 1.5)
    assert notes != "deadline" and policy != DEADLINE


def test_in_lockstep_nobody_has_priority_or_locks_memory() -> None:
    assert asked("lockstep", 0.8, locked=True) == ("other", os.SCHED_OTHER)


@pytest.mark.parametrize(("priority", "collects"), [("arm", False), ("", True)])
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
