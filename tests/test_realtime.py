"""The scheduling that processes ask for, tried in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable

import pytest

from procs.lib.document import Process
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
