"""Events of an instance: a ring with history, so that late comers see the last ones too."""

from __future__ import annotations

import math
from collections.abc import Callable

from shm.layout import cut_text
from shm.ring import RingWriter

STATUS, WARNING, ERROR = 1, 2, 3
SEVERITIES = ("", "status", "warning", "error")


class Events:
    """The writing end. Stamps increase strictly: clients compare them."""

    def __init__(self, ring: RingWriter, now_ns: Callable[[], int]) -> None:
        """`now_ns` is the process's clock."""
        self._ring, self._now_ns = ring, now_ns
        names = ("event", "severity", "code", "component", "axis", "value", "limit", "text", "state", "sub_state",
                 "is_homed", "is_busy")
        self._fields = {name: ring.field(name) for name in names}

    def emit(
        self, event: str, text: str = "", *, severity: int = 0, code: str = "", component: str = "", axis: int = -1,
        value: float = math.nan, limit: float = math.nan, state: str = "", sub_state: str = "", is_homed: bool = False,
        is_busy: bool = False,
    ) -> None:
        """Write one event; texts longer than their field are cut between characters."""
        for name, content in (("event", event), ("code", code), ("component", component), ("text", text),
                              ("state", state), ("sub_state", sub_state)):
            self._fields[name][...] = cut_text(content, self._fields[name].dtype.itemsize)
        for name, number in (("severity", severity), ("axis", axis), ("value", value), ("limit", limit),
                             ("is_homed", is_homed), ("is_busy", is_busy)):
            self._fields[name][...] = number
        self._ring.publish(max(self._now_ns(), self._ring.stamp_ns + 1))

    def status(self, text: str, component: str = "") -> None:
        """Something a person may like to know."""
        self.emit("status", text, severity=STATUS, component=component)

    def warning(self, code: str, text: str, component: str = "", axis: int = -1, value: float = math.nan,
                limit: float = math.nan) -> None:
        """Something a person should know; the robot goes on."""
        self.emit("warning", text, severity=WARNING, code=code, component=component, axis=axis, value=value,
                  limit=limit)

    def error(self, code: str, text: str, component: str = "", axis: int = -1, value: float = math.nan,
              limit: float = math.nan) -> None:
        """Something failed; the robot has reacted."""
        self.emit("error", text, severity=ERROR, code=code, component=component, axis=axis, value=value, limit=limit)

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        """The operating state, on every change and as the answer to every state command."""
        self.emit("operating_state", state=state, sub_state=sub_state, is_homed=is_homed, is_busy=is_busy)

    def goal_reached(self, reached: bool) -> None:
        """A move has ended, at its goal or before."""
        self.emit("goal_reached", value=float(reached))
