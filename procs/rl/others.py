"""What others ask of an arm while an environment has it: whoever does takes it over, and the environment ends."""

from __future__ import annotations

from typing import Final

from trocar.procs.crtk.plain import plain
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import SETTING
from trocar.shm.ring.ring import RingReader

ROWS: Final = {row.name: row for row in COMMANDS["arm"]}
BASE: Final = "set_base_frame"
"""Where the base is, is seen in the arm's state."""


class OtherCommands:
    """Reads who asked an arm for what, from its audit ring."""

    def __init__(self, audit: RingReader, own: int) -> None:
        """`own`: number of the person's command that all we ask belongs to; who made the reader closes it."""
        self._audit, self._own, self._asked = audit, own, ""
        self._command, self._text, self._outcome = audit.field("command"), audit.field("text"), audit.field("outcome")
        self._origin, self._program = audit.field("origin"), audit.field("program")
        self._is_stop = False
        audit.rewind(0)

    def begin(self) -> None:
        """What moved it until now does not count; what stopped it does, since we were made."""
        while self.look() and not self._is_stop:
            self._asked = ""

    def look(self) -> str:
        """What moves or stops it, was asked by others, and counts, and by whom; empty: nothing was."""
        while not self._asked and self._audit.next():
            command = str(plain(self._command.item()))
            row = ROWS.get(command)
            is_harmless = command == BASE or (row is not None and row.effect <= SETTING)
            if self._origin[()] == self._own or is_harmless or self._outcome[()] in (b"refused", b"failed"):
                continue
            text = str(plain(self._text.item()))
            self._is_stop = row is not None and row.is_stop(text, ())
            self._asked = f"{command} {text}".rstrip() + f" by {plain(self._program.item()) or 'another process'}"
        if self._audit.lost:  # a stop may have been among it
            self._asked, self._is_stop = f"more than is kept: {self._audit.lost} commands are not known any more", True
        return self._asked
