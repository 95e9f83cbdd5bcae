"""The lifecycle of an instance as a table: (state, event) to the next state and the supervisor's action.

STOPPED –start→ RUNNING; RUNNING –stop→ STOPPING; STOPPING –quit→ STOPPED, –start→ RESTARTING; RESTARTING –quit→ RUNNING
(a new process), –stop→ STOPPING. An instance has at most one process, and it has one in every state except STOPPED.
After a RUNNING process has ended by itself (`quit`) the state is STOPPED, and the supervisor's restart policy decides.
"""

from __future__ import annotations

STOPPED, RUNNING, STOPPING, RESTARTING = "STOPPED", "RUNNING", "STOPPING", "RESTARTING"
STATES = (STOPPED, RUNNING, STOPPING, RESTARTING)
START, STOP, QUIT = "start", "stop", "quit"
EVENTS = (START, STOP, QUIT)
NOTHING, BEGIN, ASK = "", "begin", "ask"
"""Actions: nothing, begin a new process, ask the running process to end."""

ASKED, DONE = "stopped", "done"
"""Reasons of ends that are no problem: stopped by an operator (perhaps with ": " and how it ended), or not needed."""

TABLE: dict[tuple[str, str], tuple[str, str]] = {
    (STOPPED, START): (RUNNING, BEGIN),
    (RUNNING, STOP): (STOPPING, ASK),
    (RUNNING, QUIT): (STOPPED, NOTHING),
    (STOPPING, QUIT): (STOPPED, NOTHING),
    (STOPPING, START): (RESTARTING, NOTHING),
    (RESTARTING, QUIT): (RUNNING, BEGIN),
    (RESTARTING, STOP): (STOPPING, NOTHING),
}


def is_meant(reason: str) -> bool:
    """Whether an end for this reason was intended."""
    return reason.partition(":")[0] in (ASKED, DONE)


def may_have_written(reason: str) -> bool:
    """Whether a process that ended for this reason may have written the cause to its log; SIGKILL gives it no time."""
    return not any(word in reason for word in ("SIGKILL", "SIGSTOP"))


def step(state: str, event: str) -> tuple[str, str]:
    """The state after an event, and the action; events without a row change nothing."""
    return TABLE.get((state, event), (state, NOTHING))
