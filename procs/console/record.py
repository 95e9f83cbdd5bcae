"""A console's record: filled every cycle, and the state from which a restarted console resumes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trocar.procs.console.inputs import Inputs
from trocar.procs.console.logic import Logic
from trocar.procs.document.system import Console
from trocar.shm.mailbox.origins import Origin
from trocar.shm.ring.ring import RingReader


class ConsoleRecord:
    """Views on the fields of our own record."""

    def __init__(self, field: Callable[[str], Any], row: Console, logic: Logic) -> None:
        """Fills in the constant fields."""
        self._logic = logic
        self._names = [member.name for member in logic.mine]
        changing = ("valid", "operator_present", "clutch", "camera", "teleop_enabled", "origin", "generation",
                    "program", "scale", "selected", "asked", "present_inputs")
        self._fields = {name: field(name) for name in changing}
        field("input_type")[...] = row.input_type.encode()
        field("teleop")[...] = [name.encode() for name in self._names]
        field("kind")[...] = [member.kind.encode() for member in logic.mine]

    def fill(self, inputs: Inputs) -> None:
        """Write the current state."""
        logic, fields = self._logic, self._fields
        for name, value in (("valid", inputs.valid), ("operator_present", logic.operator), ("clutch", logic.clutch),
                            ("camera", logic.camera), ("teleop_enabled", logic.wanted), ("scale", logic.scale),
                            ("origin", logic.origin.id), ("generation", logic.origin.generation),
                            ("program", logic.origin.program.encode()),
                            ("present_inputs", inputs.seen)):
            fields[name][...] = value
        for place, name in enumerate(self._names):
            fields["selected"][place] = name in logic.selected
            fields["asked"][place] = logic.asked[name].encode()


def go_on(last: RingReader, logic: Logic) -> bool:
    """Take over the requests to an earlier console of this name; false: there was none.

    The operator counts as absent and pedals as released until they are detected again.
    """
    if not last.newest():
        return False
    names = [bytes(name).decode() for name in last.field("teleop")]
    logic.selected = {name for name, on in zip(names, last.field("selected"), strict=True) if on and logic.knows(name)}
    logic.wanted = bool(last.field("teleop_enabled"))
    logic.origin = Origin(int(last.field("origin")), int(last.field("generation")),
                          bytes(last.field("program").item()).decode(errors="replace"))
    logic.scale = float(last.field("scale"))
    return True
