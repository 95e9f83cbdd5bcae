"""What a process reads of another that runs on demand: it is a subscriber of that as long as it holds the ring."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest

from tests.conftest import World
from trocar.procs.document.system import Process, SystemConfig
from trocar.procs.document.user_process import UserField, UserProcess, UserTopic
from trocar.procs.node.node import Node
from trocar.procs.supervisor.memory import create_all

DECLARED = UserProcess("mine", "mine.py", 0.01, (UserTopic("depth", 100.0, 16, (UserField("x", "float"),)),))
ROWS = (Process("mine", "user", 0.01), Process("asleep", "user", 0.01, start="on-demand"))


@pytest.fixture
def two(world: World) -> Iterator[tuple[Node, Node]]:
    """One that runs, and one on demand."""
    users = (DECLARED, dataclasses.replace(DECLARED, name="asleep"))
    system = SystemConfig(world.name, "a test", "wall", (), (), None, ROWS, users=users)
    create_all(system)
    made = [Node(system, name) for name in ("mine", "asleep")]
    yield made[0], made[1]
    for each in made:
        each.close()
    world.remove()


def wanted(memory: Node) -> list[str]:
    """Topics of it that somebody subscribes to."""
    memory.subscriptions.look()
    names = ("depth", "events", "audit")
    return [name for name in names if memory.subscriptions.wanted & memory.subscriptions.bits(name)]


def test_who_reads_of_it_is_its_subscriber(two: tuple[Node, Node]) -> None:
    mine, asleep = two
    assert mine.input("asleep", "depth").ring.dtype.names == ("sequence", "stamp_ns", "x")
    assert wanted(asleep) == ["depth"]
    mine.reads("asleep", "audit")
    assert wanted(asleep) == ["depth", "audit"]
    mine.give_back()
    assert not wanted(asleep), "a loop that is made anew asks anew"
    mine.reads("asleep", "depth")
    assert wanted(asleep) == ["depth"]


def test_who_only_repeats_its_messages_is_not(two: tuple[Node, Node]) -> None:
    mine, asleep = two
    mine.reads("asleep", "events", counts=False)
    mine.reads("supervisor", "state")
    asleep.reads("asleep", "depth")
    assert not wanted(asleep)
    asleep.reads("mine", "depth")
    assert not wanted(mine), "it always runs"
