"""Access to an instance, on any machine: its records, commands to it, and its events.

Each has one class for this machine (shared.py) and one with the same methods for another machine (distant.py).

This module, and all modules that `import trocar` needs on other machines, do not import shared memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from trocar.tools.client.distant import DistantEvents, DistantRecord, DistantRemote, DistantWays
    from trocar.tools.client.remote import Remote
    from trocar.tools.client.shared import InstanceRecord, SharedEvents, SharedRows, SharedWays

RecordWay: TypeAlias = "InstanceRecord | DistantRecord"
RowWay: TypeAlias = "SharedRows | DistantRecord"
CommandWay: TypeAlias = "Remote | DistantRemote"
EventWay: TypeAlias = "SharedEvents | DistantEvents"
Ways: TypeAlias = "SharedWays | DistantWays"


def ways_of(system: str | Ways) -> Ways:
    """Access on this machine by a system's name: imported on use, as other machines lack shared memory."""
    if not isinstance(system, str):
        return system
    from trocar.tools.client.shared import SharedWays

    return SharedWays(system)
