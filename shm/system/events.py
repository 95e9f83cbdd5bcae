"""Events of an instance: a ring with history, so that late readers see the last ones too.

An error is data: severity, code, component, axis, board, value, limit, text, hint. Code, severity and hint come from a
row of a table of codes. `text` is one sentence that names its subject, so that all tools show the same text; the log
has the text with its hint, uncut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from trocar.shm.memory.layout import cut_text, shorten
from trocar.shm.ring.ring import RingWriter
from trocar.shm.time.clock import local_ns, monotonic_ns

STATUS, WARNING, ERROR = 1, 2, 3
SEVERITIES = ("", "status", "warning", "error")
NAMES = ("event", "severity", "code", "component", "axis", "board", "value", "limit", "text", "hint", "state",
         "sub_state", "is_homed", "is_busy", "monotonic_ns", "local_ns")

Log = Callable[[int, str], None]


class EventCode(Protocol):
    """A row of the table of codes; see procs/tables/codes.py."""

    @property
    def code(self) -> str:
        """Lower case with hyphens."""

    @property
    def severity(self) -> int:
        """WARNING or ERROR."""

    def remedy_for(self, component: str) -> str:
        """The remedy for an operator; `component`: the message's subject."""


def sentence(text: str, component: str) -> str:
    """`text`, preceded by the name of its subject unless the text names it."""
    return f"{component}: {text}" if component and component not in text else text


class Events:
    """The writing end. Stamps increase strictly: clients compare them."""

    def __init__(self, ring: RingWriter, now_ns: Callable[[], int], log: Log | None = None, name: str = "",
                 typed: str = "") -> None:
        """Of the instance `name` with the clock `now_ns`; `log` receives severity and full text of every message.

        `typed`: the name that a person types for it, if different.
        """
        self._ring, self._now_ns, self._log, self._name, self._typed = ring, now_ns, log, name, typed or name
        self._fields = {name: ring.field(name) for name in NAMES}
        self._room = {name: field.dtype.itemsize for name, field in self._fields.items()}

    def emit(
        self, event: str, text: str = "", *, severity: int = 0, code: str = "", component: str = "", axis: int = -1,
        value: float = math.nan, limit: float = math.nan, state: str = "", sub_state: str = "", is_homed: bool = False,
        is_busy: bool = False, board: int = -1, hint: str = "", repeated: bool = False,
    ) -> None:
        """Write one event; sentences longer than their field end with "…", names are cut.

        `repeated`: another process has already reported and logged it.
        """
        fields, room = self._fields, self._room
        if severity:
            text = sentence(text, component)
        for name, content in (("event", event), ("code", code), ("component", component), ("state", state),
                              ("sub_state", sub_state)):
            fields[name][...] = cut_text(content, room[name])
        fields["text"][...], fields["hint"][...] = shorten(text, room["text"]), shorten(hint, room["hint"])
        for name, number in (("severity", severity), ("axis", axis), ("board", board), ("value", value),
                             ("limit", limit), ("is_homed", is_homed), ("is_busy", is_busy),
                             ("monotonic_ns", monotonic_ns()), ("local_ns", local_ns())):
            fields[name][...] = number
        self._ring.publish(max(self._now_ns(), self._ring.stamp_ns + 1))
        if severity >= STATUS and self._log is not None and not repeated:
            self._log(severity, f"{text}; {hint}" if hint else text)

    def status(self, text: str, component: str = "") -> None:
        """Information for people."""
        self.emit("status", text, severity=STATUS, component=component)

    def report(self, code: EventCode, text: str, component: str = "", axis: int = -1, value: float = math.nan,
               limit: float = math.nan, board: int = -1, has_remedy: bool = False) -> None:
        """A warning: important for a person; or an error: a failure to which the robot has reacted.

        `has_remedy`: the text contains the remedy, so that the table's is omitted.
        """
        about = self._typed if component in ("", self._name) else component
        self.emit(SEVERITIES[code.severity], text, severity=code.severity, code=code.code, component=component,
                  axis=axis, value=value, limit=limit, board=board, hint="" if has_remedy else code.remedy_for(about))

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        """The operating state, on every change and as the answer to every state command."""
        self.emit("operating_state", state=state, sub_state=sub_state, is_homed=is_homed, is_busy=is_busy)

    def goal_reached(self, reached: bool) -> None:
        """A move has ended, at its goal or before."""
        self.emit("goal_reached", value=float(reached))
