"""Rows of the command table for stand-ins of commands: so they are checked as real ones are."""

from __future__ import annotations

from functools import cache

from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import POWER, SOME, Argument, CommandRow


@cache
def row_named(name: str, kind: str = "") -> CommandRow:
    """The row of this name of a kind, or of the first kind that has one; of an unknown command one that takes anything.
    """
    tables = (COMMANDS[kind],) if kind else COMMANDS.values()
    unknown = CommandRow(name, POWER, "", (Argument("numbers", size=SOME),))
    return next((row for rows in tables for row in rows if row.name == name), unknown)
