"""Functions of a script that are called when something has happened."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from trocar.procs.crtk.names import none_such
from trocar.shm.memory.closable import Closable
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.deadline import seconds
from trocar.tools.client.ways import EventWay
from trocar.tools.output.errors import Problem

POLL_S: Final = 0.002

Event = Mapping[str, Any]
Callback = Callable[[Event], object]


class Callbacks:
    """Those of one object. They run in calls of its thread: `run`, and the object's waits."""

    def __init__(self, events: EventWay, row: Callable[[], Event] | None = None) -> None:
        """`row`: a state record whose fields are reported, too, when they have changed."""
        self._events, self._row = events, row
        self._functions: dict[str, Callback] = {}
        self._fields: dict[str, Any] = {}
        self._came: deque[tuple[str, Event]] = deque()

    def set(self, event: str, function: Callback | None) -> None:
        """Call this with each event of this name from now on, None: end that; Problem names the existing events."""
        if function is None:
            self._functions.pop(event, None)
            self._fields.pop(event, None)
            self._events.leave(event)
            return
        names = self._events.names()
        row = self._row() if self._row is not None else {}
        if event in names:
            self._events.follow(event)
        elif event in row:
            self._fields[event] = row[event]
        else:
            raise Problem(none_such("event", event, [*names, *row]))
        self._functions[event] = function

    def run(self, timeout: float = 0.0) -> int:
        """Call the functions for new events; returns the number of calls. Waits up to `timeout` s for a first one."""
        limit_s = seconds(timeout)
        count, end = self._run(), monotonic_ns() + round(limit_s * 1e9)
        while not count and monotonic_ns() < end:
            pause(POLL_S)
            count = self._run()
        return count

    def _run(self) -> int:
        if not self._functions:
            return 0
        self._came += self._events.taken()
        if self._fields:
            self._look()
        count = 0
        while self._came:  # a function may wait, during which others run
            event, what = self._came.popleft()
            function = self._functions.get(event)
            if function is not None:
                function(what)
                count += 1
        return count

    def _look(self) -> None:
        """Fields that have changed."""
        try:
            row = self._row() if self._row is not None else {}
        except TimeoutError:  # it does not show itself now
            return
        for name, before in self._fields.items():
            if row[name] != before:
                self._fields[name] = row[name]
                self._came.append((name, {"stamp_ns": row["stamp_ns"], name: row[name]}))

    def close(self) -> None:
        """End all callbacks."""
        self._functions.clear()
        self._events.close()


class Reporting(Closable):
    """Instances with events: arms, setup joints, consoles, teleoperations, systems; a context manager."""

    _callbacks: Callbacks

    def on_event(self, event: str, callback: Callback | None) -> None:
        """Call `callback` with each event of this name from now on, a mapping as shown by `trocar echo --json`.

        None: stop. It runs inside `process_events` and waits of this object. Problem lists the existing events.
        """
        self._callbacks.set(event, callback)

    def process_events(self, timeout: float = 0.0) -> int:
        """Run the callbacks for new events; returns the number of calls. Waits up to `timeout` s for a first one."""
        return self._callbacks.run(timeout)
