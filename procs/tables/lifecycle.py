"""The lifecycle of an instance as a table: (state, event) to state, and what the supervisor does on the way.

STOPPED –start→ RUNNING; RUNNING –stop→ STOPPING; STOPPING –quit→ STOPPED, –start→ RESTARTING; RESTARTING –quit→ RUNNING
(a new process), –stop→ STOPPING. At most one process of an instance ever runs: there is one in every state but STOPPED.
A RUNNING process that ends by itself (`quit`) is started again by the supervisor's policy, so the table sends it to
STOPPED and the policy decides.
"""

from __future__ import annotations

STOPPED, RUNNING, STOPPING, RESTARTING = "STOPPED", "RUNNING", "STOPPING", "RESTARTING"
STATES = (STOPPED, RUNNING, STOPPING, RESTARTING)
START, STOP, QUIT = "start", "stop", "quit"
EVENTS = (START, STOP, QUIT)
NOTHING, BEGIN, ASK = "", "begin", "ask"
"""What is done: nothing, begin a new process, ask the one that runs to end."""

ASKED, DONE = "stopped", "done"
"""Ends that are no problem: an operator stopped it (maybe with ": " and how it ended), or it was not needed."""

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
    """Whether a process that ended for this reason is to be down."""
    return reason.partition(":")[0] in (ASKED, DONE)


def step(state: str, event: str) -> tuple[str, str]:
    """The state after an event, and what is done; events that a state does not know change nothing."""
    return TABLE.get((state, event), (state, NOTHING))
