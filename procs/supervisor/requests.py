"""Commands for single processes: start, stop, restart. They are answered when the result is known.

A start is answered after setup; on failure with the text of the failure. Without side effects of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.procs.supervisor.children import Child, missing
from trocar.procs.tables import lifecycle
from trocar.shm.mailbox.received import Request


@dataclass(frozen=True, slots=True)
class _Pending:
    """A request that waits until the process of this number runs, or has ended."""

    request: Request
    child: Child
    number: int
    until: str


class Requests:
    """The pending requests for processes of a system."""

    def __init__(self, children: Sequence[Child]) -> None:
        """`children`: all instances of the system."""
        self._children = {child.row.name: child for child in children}
        self._pending: list[_Pending] = []
        self._handlers = {"start": self._start, "stop": self._stop, "restart": self._restart}

    def take(self, request: Request) -> None:
        """Begin a request; it is answered at once if there is nothing to do, or it is impossible."""
        child = self._children.get(request.text)
        if child is None:
            there_are = ", ".join(self._children)
            request.refuse(f"no instance {request.text}; there are {there_are}")
        else:
            self._handlers[request.name](request, child)

    def answer(self) -> None:
        """Answer the requests whose outcome is known."""
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
        """Fail all pending requests."""
        for each in self._pending:
            each.request.fail(reason)
        self._pending = []

    def _stop(self, request: Request, child: Child) -> None:
        if not child.runs:
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
            self._pending.append(_Pending(request, child, child.target, lifecycle.RUNNING))

    def _restart(self, request: Request, child: Child) -> None:
        if not missing(child, self._children):
            child.stop()
        self._start(request, child)


def _runs(names: Sequence[str]) -> str:
    return "does" if len(names) == 1 else "do"


def _outcome(waits: _Pending) -> tuple[bool, str] | None:
    """Success or failure, and the text of the answer; None: not known yet."""
    child, name, number = waits.child, waits.child.row.name, waits.number
    if waits.until == lifecycle.STOPPED:
        return None if child.runs and child.starts == number else (True, f"{name}: {child.reason}")
    if child.target == number:
        return (True, f"{name} runs (pid {child.process.pid})") if child.starts == number and child.has_begun else None
    if child.starts > number or (child.starts == number and not child.runs):
        again = "; it is tried again" if child.restart_at_ns and child.starts == number else ""
        return False, f"{name}: {child.reason}{again}"
    return False, f"{name} was stopped before it was up"
