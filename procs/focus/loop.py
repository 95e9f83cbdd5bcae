"""The process of an endoscope's focus: pedals and commands in, two digital outputs of an io out."""

from __future__ import annotations

from typing import Any, Final

from numpy.typing import NDArray

from trocar.procs.document.system import Focus, WiredInput
from trocar.procs.focus.lens import COMMANDED_NS, IN, OUT, Lens
from trocar.procs.node import runtime
from trocar.procs.node.node import Node
from trocar.procs.node.requests import CommandRefused, carry_out, switch
from trocar.shm.mailbox.received import Request

WAYS: Final = {"focus_in": IN, "focus_out": OUT}


class Wires:
    """Pedals and outputs on the records of io, for `trocar.procs.focus.lens`."""

    def __init__(self, node: Node, row: Focus) -> None:
        """Attaches to the rings of the ios, and takes a place in the mailbox of the one with the outputs."""
        self._node, self._row = node, row
        self._ios = {io: node.input(io) for io in {row.io, *(w.io for w in row.pedals)}}
        self._ages = {io: record.field("age_ns") for io, record in self._ios.items()}
        outputs = [output.name for output in node.document.io(row.io).digital_outputs]
        self._pins = [self._ios[row.io].field("output")[outputs.index(name), ...] for name in row.outputs]
        self._pedals = [self._pedal(wired) for wired in row.pedals]
        self._client = node.commands(row.io)

    def _pedal(self, wired: WiredInput) -> tuple[str, NDArray[Any]]:
        """Its io, and its place in the record of that."""
        place = self._node.document.inputs(wired.io).index(wired.name)
        return wired.io, self._ios[wired.io].field("input")[place, ...]

    def pedals(self) -> list[bool]:
        """Those of the two that are pressed; one without data counts as released."""
        return [self._is_fresh(io) and bool(cell) for io, cell in self._pedals]

    def pins(self) -> list[bool] | None:
        """Whether the two outputs are high; None: unknown."""
        self._client.poll()
        return [bool(pin) for pin in self._pins] if self._is_fresh(self._row.io) else None

    def write(self, way: int, high: bool) -> None:
        """Set one of the two outputs."""
        self._client.send("set_output", (float(high),), self._row.outputs[way])

    def report(self, event: str, on: bool) -> None:
        """Emit an event."""
        self._node.events.emit(event, component=self._node.name, value=float(on))

    def _is_fresh(self, io: str) -> bool:
        record = self._ios[io]
        record.look(self._node.now_ns)
        return record.sampled(int(self._ages[io]))


def execute(request: Request, lens: Lens, now_ns: int) -> None:
    """Carry out one command."""
    on = switch(request)
    if request.name == "lock":
        lens.lock(on)
    elif reason := lens.ask(WAYS[request.name], on, now_ns + COMMANDED_NS):
        raise CommandRefused(reason)


class FocusLoop(runtime.Loop):
    """One endoscope's focus."""

    def setup(self) -> None:
        node = self.node
        self._wires = Wires(node, node.document.focus_of(node.name))
        self._lens, self._state, self._mailbox = Lens(self._wires), node.writes("state"), node.mailbox()
        field = self._state.field
        self._valid, self._locked, self._focusing = field("valid"), field("locked"), field("focusing")

    def update(self) -> None:
        """See runtime.Loop."""
        lens, wires, now_ns = self._lens, self._wires, self.node.now_ns
        for request in self._mailbox.drain(self.node.wall_ns):
            carry_out(request, lambda each: execute(each, lens, now_ns))
        pins = wires.pins()
        lens.step(now_ns, wires.pedals(), pins)
        self._valid[...], self._locked[...], self._focusing[...] = pins is not None, lens.locked, lens.focusing
        self._state.publish(now_ns)

    def quit(self) -> None:
        """The lens rests."""
        if hasattr(self, "_wires"):
            for way in (IN, OUT):
                self._wires.write(way, True)


def main() -> None:
    """Run until stopped; the lens then rests."""
    runtime.run("focus", FocusLoop)


if __name__ == "__main__":
    main()
