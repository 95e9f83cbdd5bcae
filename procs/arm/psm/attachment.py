"""Something that is put on a PSM: its sterile adapter, or an instrument. Is it there, does it have to be engaged?

What is known of it stands in the arm's own record, so that a successor goes on from there.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

from numpy.typing import NDArray

SETTLE_NS: Final = 500_000_000  # a switch that has just begun to be looked at has come to its level by then


class AttachmentState(IntEnum):
    """How it is with it, as published."""

    UNKNOWN = 0  # nobody has looked yet
    ABSENT = 1
    FOUND = 2  # it was on from the start: taken for engaged as soon as the arm is homed
    NEW = 3  # it was attached since: the discs have to be turned until it catches
    ENGAGED = 4


class Attachment:
    """One of them; `look` each cycle."""

    def __init__(self, cell: NDArray[Any], reported: NDArray[Any], *, has_switch: bool, always: bool = False) -> None:
        """`cell` and `reported` of the record hold the fit and that it is there because somebody says so.

        `has_switch`: an input of io tells when it is on. `always`: it is never taken off.
        """
        self._cell, self._reported = cell, reported
        self.present = self.waits = self.is_settled = False
        """It is on; it is on and not engaged; it is engaged, or not there."""
        self.fit = AttachmentState(min(int(cell.item()), AttachmentState.ENGAGED))
        self.has_switch, self._always = has_switch, always
        self._settled_ns = 0
        if always and self.fit is AttachmentState.UNKNOWN:
            self.fit = AttachmentState.ENGAGED

    @property
    def fit(self) -> AttachmentState:
        """How it is with it."""
        return self._fit

    @fit.setter
    def fit(self, fit: AttachmentState) -> None:
        self._fit = fit
        self._cell[...] = fit
        self.present = fit >= AttachmentState.FOUND
        self.waits = fit in (AttachmentState.FOUND, AttachmentState.NEW)
        self.is_settled = fit in (AttachmentState.ENGAGED, AttachmentState.ABSENT)

    def say(self, on: bool) -> None:
        """It is on from now on whatever its switch says; or the switch counts again."""
        self._reported[...] = on

    def look(self, pressed: bool, now_ns: int) -> bool:
        """Its switch is `pressed`; True when it was put on, found or taken off."""
        before = self._fit
        if before is AttachmentState.UNKNOWN and self.has_switch:
            self._settled_ns = self._settled_ns or now_ns + SETTLE_NS
            if now_ns < self._settled_ns:
                return False
        on = self._always or pressed or bool(self._reported.item())
        if on is self.present and before is not AttachmentState.UNKNOWN:
            return False
        new = AttachmentState.FOUND if before is AttachmentState.UNKNOWN else AttachmentState.NEW
        self.fit = new if on else AttachmentState.ABSENT
        return on or before is not AttachmentState.UNKNOWN
