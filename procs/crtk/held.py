"""Buttons and the like that clients of a bridge hold down, and that are released when the client is gone.

Motion of joints is not among them, as it ends by itself. A page of the web console holds them down while it has
control. The column `ended_by` of the command table lists these commands, and those that end them. Commands of a stream
(a lift, a lens, a pulled tip) end at once. A setup arm's clutch and an emulated operator stay while any page has
control, so that an operator can change between pages; they end when no page has had control for a while. Pedals stay
pressed, because a slave might follow again when one is released.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from trocar.procs.crtk.calls import Calls
from trocar.procs.crtk.messages import WrongMessage
from trocar.shm.mailbox.command_row import ITSELF, CommandRow

OFF: Final = (0.0,)
Held = tuple[str, str, tuple[float, ...], str]
"""The receiver, and the command that releases, with its values and text."""


def ending(to: str, row: CommandRow, text: str) -> Held:
    """The command that ends command `row` at instance `to`."""
    return (to, row.name, OFF, text) if row.ended_by == ITSELF else (to, row.ended_by, (), text)


def presses(row: CommandRow, values: Sequence[float]) -> bool | None:
    """Whether a command presses (True) or releases (False); None: it will be refused."""
    return None if row.objection(values) else any(values)


class HeldDown:
    """Commands that are held down, each with its page, or "" if there is only one client."""

    def __init__(self, calls: Calls) -> None:
        """`calls`: separate from those of pages, because it outlives them."""
        self._calls = calls
        self._held: dict[Held, tuple[str, bool]] = {}

    def note(self, page: str, to: str, command: str, values: list[float], text: str) -> None:
        """Record a command of a page."""
        row = self._calls.owner(to).rows.get(command)
        if row is None or (pressed := presses(row, values)) is None:
            return
        if row.ended_by:
            held = ending(to, row, text)
            if pressed:
                self._held[held] = page, bool(row.stream)
            else:
                self._held.pop(held, None)
        self._held.pop((to, command, tuple(values), text), None)

    def tick(self, holder: str, is_free: bool) -> None:
        """Release commands of pages without control; releases that cannot be sent are repeated in the next tick.

        `holder`: the page that has control. `is_free`: no page has had control for a while.
        """
        self._let_go(lambda page, at_once: page != holder if at_once else is_free)

    def end(self) -> None:
        """Release everything at the end of the console."""
        self._let_go(lambda page, at_once: True)

    def _let_go(self, is_over: Callable[[str, bool], bool]) -> None:
        for held, (page, at_once) in tuple(self._held.items()):
            if is_over(page, at_once):
                to, command, values, text = held
                with suppress(WrongMessage):
                    self._calls.send(None, to, command, list(values), text)
                    del self._held[held]
        for _ in self._calls.replies():
            pass

    def close(self) -> None:
        """Close the connections; commands under way finish."""
        self._calls.close()
