"""The rings of setpoints, and their memory layout for the native library, which reads them directly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.io.record import Field
from trocar.procs.tables.desired_state import DESIRED_STATES
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.segment import HEAD_AT
from trocar.shm.ring.ring import RingReader

Addresses = NDArray[np.int64]

FIELDS: Final = ("stamp_ns", "mode", "has_velocity", "count", "in_effort", "bias_generation", "pid_generation",
                 "position", "velocity", "feed_forward", "desired_generation")
"""The fields the native library reads, in the order of `SetpointRings.offsets`."""


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


class SetpointRings:
    """One array per field, one element per arm; addresses are valid until the rings are closed."""

    def __init__(self, rings: Sequence[RingReader]) -> None:
        self._rings, found = rings, [ring.addresses for ring in rings]
        self.head: Addresses = np.array([begin + HEAD_AT for begin, _, _ in found], dtype=np.int64)
        self.copy: Addresses = np.array([copy for _, copy, _ in found], dtype=np.int64)
        self.slots: Addresses = np.array([slots for _, _, slots in found], dtype=np.int64)
        self.depth: Addresses = np.array([ring.depth for ring in rings], dtype=np.int64)
        self.stride: Addresses = np.array([ring.stride for ring in rings], dtype=np.int64)
        self.seen: Addresses = np.zeros(len(rings), dtype=np.int64)
        """Sequence number of the newest record that the native library has read."""
        self.size = rings[0].dtype.itemsize if rings else 0
        places = rings[0].dtype.fields if rings else None
        self.offsets: Addresses = np.array([places[name][1] if places else 0 for name in FIELDS], dtype=np.int64)

    def newest(self, place: int) -> bool:
        """Take the newest record of an arm, if newer than the one the native library has read."""
        ring = self._rings[place]
        ring.sequence = max(ring.sequence, int(self.seen[place]))
        found = ring.newest()
        self.seen[place] = ring.sequence
        return found


def rings_of(sources: Sequence[object]) -> SetpointRings | None:
    """The rings of sources that have one each; None: some have none."""
    rings = [getattr(source, "ring", None) for source in sources]
    found = [ring for ring in rings if isinstance(ring, RingReader)]
    return SetpointRings(found) if len(found) == len(rings) else None
