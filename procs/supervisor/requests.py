"""Commands about single processes: start, stop, restart. Whoever asks is answered when it has come true, or cannot.

The starter waits at the barrier of setup, and hears the failure's own text. Pure: looks at what it is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.procs.node.requests import Request
from trocar.procs.supervisor.children import Child, missing
from trocar.procs.tables import lifecycle


@dataclass(frozen=True, slots=True)
class _Pending:
    """Somebody waits for the process of this number: until it runs, or until it has ended."""

    request: Request
    child: Child
    number: int
    until: str


class Requests:
    """What was asked about the processes of a system."""

    def __init__(self, children: Sequence[Child]) -> None:
        """All that there are."""
        self._children = {child.row.name: child for child in children}
        self._pending: list[_Pending] = []
        self._handlers = {"start": self._start, "stop": self._stop, "restart": self._restart}

    def take(self, request: Request) -> None:
        """Begin what is asked; answered at once when there is nothing to do, or it cannot be."""
        child = self._children.get(request.text)
        if child is None:
            there_are = ", ".join(self._children)
            request.refuse(f"no instance {request.text}; there are {there_are}")
        else:
            self._handlers[request.name](request, child)

    def answer(self) -> None:
        """Tell those for whom it has been decided."""
        waiting = []
        for each in self._pending:
            outcome = _outcome(each)
            if outcome is None:
                waiting.append(each)
            elif outcome[0]:
                each.request.done(outcome[1])
            else:
                each.request.fail(outcome[1])
        self._pending = waiting

    def end(self, reason: str) -> None:
        """Nobody is going to be served any more."""
        for each in self._pending:
            each.request.fail(reason)
        self._pending = []

    def _stop(self, request: Request, child: Child) -> None:
        if child.state == lifecycle.STOPPED:
            planned = child.restart_at_ns
            child.stop_what_ended()
            request.done(f"{child.row.name} is not started again" if planned else f"{child.row.name} does not run")
            return
        child.stop()
        request.accept()
        self._pending.append(_Pending(request, child, child.starts, lifecycle.STOPPED))

    def _start(self, request: Request, child: Child) -> None:
        if child.is_up:
            request.done(f"{child.row.name} runs already (pid {child.process.pid})")
        elif lacks := missing(child, self._children):
            request.refuse(f"{child.row.name} needs {' and '.join(lacks)}, which {_runs(lacks)} not run: "
                           f"trocar start {lacks[0]}")
        else:
            child.start()
            request.accept()
            number = child.starts + (child.state == lifecycle.RESTARTING)
            self._pending.append(_Pending(request, child, number, lifecycle.RUNNING))

    def _restart(self, request: Request, child: Child) -> None:
        if not missing(child, self._children):
            child.stop()
        self._start(request, child)


def _runs(names: Sequence[str]) -> str:
    return "does" if len(names) == 1 else "do"


def _outcome(waits: _Pending) -> tuple[bool, str] | None:
    """Whether it came true, and what to say of it; None: not known yet."""
    child, name = waits.child, waits.child.row.name
    is_this = child.starts == waits.number and child.state != lifecycle.STOPPED
    if waits.until == lifecycle.STOPPED:
        return None if is_this else (True, f"{name}: {child.reason}")
    if is_this and child.state == lifecycle.RUNNING:
        return (True, f"{name} runs (pid {child.process.pid})") if child.has_begun else None
    if child.starts < waits.number and child.state == lifecycle.RESTARTING:
        return None
    if child.starts == waits.number and child.state == lifecycle.STOPPED:
        again = "; it is tried again" if child.restart_at_ns else ""
        return False, f"{name}: {child.reason}{again}"
    return False, f"{name} was stopped before it was up" if child.starts <= waits.number else f"{name}: {child.reason}"
