"""Digital inputs: debounced values and button events for all inputs of a process at once.

Inputs are pulled up, and a closed contact pulls them low. `pressed_value` in the files is the value while the bit is
low: true for a contact that closes when pressed, false for one that opens. Value true means pressed.

A changed bit must stay for the debounce time; the next poll then takes the present value. A shorter change is a click
if it ends released and lasted longer than the click time (default 0: every short press of at least two polls clicks).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import DigitalInput

PRESSED: Final = 0
RELEASED: Final = 1
CLICKED: Final = 2
NAMES: Final = ("pressed", "released", "clicked")

_NOTHING: Final[list[tuple[int, int]]] = []


class Debounce:
    """Debounced values (n,) of digital inputs; true means pressed."""

    def __init__(self, inputs: Sequence[DigitalInput]) -> None:
        """Take the inputs in the order of the document."""
        n = len(inputs)
        self.value: NDArray[np.bool_] = np.zeros(n, dtype=bool)
        self.when_low = np.array([i.pressed_value for i in inputs], dtype=bool)
        self._debounce = np.array([i.debounce_s for i in inputs])
        self._click = np.array([i.debounce_click_s for i in inputs])
        self._clicks = self._click != self._debounce
        self._triggers = np.array(
            [[i.trigger_when_pressed, i.trigger_when_released] for i in inputs], dtype=bool).reshape(n, 2)
        self._quiet_first = np.array([i.skip_first_run for i in inputs], dtype=bool)
        self.pressed = np.zeros(n, dtype=bool)
        self.pending = np.zeros(n, dtype=bool)
        self._candidate = np.zeros(n, dtype=bool)
        self._counter = np.zeros(n)
        self.is_first = True

    def poll(self, bits: NDArray[np.bool_], dt: float) -> list[tuple[int, int]]:
        """Process raw `bits` (n,), `dt` s after the last poll; returns (input, PRESSED, RELEASED or CLICKED)."""
        return self.settle(dt) if self.watch(bits) or self.is_first else _NOTHING

    def watch(self, bits: NDArray[np.bool_]) -> bool:
        """Take raw `bits` (n,); True if some differ from `value` or are pending: call `settle`."""
        np.not_equal(bits, self.when_low, self.pressed)
        return self.pressed.tobytes() != self.value.tobytes() or b"\1" in self.pending.tobytes()

    def settle(self, dt: float) -> list[tuple[int, int]]:
        """Process the bits taken last, `dt` s after those before; returns events as `poll` does."""
        return self._begin(dt) if self.is_first else self._changed(dt)

    def _begin(self, dt: float) -> list[tuple[int, int]]:
        """Accept and report the first values; inputs with `skip_first_run` treat them as a change from released."""
        self.is_first = False
        at_once = ~self._quiet_first
        np.copyto(self.value, self.pressed, where=at_once)
        return self._events(at_once, np.zeros_like(at_once)) + self._changed(dt)

    def _changed(self, dt: float) -> list[tuple[int, int]]:
        now, pending = self.pressed, self.pending
        waiting = pending & (self._counter < self._debounce)
        ripe = pending & ~waiting
        broken = waiting & (now != self._candidate)
        clicked = broken & self._clicks & ~now & (self._counter > self._click)
        self._counter[waiting & ~broken] += dt
        at_once = ~pending & (now != self.value) & (self._debounce == 0.0)
        begins = ~pending & (now != self.value) & ~at_once
        taken = (ripe | at_once) & (now != self.value)
        np.copyto(self.value, now, where=ripe | at_once)
        np.copyto(pending, (pending | begins) & ~ripe & ~broken)
        self._counter[begins] = 0.0
        np.copyto(self._candidate, now, where=begins)
        return self._events(taken, clicked)

    def _events(self, changed: NDArray[np.bool_], clicked: NDArray[np.bool_]) -> list[tuple[int, int]]:
        events = []
        for index in np.flatnonzero(changed | clicked).tolist():
            if clicked[index]:
                events.append((index, CLICKED))
                continue
            kind = PRESSED if self.value[index] else RELEASED
            if self._triggers[index, kind]:
                events.append((index, kind))
        return events
