"""The rings of setpoints, which the native library reads directly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.io.record import Field
from trocar.procs.node.ring_arrays import RingArrays
from trocar.procs.tables.desired_state import DESIRED_STATES
from trocar.shm.mailbox.origins import Origin
from trocar.shm.ring.ring import RingReader

FIELDS: Final = ("stamp_ns", "mode", "has_velocity", "count", "in_effort", "bias_generation", "pid_generation",
                 "position", "velocity", "feed_forward", "desired_generation")
"""The fields the native library reads, in the order of `RingArrays.offsets`."""


class DesiredFields:
    """Desired states in an arm's setpoint record; see procs/tables/desired_state.py."""

    def __init__(self, field: Field) -> None:
        """`field` gives the arrays of the record."""
        self.generation = field("desired_generation")
        self.wanted = [field(desired.field) for desired in DESIRED_STATES]
        self._origin = [field(name) for name in ("desired_origin", "desired_since", "desired_program")]

    @property
    def origin(self) -> Origin:
        """The operator's command that caused them."""
        number, since, program = (cell.item() for cell in self._origin)
        return Origin(number, since, program.decode(errors="replace"))


class RingSource:
    """The newest setpoint record of an arm, in its ring; scalars are arrays of shape (), the others (8,)."""

    def __init__(self, ring: RingReader) -> None:
        self.ring, self.newest = ring, ring.newest
        self.mode, self.has_velocity, self.count = (ring.field(n) for n in ("mode", "has_velocity", "count"))
        self.in_effort = ring.field("in_effort")
        self.bias_generation, self.pid_generation = ring.field("bias_generation"), ring.field("pid_generation")
        self.position, self.velocity = ring.field("position"), ring.field("velocity")
        self.effort, self.feed_forward = ring.field("effort"), ring.field("feed_forward")
        self.desired = DesiredFields(ring.field)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest record, 0: none yet."""
        return self.ring.stamp_ns


def rings_of(sources: Sequence[object]) -> RingArrays | None:
    """The rings of sources that have one each; None: some have none."""
    rings = [getattr(source, "ring", None) for source in sources]
    found = [ring for ring in rings if isinstance(ring, RingReader)]
    return RingArrays(found, FIELDS) if len(found) == len(rings) else None
