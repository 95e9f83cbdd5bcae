"""A Classic patient cart: setup joints, io's core and emulated boards on one stepped clock."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from tests import stock
from tests.boards.rails import Rails
from tests.guarded import Guarded
from tests.io.boards_harness import BoardsHarness
from tests.io.harness import FakeCommand, FakeSource
from tests.suj.harness import FakeMemory, SetupHarness
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.setup_joints import SetupJointsPlant as Plant
from trocar.procs.config import load_system
from trocar.procs.io.reports import IoEvent
from trocar.procs.node.io_faults import fault_reports, power_reports
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.interface_board import InterfaceBoard
from trocar.procs.suj.multiplexer import Multiplexer
from trocar.shm.mailbox.generations import NoFaults
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import EVENTS, SUJ_STATE

PLACES = {
    "ECM": (0.41, -0.3, 0.2, 3.3, 0.0, 0.0), "PSM1": (0.52, 0.4, -1.1, 0.3, 0.2, -0.7),
    "PSM2": (0.33, -0.5, 0.9, -0.2, -0.4, 0.6), "PSM3": (0.21, 0.1, 0.15, 0.25, -0.35, 0.45),
}


class Records:
    """io's ring: what was pushed, in order."""

    def __init__(self, record: Any) -> None:
        self._record, self._fields = record, {}
        self._waiting: deque[tuple[int, dict[str, np.ndarray]]] = deque()
        self.lost, self.stamp_ns, self.epoch = 0, 0, 1

    def field(self, name: str) -> np.ndarray:
        return self._fields.setdefault(name, getattr(self._record, name).copy())

    def push(self, stamp_ns: int) -> None:
        self._waiting.append((stamp_ns, {name: getattr(self._record, name).copy() for name in self._fields}))

    def next(self) -> bool:
        if not self._waiting:
            return False
        self.stamp_ns, values = self._waiting.popleft()
        for name, value in values.items():
            self._fields[name][...] = value
        return True


class CartIoEvents:
    """io's event ring: what it has reported, and did so just now."""

    def __init__(self, events: list[IoEvent]) -> None:
        self._events = events

    def since(self, stamp_ns: int) -> np.ndarray:
        found = np.zeros(len(self._events), dtype=schema_of(EVENTS, {}).dtype)
        for row, event in zip(found, self._events, strict=True):
            for name in ("code", "component", "text", "axis", "board", "value", "limit"):
                value = getattr(event, name)
                row[name] = value.encode() if isinstance(value, str) else value
        return found


class Orders(Guarded):
    """What io is asked, behind the guard of its mailbox; a test may let some get lost."""

    def __init__(self) -> None:
        super().__init__("io", NoFaults())
        self.commands, self.waiting = self, list[FakeCommand]()
        self.log: list[tuple[str, str, tuple[float, ...]]] = []
        self.lose = ""

    def send(self, name: str, values, text: str) -> None:
        self.log.append((name, text, tuple(values)))
        if name != self.lose and self.lets_through(name, values, text):
            self.waiting.append(FakeCommand(name, text, *values, origin=self.origin))


class Cart(SetupHarness):
    """`run` steps everything; a cycle of the setup joints is one of a quick io, else every third."""

    def __init__(self, memory: FakeMemory | None = None, harness: BoardsHarness | None = None, *,
                 quick: bool = True) -> None:
        """`quick`: emulated inputs need no time to settle, and are without noise; io has longer cycles."""
        self._multiplexer = Multiplexer(2, 5_000_000) if quick else Multiplexer()
        loaded = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")],
                             boards="emulated", sets=["io.period_s=0.002"] if quick else ())
        assert loaded.system is not None
        self.harness = harness or BoardsHarness(loaded.system, "IO1", driven=True)
        self.orders, self.records = Orders(), Records(self.harness.record)
        cart = loaded.system.cart("SUJ")
        super().__init__(cart, self._classic, memory or FakeMemory(SUJ_STATE, setups=4),
                         self.orders.on_behalf)
        source = self.harness.core.follow.followers[0].source  # io's ring of our setpoints
        assert isinstance(source, FakeSource)
        self.harness.arms["SUJ"] = source
        source.mode, source.count = self.setpoint.field("mode"), self.setpoint.field("count")
        source.effort, source.in_effort = self.setpoint.field("effort"), self.setpoint.field("in_effort")
        self._source, self.alive = source, True

    def _classic(self, cart, setups, reports, field, setpoint) -> Classic:
        io, events = self.harness.io, CartIoEvents(self.harness.events)
        board = InterfaceBoard(io, io.place("SUJ"), self.records, self.orders,
                               fault_reports(lambda: self.records.stamp_ns, events, "SUJ"),
                               power_reports(self.records.field, io, io.place("SUJ")))
        return Classic(cart, setups, board, reports, field, setpoint, self._multiplexer)

    @property
    def plant(self) -> Plant:
        return self.harness.world.setup_joints["SUJ"]

    def run(self, seconds: float, *requests: FakeCommand) -> None:
        for _ in range(round(seconds * 500)):
            for _ in range(round(2e6 / self.harness.period_ns)):
                commands, self.orders.waiting = self.orders.waiting, []
                self.harness.cycle(commands)
                self.records.push(self.harness.clock.ns)
            if self.alive:
                self.now_ns = self.harness.clock.ns + 100_000
                self.joints.step(self.now_ns, requests)
                requests = ()

    def say(self, name: str, text: str = "", *values: float) -> FakeCommand:
        request = FakeCommand(name, text, *values)
        self.run(0.002, request)
        return request

    def enable(self) -> None:
        request = self.say("state_command", "home")
        for _ in range(20):
            if request.outcome != "accepted":
                break
            self.run(0.1)
        assert request.outcome == "done", (request.answers, self.reports.reported, self.harness.events)

    def kill(self) -> None:
        """No cycle of the setup joints any more; their last setpoint grows old."""
        self.alive = False
        self.harness.arms.pop("SUJ")

    def restart(self, away_s: float = 0.5, *, at_once: bool = False) -> Cart:
        """kill -9, and a process on what is there; or one that was held up, and begins anew after 31 ms."""
        self.kill()
        self.run(0.031 if at_once else away_s)
        return Cart(memory=self.memory, harness=self.harness)

    def lose_supply(self, lost: bool) -> None:
        bus = self.harness.world.buses[0]
        bus.power.lose_supply(0, lost, bus.now)

    def press(self, name: str, on: bool) -> None:
        BoardFaults(self.harness.world, Rails(4)).press(name, on)

    def valid(self) -> list[bool]:
        return self.field("setup_valid").tolist()
