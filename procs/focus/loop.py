"""The process of an endoscope's focus: pedals and commands in, two digital outputs of an io out."""

from __future__ import annotations

from typing import Final

from procs import runtime
from procs.focus.lens import COMMANDED_NS, IN, OUT, Lens
from procs.lib.document import Focus, WiredInput
from procs.lib.requests import Request
from shm.ring import RingReader

STALE_NS: Final = 30_000_000
WAYS: Final = {"focus_in": IN, "focus_out": OUT}


class Wires:
    """Pedals and outputs on the records of io; the desk of `procs.focus.lens`."""

    def __init__(self, me: runtime.Me, row: Focus) -> None:
        """Attaches to the rings of the ios, and takes a place in the mailbox of the one with the outputs."""
        self._me, self._row = me, row
        self._rings = {io: me.reads(io, "state") for io in {row.io, *(w.io for w in row.pedals if w is not None)}}
        self._fields = {io: (ring.field("input"), ring.field("output"), ring.field("age_ns"))
                        for io, ring in self._rings.items()}
        outputs = [output.name for output in me.document.io(row.io).digital_outputs]
        self._places = [outputs.index(name) for name in row.outputs]
        self._client = me.commands(row.io)

    def pedals(self) -> list[bool]:
        """Those of the two that are pressed; one that nobody hears from is not."""
        return [self._pressed(wired) for wired in self._row.pedals]

    def pins(self) -> list[bool] | None:
        """Whether the two outputs are high; None: nobody knows."""
        ring = self._fresh(self._row.io)
        self._client.poll()
        if ring is None:
            return None
        levels = self._fields[self._row.io][1]
        return [bool(levels[place]) for place in self._places]

    def write(self, way: int, high: bool) -> None:
        """See Desk."""
        self._client.send("set_output", (float(high),), self._row.outputs[way])

    def tell(self, event: str, on: bool) -> None:
        """See Desk."""
        self._me.events.emit(event, component=self._me.name, value=float(on))

    def _pressed(self, wired: WiredInput | None) -> bool:
        if wired is None or self._fresh(wired.io) is None:
            return False
        return bool(self._fields[wired.io][0][self._me.document.inputs(wired.io).index(wired.name)])

    def _fresh(self, io: str) -> RingReader | None:
        ring = self._rings[io]
        if ring.newest() and self._me.now_ns - ring.stamp_ns + int(self._fields[io][2]) <= STALE_NS:
            return ring
        return None


def carry_out(request: Request, lens: Lens, now_ns: int) -> None:
    """One command; refused with the reason."""
    if len(request.values) != 1 or request.values[0] not in (0.0, 1.0):
        request.refuse(f"{request.name} takes 1 (on) or 0 (off)")
        return
    on, reason = bool(request.values[0]), ""
    if request.name == "lock":
        lens.lock(on)
    else:
        reason = lens.ask(WAYS[request.name], on, now_ns + COMMANDED_NS)
    request.refuse(f"{request.name}: {reason}") if reason else request.done()


def main() -> None:
    """Run until asked to stop; the lens then rests."""
    with runtime.process("focus") as me:
        wires = Wires(me, me.document.focus_of(me.name))
        lens, state, mailbox = Lens(wires), me.writes("state"), me.mailbox()
        valid, locked, focusing = (state.field(name) for name in ("valid", "locked", "focusing"))
        mailbox.refuse_waiting(f"{me.name} has just started; ask again")
        me.ready()
        while me.tick():
            for request in mailbox.drain(me.wall_ns):
                carry_out(request, lens, me.now_ns)
            pins = wires.pins()
            lens.step(me.now_ns, wires.pedals(), pins)
            valid[...], locked[...], focusing[...] = pins is not None, lens.locked, lens.focusing
            state.publish(me.now_ns)
        for way in (IN, OUT):
            wires.write(way, True)


if __name__ == "__main__":
    main()
