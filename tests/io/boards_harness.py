"""A whole robot on a stepped clock: io's core, its port and emulated boards with their plant, in one thread.

Datagrams go straight from the port to the boards; nothing else is left out.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from tests import stock
from tests.guarded import FakeCell
from tests.io.harness import FakeCommand, FakeSource, SteppedClock
from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga import registers, wire
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.cycle import RobotIo
from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoEvent
from trocar.procs.io.robots import Robots
from trocar.procs.io.start import POWER_OFF, prepare
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.shm.time.clock import boottime_ns

COARSE = ("io.period_s=0.002", "emulation.period_s=0.002")
"""Where rates are not the subject."""


class Direct:
    """A transport whose other end is in this process. `lose`: so many replies; `loss`: this share of all datagrams."""

    where, on_firewire, gives_address, pause_ms = "in this process", False, registers.ip_quadlet("127.0.0.1"), 0
    most_read = most_write = wire.MAX_DATA
    stranger, fd = "", -1

    def __init__(self, world: Emulation, bus: int, clock: SteppedClock) -> None:
        self._world, self._bus, self._clock = world, bus, clock
        self._replies: deque[bytes] = deque()
        self._to = GROUP
        self._by_board = False
        self.lose, self.loss = 0, 0.0
        self._dice = random.Random(20261121)

    def seed(self, number: int) -> None:
        """Lose others."""
        self._dice.seed(number)

    def open(self) -> None:
        self._replies.clear()

    def close(self) -> None: ...

    def forget(self) -> bool:
        self._replies.clear()
        return True

    def ask_everybody(self) -> int:
        self._by_board = False
        return 0

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        self._by_board = by_board
        return 0

    def send(self, datagram) -> None:
        if self._lost():
            return
        node = datagram[3] & 0x3F
        to = node if self._by_board and node != wire.BROADCAST else GROUP
        reply = self._world.answer(self._bus, bytes(datagram), self._clock(), to)
        if reply is None or self._lost():
            return
        if self.lose:
            self.lose -= 1
        else:
            self._replies.append(bytes(reply))

    def _lost(self) -> bool:
        return self.loss > 0.0 and self._dice.random() < self.loss

    def poll(self, _timeout_ms):
        return bool(self._replies)

    def recv_into(self, buffer) -> int:
        reply = self._replies.popleft()
        buffer[: len(reply)] = reply
        return len(reply)


class BoardsHarness:
    """One io of a system as its emulated boards see it: every robot of its files, with or without an arm."""

    def __init__(self, system: SystemConfig, name: str = "", *, driven: bool = False, link: type[Direct] = Direct,
                 now_ns: Callable[[], int] | None = None) -> None:
        """`driven`: as the system's io runs it, not as the boards see it. `now_ns`: io's clock, if not the boards'."""
        self.system, whole = system, system.emulated()
        self.io = (system if driven else whole).io(name) if name else whole.ios[0]
        self.clock = SteppedClock()
        self.plant = Plant(whole)
        self.world = Emulation(whole, self.plant, self.clock.ns)
        bus = [bus.io for bus in whole.emulation.buses].index(self.io.name)
        self.link = link(self.world, bus, self.clock)
        self.robots = Robots(self.io)
        bridge = whole.emulation.buses[bus].network == "bridge"  # whatever its firmware could do without
        self.now_ns = now_ns or self.clock
        self.port = BusPort(self.link, self.robots.board_ids, self.now_ns, PortOptions(
            self.io.protocol, bridge=bridge, real_time=now_ns is not None, exclusive=now_ns is None,
            first_control=POWER_OFF, unknown_firmware=self.io.unknown_firmware))
        self.preset = prepare(self.robots, self.port)
        brakes = sum(len(robot.brakes) for robot in self.io.robots)
        self.record = IoRecord.private(self.robots.axes, len(self.robots.names), len(self.io.digital_inputs), brakes,
                                       len(self.io.digital_outputs))
        self.arms = {pid.robot: FakeSource() for pid in self.io.pids}
        self.over_ns = FOR_EVER_NS
        context = IoContext(self.io, self.now_ns, self.record, list(self.arms.values()),
                            [FakeCell() for _ in self.io.robots],
                            is_over=lambda: boottime_ns() > self.over_ns, over_ns=lambda: self.over_ns)
        self.core = RobotIo(context, self.port, self.preset)
        self.period_ns = round(self.io.period_s * 1e9)
        self.events: list[IoEvent] = []

    def cycle(self, commands: Iterable[FakeCommand] = (), count: int = 1) -> None:
        for _ in range(count):
            self.clock.ns += self.period_ns
            for robot, arm in self.arms.items():
                place = self.robots.names.index(robot)
                arm.stamp_ns = self.now_ns()
                arm.bias_generation[...] = self.record.bias_generation[place]
                arm.pid_generation[...] = self.record.pid_generation[place]
            self.world.advance(self.clock.ns)
            with np.errstate(all="ignore"):
                self.core.cycle([command for command in commands if command.reaches_io()])
            commands = ()
            self.events += self.core.reports.events
            self.core.reports.events.clear()

    def run(self, seconds: float) -> None:
        self.cycle(count=round(seconds * 1e9 / self.period_ns))

    def do(self, name: str, robot: str, *values: float, within_s: float = 5.0) -> FakeCommand:
        """Ask, and cycle until it is answered for good."""
        command = FakeCommand(name, robot, *values)
        self.cycle([command])
        left = round(within_s * 1e9 / self.period_ns)
        while command.outcome == "accepted" and left:
            self.cycle()
            left -= 1
        return command

    def bring_up(self, robot: str, samples: int = 30) -> None:
        """Powered, biased, checked and held by its joint controller."""
        for name, *values in (("power_on",), ("bias_encoders", samples), ("tracking_check", 1), ("pot_check", 1),
                              ("pid_enable", 1)):
            done = self.do(name, robot, *values)
            assert done.outcome == "done", (name, done.answers, self.events)

    def errors(self) -> list[tuple[str, str]]:
        return [(event.code, event.component) for event in self.events if event.kind == "error"]


def rig_of(name: str, sets: Iterable[str] = COARSE) -> BoardsHarness:
    """A system of a real site on emulated boards."""
    loaded = load_system(stock.find(f"dvrk-site/{name}.json"), search=[stock.find("dvrk-share")], boards="emulated",
                         sets=sets)
    assert loaded.errors == () and loaded.system is not None, loaded.errors
    return BoardsHarness(loaded.system)
