"""The operator as the console tells of them."""

from __future__ import annotations

from typing import Final

from procs.teleop.arms import RecordRing

SILENT_NS: Final = 30_000_000  # three of its periods


class Operator:
    """`absence` is why the operator counts as absent, "": there; without a console (None) always there.

    `clutch`: as its record has it, for who has missed its commands.
    """

    def __init__(self, console: str, ring: RecordRing | None) -> None:
        self._console, self._ring = console, ring
        self.absence, self.is_silent, self.clutch = "", ring is not None, False
        self._stamp_ns = self._epoch = 0
        if ring is not None:
            self._valid, self._present = ring.field("valid"), ring.field("operator_present")
            self._clutch = ring.field("clutch")

    def look(self, now_ns: int) -> None:
        """Once a cycle; a console that was started anew counts as silent for that cycle."""
        if self._ring is None:
            return
        epoch = self._ring.epoch
        restarted, self._epoch = self._epoch not in (0, epoch), epoch
        whole = self._ring.newest()
        if whole:
            self._stamp_ns = self._ring.stamp_ns
        self.is_silent = restarted or not now_ns - self._stamp_ns <= SILENT_NS
        if whole:
            self.clutch = bool(self._clutch)
        if self.is_silent:
            self.absence = f"console {self._console} is silent"
        elif whole and not self._valid:
            self.absence = f"console {self._console} does not see its inputs"
        elif whole:
            self.absence = "" if self._present else f"console {self._console} sees no operator"
