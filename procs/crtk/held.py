"""What clients of a bridge hold down beside joints, which end by themselves: it is released when they are gone.

A page of the web console holds it while it has control. Which commands that are, and what ends them, is the column
`ended_by` of the command table. What belongs to a stream (a lift, a lens, a tip that is pulled) is released at once. A
setup arm's clutch and an emulated operator stay while any page has control, so that an operator can change between
pages; they end when no page has had it for a while. Pedals stay as they are: a slave may follow again where one is
released.
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
"""To whom, and the command that lets go, with its values and text."""


def ending(to: str, row: CommandRow, text: str) -> Held:
    """What releases what `row` began at `to`."""
    return (to, row.name, OFF, text) if row.ended_by == ITSELF else (to, row.ended_by, (), text)


def presses(row: CommandRow, values: Sequence[float]) -> bool | None:
    """Whether it holds something down, or lets go of it; None: neither, as it is refused."""
    return None if row.objection(values) else any(values)


class HeldDown:
    """What is held down now, and by which page, "" where there is one client only."""

    def __init__(self, calls: Calls) -> None:
        """`calls`: its own, which outlive those of pages."""
        self._calls = calls
        self._held: dict[Held, tuple[str, bool]] = {}

    def note(self, page: str, to: str, command: str, values: list[float], text: str) -> None:
        """A page has commanded this."""
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
        """Let go of what the page that has control does not hold; what cannot be sent now is sent in the next tick.

        `is_free`: nobody has had control for a while.
        """
        self._let_go(lambda page, at_once: page != holder if at_once else is_free)

    def end(self) -> None:
        """Let go of everything: the console ends."""
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
        """What is under way finishes."""
        self._calls.close()
