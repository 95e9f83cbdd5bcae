"""Whether the shared memory of a process is all there: its control page names what it has."""

from __future__ import annotations

from collections.abc import Collection

from trocar.shm.time.control_page import ControlPage
from trocar.tools.inspect.replayed import is_replay
from trocar.tools.systems.processes import SUPERVISOR

OF_THE_SYSTEM = ("document", "faults")
GONE = "gone from shared memory"
PAGE_GONE = f"its control page is {GONE}"


def lost_of(page: ControlPage, there: Collection[str]) -> str:
    """What of its segments is not `there` any more, in words; empty: nothing."""
    if is_replay(page.segment.header.info):
        return ""
    wanted = page.segment.header.info.get("wanted")
    topics = {str(name).partition("/")[0] for name in wanted} if isinstance(wanted, list) else set()
    topics |= {"mailbox"} if "audit" in topics else set()
    topics |= set(OF_THE_SYSTEM) if page.instance == SUPERVISOR else set()
    lost = sorted(topics - set(there))
    return f"its {', '.join(lost)} {'is' if len(lost) == 1 else 'are'} {GONE}" if lost else ""
