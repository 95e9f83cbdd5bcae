"""The boards process: emulated controllers behind UDP, moving emulated robots."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.board_commands import BoardCommands
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.endpoints import Endpoints
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.native.library import native
from trocar.procs.node import runtime
from trocar.procs.tables import codes
from trocar.shm.ring.ring import RingWriter

BEHIND_STEP_NS = 2_000  # we wake as a step begins: no query then waits until one is taken


class Publisher:
    """Writes the state record at the beginning of every physics step."""

    def __init__(self, out: RingWriter, world: Emulation) -> None:
        """Fields are looked up once."""
        self._out, self._world = out, world
        self._board_ns, self._packets = out.field("board_ns"), out.field("packets")
        self._position, self._velocity, self._current = (out.field(n) for n in ("position", "velocity", "current"))
        self._amp_on, self._watchdog = out.field("amp_on"), out.field("watchdog")
        self._watchdog_ns, self._cut_ns = out.field("watchdog_ns"), out.field("amps_cut_ns")
        self._refresh_ns = out.field("refresh_ns")
        self._rows = world.wiring.topic_rows
        self._changes = -1
        self._ticks = np.zeros(len(self._rows), dtype=np.int64)
        self._ratio = tuple(np.full(len(self._rows), k, dtype=np.int64) for k in (-15625, 768, world.epoch_ns))

    def publish(self) -> None:
        """One record."""
        world, powers, now = self._world, [bus.power for bus in self._world.buses], self._world.board_ns
        self._board_ns[...] = now
        self._packets[...] = sum([bus.packets for bus in world.buses])
        self._position[...], self._velocity[...], self._current[...] = world.position, world.velocity, world.current
        self._times([power.refreshed for power in powers], self._refresh_ns)
        changes = sum([power.changes for power in powers])
        if changes != self._changes:
            self._changes = changes
            self._amp_on[...] = world.lines.on.reshape(-1)[world.wiring.slots]
            self._watchdog[...] = np.concatenate([power.watchdog for power in powers])[self._rows]
            for field, ticks in ((self._watchdog_ns, [power.watchdog_tick for power in powers]),
                                 (self._cut_ns, [power.cut_tick for power in powers])):
                self._times(ticks, field)
                field[self._ticks < 0] = 0  # never
        self._out.publish(now)

    def _times(self, ticks: list[npt.NDArray[np.int64]], field: npt.NDArray[np.int64]) -> None:
        """`ns_of` the ticks of every bus's boards, on the system's clock, in the topic's order."""
        every = ticks[0] if len(ticks) == 1 else np.concatenate(ticks)
        every.take(self._rows, None, self._ticks, "clip")
        up, down, epoch = self._ratio
        ns = np.multiply(self._ticks, up)
        np.floor_divide(ns, down, ns)
        np.subtract(epoch, ns, field)


class BoardsLoop(runtime.Loop):
    """All emulated boards with their robots."""

    def setup(self) -> None:
        node = self.node
        node.computes(native().why)
        system, emulation = node.document.emulated(), node.document.emulation
        if emulation is None:
            raise ValueError("this system has no emulated boards")
        plant = Plant(system)
        self.world = world = Emulation(system, plant, node.clock.now_ns())
        publisher = Publisher(node.writes("state"), world)
        world.on_step = publisher.publish
        self._orders, self._mailbox = BoardCommands.of(system, world, plant), node.mailbox()
        self._serve = self._open()
        self._skipped = 0
        publisher.publish()

    def _open(self) -> Callable[[int], bool] | None:
        """Serves requests meanwhile, see Node.tick; None: clients call `world.answer` directly."""
        node, world, emulation = self.node, self.world, self.node.document.emulation
        assert emulation is not None
        return node.hold(Endpoints(emulation.buses, world.answer, node.clock.now_ns, node.clock.simulated,
                                   world.packet_faults, world.board_at, node.clock.wakeup)).serve

    def tick(self) -> bool:
        return self.node.tick(self._serve)

    def update(self) -> None:
        world, node = self.world, self.node
        world.advance(node.now_ns)
        node.follow(world.board_ns, BEHIND_STEP_NS)
        for command in self._mailbox.drain(node.wall_ns):
            self._orders.carry_out(command)
        if world.skipped_steps != self._skipped:
            steps, self._skipped = world.skipped_steps - self._skipped, world.skipped_steps
            node.events.report(codes.BOARDS_LATE, f"stalled for {steps} physics steps; the robots stood still "
                                   "meanwhile", value=steps)


def main() -> None:
    """Serve until stopped."""
    runtime.run("boards", BoardsLoop)


if __name__ == "__main__":
    main()
