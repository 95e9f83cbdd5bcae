"""Real-time rights: which processes did not get what they asked the kernel for, and what grants it, in words."""

from __future__ import annotations

import os
import pwd
from collections.abc import Mapping
from typing import Final

NO_FIFO, NOT_LOCKED = "no FIFO", "not locked"
"""As `realtime` says it."""
HIGHEST: Final = 98  # the highest priority that a system file may ask for
LIMITS_FILE: Final = "/etc/security/limits.d/trocar.conf"
SYSTEMD: Final = f"LimitRTPRIO={HIGHEST} and LimitMEMLOCK=infinity"


def user() -> str:
    """Who we are, as limits.d knows people."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return str(os.getuid())


def limits_lines(name: str) -> tuple[str, str]:
    """The two lines of LIMITS_FILE that grant both rights to a user from the next login on."""
    return f"{name} - rtprio {HIGHEST}", f"{name} - memlock unlimited"


def lacking(policies: Mapping[str, str]) -> str:
    """Several lines for a person; empty where every process got what it asked for. `policies` as `realtime` says them.

    What grants the rights is said for the user we are: whoever looks at a system of somebody else sees the idea.
    """
    slow = [name for name, words in policies.items() if NO_FIFO in words]
    loose = [name for name, words in policies.items() if NOT_LOCKED in words]
    if not slow and not loose:
        return ""
    said = [f"no real-time priority (FIFO refused): {', '.join(slow)}"] if slow else []
    said += [f"memory not locked (mlockall refused): {', '.join(loose)}"] if loose else []
    lines = limits_lines(user())
    return "\n".join((
        *said,
        f"they are late whenever this machine is busy; two lines in {LIMITS_FILE} and a new login grant both:",
        *(f"    {line}" for line in lines),
        f"or, where systemd starts the system, {SYSTEMD} in its unit; trocar doctor looks at the rest of the machine",
    ))
