"""The lifecycle of an instance as a table: (state, event) to state. The supervisor walks it, a test walks every pair.

STOPPED –start→ RUNNING; RUNNING –stop→ STOPPING; STOPPING –quit→ STOPPED, –start→ RESTARTING; RESTARTING –quit→ RUNNING
(a new process), –stop→ STOPPING. At most one process of an instance ever runs. A RUNNING process that ends by itself
(`quit`) is restarted by the supervisor's policy, so the table sends it to STOPPED and the policy decides.
"""

from __future__ import annotations

STOPPED, RUNNING, STOPPING, RESTARTING = "STOPPED", "RUNNING", "STOPPING", "RESTARTING"
STATES = (STOPPED, RUNNING, STOPPING, RESTARTING)
START, STOP, QUIT = "start", "stop", "quit"
EVENTS = (START, STOP, QUIT)

TABLE: dict[tuple[str, str], str] = {
    (STOPPED, START): RUNNING,
    (RUNNING, STOP): STOPPING,
    (RUNNING, QUIT): STOPPED,
    (STOPPING, QUIT): STOPPED,
    (STOPPING, START): RESTARTING,
    (RESTARTING, QUIT): RUNNING,
    (RESTARTING, STOP): STOPPING,
}


def after(state: str, event: str) -> str:
    """The state after an event; events a state does not know leave it as it is."""
    return TABLE.get((state, event), state)


def starts_process(state: str, event: str) -> bool:
    """Whether this step begins a new process."""
    return (state, event) in {(STOPPED, START), (RESTARTING, QUIT)}
