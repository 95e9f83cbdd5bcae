"""Reports of an arm: once, or once in a while, or once an episode."""

from __future__ import annotations

from typing import Final

from trocar.procs.arm.clipping import EPISODE_NS
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables.code_row import Code
from trocar.shm.system.events import Events

REPORT_NS: Final = 2_000_000_000
NEVER_NS: Final = 1 << 62


class ArmReports:
    """Reports of the arm `name`; `now_ns` is this cycle's time."""

    def __init__(self, name: str, reports: Events) -> None:
        self._name, self.reports = name, reports
        self.now_ns = 0
        self._reported_ns: dict[Code, int] = {}
        self._episodes_ns: dict[Code, int] = {}

    def status(self, text: str) -> None:
        """Report a status of this arm."""
        self.reports.status(f"{self._name}: {text}", self._name)

    def report(self, code: Code, text: str, every_ns: int = 0, has_remedy: bool = False) -> None:
        """Report a warning, or an error that does not stop this arm; the same code again only after `every_ns`."""
        if self.now_ns - self._reported_ns.get(code, -NEVER_NS) >= every_ns:
            self._reported_ns[code] = self.now_ns
            self.reports.report(code, f"{self._name}: {text}", self._name, has_remedy=has_remedy)

    def refusal(self, code: Code, name: str, reason: str, every_ns: int = 0, *,
                has_remedy: bool = False) -> CommandRefused:
        """Report the refusal of command `name`; returns the exception to raise. `has_remedy`: see Events.report."""
        self.report(code, f"{name}: {reason}", every_ns, has_remedy)
        return CommandRefused(reason)

    def report_episode(self, code: Code, text: str) -> None:
        """Report a repeated condition once, until it has been absent for a while."""
        last_ns = self._episodes_ns.get(code, -NEVER_NS)
        self._episodes_ns[code] = self.now_ns
        if self.now_ns - last_ns >= EPISODE_NS:
            self.report(code, text)
