"""Motion of an endoscope's lens: two outputs that focus in and out while their pins are low, two pedals, a lock.

Nothing here uses shared memory; the caller supplies the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from trocar.procs.focus.loop import Wires

IN, OUT = 0, 1
NAMES: Final = ("in", "out")
COMMANDED_NS: Final = 10_000_000_000  # without a pressed pedal, focusing ends after this time
AGAIN_NS: Final = 100_000_000  # until a pin that is not as it should be is written again


class Lens:
    """One way at a time, or none; `locked`: none."""

    def __init__(self, wires: Wires) -> None:
        """At rest."""
        self._wires = wires
        self.locked = False
        self.focusing = [False, False]
        self._pedals = [False, False]
        self._until_ns = 0  # 0: a pedal is held
        self._written_ns = [-AGAIN_NS, -AGAIN_NS]

    def lock(self, on: bool) -> None:
        """Locked: it stops, and cannot be moved."""
        if on is self.locked:
            return
        self.locked = on
        if on:
            self.rest()
        self._wires.report("locked", on)

    def ask(self, way: int, on: bool, until_ns: int = 0) -> str:
        """Start to focus, at most until then (0: no limit), or stop; returns the reason of a refusal, "": accepted."""
        if not on:
            if self.focusing[way]:
                self._set(way, False)
            return ""
        if self.locked:
            return "the focus is locked"
        if self.focusing[1 - way]:
            return f"it is focusing {NAMES[1 - way]}"
        self._until_ns = until_ns
        if not self.focusing[way]:
            self._set(way, True)
        return ""

    def rest(self) -> None:
        """Stop."""
        for way in (IN, OUT):
            self.ask(way, False)

    def step(self, now_ns: int, pedals: Sequence[bool], pins: Sequence[bool] | None) -> None:
        """Once a cycle: the pressed `pedals`, and whether the pins are high, None: unknown."""
        for way, pressed in enumerate(pedals):
            if pressed is not self._pedals[way]:
                self._pedals[way] = pressed
                self.ask(way, pressed)
        if self._until_ns and now_ns >= self._until_ns:
            self._until_ns = 0
            self.rest()
        for way, high in enumerate(pins or ()):
            if high is self.focusing[way] and now_ns - self._written_ns[way] >= AGAIN_NS:
                self._written_ns[way] = now_ns
                self._wires.write(way, not self.focusing[way])

    def _set(self, way: int, on: bool) -> None:
        self.focusing[way] = on
        self._written_ns[way] = -AGAIN_NS  # with the next cycle's look at the pins
        self._wires.report(f"focusing_{NAMES[way]}", on)
