"""Why a command is refused before its owner sees it: it is late, or no operator's command authorizes it.

One rule for all entries: mailboxes, requests from arms to io, test stand-ins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from trocar.shm.mailbox.command_row import CommandRow, Numbers
from trocar.shm.mailbox.origins import Origin

if TYPE_CHECKING:
    from trocar.shm.mailbox.generations import Cell

LATE_NS: Final = 1_000_000_000


def authorizes(origin: Origin, cell: Cell) -> bool:
    """Whether this is an operator's command, given since the last fault or stop of the cell's component."""
    return bool(origin.id) and (origin.generation >= cell.valid_from or origin.id == cell.exempt_origin)


def unauthorized(row: CommandRow, text: str, values: Numbers, origin: Origin, cell: Cell | None) -> str:
    """Why it is not authorized, "": it is, or need not be. `cell`: None if no authorization is needed."""
    if cell is None or authorizes(origin, cell) or not row.needs_operator(text, values):
        return ""
    before = f" ({origin.program or 'a program'} gave its command earlier)" if origin.id else ""
    stream = "; a stream that began before must pause first" if origin.id and row.stream else ""
    return (f"{row.name}: not authorized{before}: needs an operator's command given after the last fault, "
            f"power-off or hold{stream}")


def late(row: CommandRow, text: str, values: Numbers, waited_ns: int) -> str:
    """Why it is too late for execution, `waited_ns` after it was sent; "": it is in time."""
    if waited_ns <= LATE_NS or not row.expires(text, values):
        return ""
    return f"it arrived {waited_ns * 1e-9:.1f} s late; allowed: {LATE_NS * 1e-9} s; send it again"
