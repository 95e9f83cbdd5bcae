"""The operator as the console tells of them."""

from __future__ import annotations

from trocar.procs.node.inputs import Input


class Operator:
    """`absence` is why the operator counts as absent, "": there; without a console (None) always there.

    `clutch`: as its record has it, for who has missed its commands.
    """

    def __init__(self, console: str, record: Input | None) -> None:
        self.console, self._record = console, record
        self.absence, self.is_silent, self.clutch = "", record is not None, False
        if record is not None:
            self._valid, self._present = record.field("valid"), record.field("operator_present")
            self._clutch = record.field("clutch")

    def look(self, now_ns: int) -> None:
        """Once a cycle; a console that was started anew counts as silent for that cycle."""
        if self._record is None:
            return
        whole = self._record.look(now_ns)
        self.is_silent = self._record.restarted or not self._record.fresh
        if whole:
            self.clutch = bool(self._clutch)
        if self.is_silent:
            self.absence = f"console {self.console} is silent"
        elif whole and not self._valid:
            self.absence = f"console {self.console} does not see its inputs"
        elif whole:
            self.absence = "" if self._present else f"console {self.console} sees no operator"
