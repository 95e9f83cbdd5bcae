"""An attachment of a PSM, its sterile adapter or an instrument: whether it is present and must be engaged.

Its state is kept in the arm's own record, so that a restarted process continues from there.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

from numpy.typing import NDArray

SETTLE_NS: Final = 500_000_000  # a switch that is newly observed has reached its level by then


class AttachmentState(IntEnum):
    """State of the attachment, as published."""

    UNKNOWN = 0  # not observed yet
    ABSENT = 1
    FOUND = 2  # present at start: taken as engaged once the arm is homed
    NEW = 3  # attached later: the discs have to turn until it engages
    ENGAGED = 4


class Attachment:
    """One attachment; call `look` each cycle."""

    def __init__(self, cell: NDArray[Any], reported: NDArray[Any], *, has_switch: bool, always: bool = False) -> None:
        """`cell` and `reported` are fields of the record: the state, and "present by command".

        `has_switch`: an input of io shows its presence. `always`: it is never removed.
        """
        self._cell, self._reported = cell, reported
        self.present = self.waits = self.is_settled = False
        """Present; present and not engaged; engaged or absent."""
        self.fit = AttachmentState(min(int(cell.item()), AttachmentState.ENGAGED))
        self.has_switch, self._always = has_switch, always
        self._settled_ns = 0
        if always and self.fit is AttachmentState.UNKNOWN:
            self.fit = AttachmentState.ENGAGED

    @property
    def fit(self) -> AttachmentState:
        """State of the attachment."""
        return self._fit

    @fit.setter
    def fit(self, fit: AttachmentState) -> None:
        self._fit = fit
        self._cell[...] = fit
        self.present = fit >= AttachmentState.FOUND
        self.waits = fit in (AttachmentState.FOUND, AttachmentState.NEW)
        self.is_settled = fit in (AttachmentState.ENGAGED, AttachmentState.ABSENT)

    def say(self, on: bool) -> None:
        """True: present whatever its switch shows; False: the switch counts again."""
        self._reported[...] = on

    def look(self, pressed: bool, now_ns: int) -> bool:
        """Take the state of its switch; True when it was attached, found or removed."""
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
