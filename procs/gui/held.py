"""What pages hold down beside joints, which end by themselves: it is let go when the page has lost control.

A lift, a lens and a tip that is pulled are let go at once. A setup arm's clutch and an operator who is emulated stay
while anybody has control, so that one may go from page to page and watch; they end when nobody has had it for a while.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from procs.crtk.calls import Calls
from procs.crtk.messages import WrongMessage


@dataclass(frozen=True, slots=True)
class LettingGo:
    """The command that ends what another one began; `at_once`: with that page's control, else with everybody's."""

    command: str
    values: tuple[float, ...]
    at_once: bool = True


OFF: Final = (0.0,)
ENDINGS: Final[Mapping[tuple[str, str], LettingGo]] = {
    ("boards", "pull_tip"): LettingGo("release_tip", ()),
    ("suj", "set_lift_velocity"): LettingGo("set_lift_velocity", OFF),
    ("suj", "clutch"): LettingGo("clutch", OFF, at_once=False),
    ("focus", "focus_in"): LettingGo("focus_in", OFF),
    ("focus", "focus_out"): LettingGo("focus_out", OFF),
    ("console", "emulate_operator_present"): LettingGo("emulate_operator_present", OFF, at_once=False),
}
"""By kind and command that begins it. Pedals stay as they are: a slave may follow again where one is released."""

Held = tuple[str, str, tuple[float, ...], str]
"""To whom, and the command that lets go, with its values and text."""


class HeldDown:
    """What is held down now, and by which page."""

    def __init__(self, calls: Calls) -> None:
        """`calls`: its own, which outlive those of pages."""
        self._calls = calls
        self._held: dict[Held, tuple[str, bool]] = {}

    def note(self, page: str, to: str, command: str, values: list[float], text: str) -> None:
        """A page has commanded this."""
        kind = self._calls.owner(to).kind
        if ending := ENDINGS.get((kind, command)):
            held = to, ending.command, ending.values, text
            if any(values):
                self._held[held] = page, ending.at_once
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
