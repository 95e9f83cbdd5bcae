"""The boards process: emulated controllers behind UDP, moving emulated robots."""

from __future__ import annotations

import contextlib

import numpy as np

from procs import runtime
from procs.boards.emulation import Emulation, ns_of
from procs.boards.endpoints import Endpoints
from procs.boards.orders import Orders
from procs.boards.plant import Plant
from shm.ring import RingWriter


class Publisher:
    """Writes the state record at the beginning of every physics step."""

    def __init__(self, out: RingWriter) -> None:
        """Fields are looked up once."""
        self._out = out
        self._fields = {name: out.field(name) for name in (
            "board_ns", "packets", "position", "velocity", "current", "amp_on", "watchdog", "watchdog_ns", "refresh_ns",
            "amps_cut_ns")}

    def publish(self, world: Emulation) -> None:
        """One record."""
        field, rows = self._fields, world.wiring.topic_rows
        powers = [bus.power for bus in world.buses]
        field["board_ns"][...] = world.board_ns
        field["packets"][...] = sum(bus.packets for bus in world.buses)
        field["position"][...], field["velocity"][...] = world.position, world.velocity
        field["current"][...] = world.current
        field["amp_on"][...] = world.lines.on.reshape(-1)[world.wiring.slots]
        field["watchdog"][...] = np.concatenate([p.watchdog for p in powers])[rows]
        for name, ticks in (("watchdog_ns", [p.watchdog_tick for p in powers]),
                            ("refresh_ns", [p.refreshed for p in powers]),
                            ("amps_cut_ns", [p.cut_tick for p in powers])):
            at = np.concatenate(ticks)[rows]
            field[name][...] = [0 if tick < 0 else ns_of(tick) + world.epoch_ns for tick in at.tolist()]
        self._out.publish(world.board_ns)


def main() -> None:
    """Serve until told to stop."""
    with runtime.process("boards") as me, contextlib.ExitStack() as stack:
        emulation = me.document.emulation
        if emulation is None:
            raise ValueError("this system has no emulated boards")
        plant = Plant(me.document)
        publisher = Publisher(me.writes("state"))
        world = Emulation(me.document, plant, me.clock.now_ns())
        world.on_step = lambda: publisher.publish(world)
        orders = Orders(me.document, world, plant)
        mailbox = me.mailbox()
        endpoints = Endpoints(emulation.buses, world.answer, me.clock.now_ns, me.clock.simulated)
        stack.callback(endpoints.close)
        publisher.publish(world)
        skipped = 0
        me.ready()
        while me.tick(endpoints.serve):
            world.advance(me.now_ns)
            for command in mailbox.drain():
                orders.carry_out(command)
            if world.skipped_steps != skipped:
                me.events.warning("BOARDS_LATE", f"stopped for {world.skipped_steps - skipped} physics steps; "
                                  "the robots stood still meanwhile", value=world.skipped_steps - skipped)
                skipped = world.skipped_steps


if __name__ == "__main__":
    main()
