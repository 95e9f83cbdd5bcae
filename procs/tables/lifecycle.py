"""The lifecycle of an instance: its states, and the reasons of ends that are no problem.

The state follows from the process that runs and the one that should (procs/supervisor/children.py): STOPPED, none runs;
RUNNING, the one that should; STOPPING, it was asked to end; RESTARTING, it was asked to end, and another one follows.
An instance has at most one process, and it has one in every state except STOPPED. After a RUNNING process has ended by
itself the state is STOPPED, and the supervisor's restart policy decides.
"""

from __future__ import annotations

STOPPED, RUNNING, STOPPING, RESTARTING = "STOPPED", "RUNNING", "STOPPING", "RESTARTING"

ASKED, DONE = "stopped", "done"
"""Reasons of ends that are no problem: stopped by an operator (perhaps with ": " and how it ended), or not needed."""


def is_meant(reason: str) -> bool:
    """Whether an end for this reason was intended."""
    return reason.partition(":")[0] in (ASKED, DONE)


def may_have_written(reason: str) -> bool:
    """Whether a process that ended for this reason may have written the cause to its log; SIGKILL gives it no time."""
    return not any(word in reason for word in ("SIGKILL", "SIGSTOP"))
