"""What is closed goes at once: loops run without the garbage collector, and must not keep maps nobody uses."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.mailbox.place import take_place
from trocar.shm.memory.segment import Segment
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber, Subscriptions
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.time.lockstep import LockstepClock, Table, Timekeeper
from trocar.shm.topics import SETPOINT

Ends = tuple[Any, ...]


def with_page(make: Callable[[ControlPage], object]) -> Callable[[str], Ends]:
    def both(system: str) -> Ends:
        page = ControlPage(system, "PSM1", write=True)
        return make(page), page

    return both


TABLE = Table(("PSM1",), "PSM1")
ENDS: dict[str, Callable[[str], Ends]] = {
    "ring writer": lambda system: (directory.writer(system, "PSM1", "setpoint", "arm"),),
    "ring reader": lambda system: (directory.reader(system, "PSM1", "setpoint", "arm"),),
    "mailbox": lambda system: (Mailbox(system, "PSM1", COMMANDS["arm"]),),
    "place": lambda system: (take_place(system, "PSM1"),),
    "wakeup": with_page(ControlPage.wakeup),
    "subscriptions": with_page(Subscriptions),
    "subscriber": lambda system: (Subscriber(system, "PSM1"),),
    "timekeeper": lambda system: (Timekeeper(system, TABLE),),
    "lock-step clock": lambda system: (Timekeeper(system, TABLE), LockstepClock(system, "PSM1")),
}


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """A system with one of everything, and the garbage collector off."""
    directory.create_ring(world.name, "PSM1", SETPOINT, {}, {"kind": "arm"})
    create_mailbox(world.name, "PSM1", "arm", COMMANDS["arm"])
    create_control(world.name, "PSM1")
    gc.disable()
    yield world.name
    gc.enable()
    world.remove()


@pytest.mark.parametrize("which", ENDS)
def test_nothing_of_a_closed_end_stays(system: str, which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    attached: list[Segment] = []
    attach = Segment.__init__

    def noted(self: Segment, name: str, *, write: bool = False) -> None:
        attach(self, name, write=write)
        attached.append(self)

    monkeypatch.setattr(Segment, "__init__", noted)
    ends = ENDS[which](system)
    there = [weakref.ref(segment) for segment in attached]
    maps = Path("/proc/self/maps").read_text()
    assert maps.count(f"~{system}~") == len(there) > 0
    for segment in attached:
        segment.close()
    attached.clear()
    del segment, ends
    assert [ref() for ref in there] == [None] * len(there)
    assert f"~{system}~" not in Path("/proc/self/maps").read_text()
