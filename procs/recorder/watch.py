"""Detects faults in the events of all processes, with their causes, and whether the system was well before."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from trocar.procs.crtk.plain import plain
from trocar.procs.recorder.sources import RecordedRing, SystemSources
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import POWER_OFF
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import ERROR

IN_FAULT: Final = b"FAULT"
OFF: Final = b"DISABLED"
FAULTED: Final = -1
NOT_YET: Final = 0
WELL_NS: Final = 2_000_000_000
"""An arm that rests DISABLED for this long is well; on the way from FAULT to power it is so only for a moment."""
NEAR_NS: Final = 1_000_000_000
"""Largest time between an error and the FAULT that it caused."""
ERRORS: Final = 200
POWERING_OFF: Final = frozenset(row.code.encode() for row in codes.FAULTS if row.action >= POWER_OFF)


@dataclass(frozen=True, slots=True)
class SeenFault:
    """A fault: instance, time (monotonic; 0: a person's request), reason in words, and code of the error behind it.

    `is_first`: the system was well before.
    """

    instance: str
    reason: str
    at_ns: int = 0
    code: str = ""
    is_first: bool = False


@dataclass(frozen=True, slots=True)
class _SeenError:
    whose: tuple[str, str]
    at_ns: int
    code: str
    text: str


class FaultWatch:
    """Detects the faults of a system: arms that go to FAULT, and errors for which an io powers off."""

    def __init__(self, sources: SystemSources) -> None:
        """Watch from now on; earlier events give the present states. `system` is left out, as it repeats others."""
        self._rings: list[tuple[RecordedRing, RingReader]] = [
            (ring, ring.reader()) for ring in sources.rings.values() if ring.ring == "events" and ring.kind != "system"]
        self._states = {ring.instance: ring for ring in sources.rings.values() if ring.ring == "state"}
        self._errors: deque[_SeenError] = deque(maxlen=ERRORS)
        self._unwell: dict[str, int] = {}
        """Instances not yet well after a FAULT: FAULTED, NOT_YET, or the time since which it is DISABLED."""
        for ring, reader in self._rings:
            now = reader.head
            reader.rewind()
            while reader.sequence < now and reader.next():
                self._seen(ring.instance, reader)

    def look(self) -> list[SeenFault]:
        """Faults since the last look; for those in state FAULT, `explained` adds the reason."""
        return [fault for ring, reader in self._rings for fault in self._of(ring, reader)]

    def _of(self, ring: RecordedRing, reader: RingReader) -> Iterator[SeenFault]:
        while reader.next():
            fault = self._seen(ring.instance, reader)
            if fault is not None:
                yield fault

    def _seen(self, instance: str, event: RingReader) -> SeenFault | None:
        """The fault if the event read last is one."""
        at_ns = int(event.field("monotonic_ns")[()])
        if event.field("event").item() == b"operating_state":
            is_homed, is_busy = (bool(event.field(name)[()]) for name in ("is_homed", "is_busy"))
            return self._state(instance, event.field("state").item(), is_homed, is_busy, at_ns)
        if int(event.field("severity")[()]) != ERROR:
            return None
        code, text, component = (str(plain(event.field(name).item())) for name in ("code", "text", "component"))
        self._errors.append(_SeenError((instance, component), at_ns, code, text))
        is_fault = event.field("code").item() in POWERING_OFF
        return SeenFault(instance, text, at_ns, code, self._is_well(at_ns)) if is_fault else None

    def _state(self, instance: str, state: bytes, is_homed: bool, is_busy: bool, at_ns: int) -> SeenFault | None:
        """A fault at a transition to FAULT; in FAULT an arm repeats its state at each command."""
        if state == IN_FAULT:
            if self._unwell.get(instance) == FAULTED:
                return None
            is_first = self._is_well(at_ns)
            self._unwell[instance] = FAULTED
            return SeenFault(instance, "", at_ns, "", is_first)
        if is_homed:
            self._unwell.pop(instance, None)
        elif instance in self._unwell:
            self._unwell[instance] = at_ns if state == OFF and not is_busy else NOT_YET  # busy: it gets power
        return None

    def _is_well(self, at_ns: int) -> bool:
        """Whether each instance that went to FAULT is homed again, or without power for WELL_NS."""
        self._unwell = {name: since for name, since in self._unwell.items() if not 0 < since <= at_ns - WELL_NS}
        return not self._unwell

    def explained(self, fault: SeenFault) -> SeenFault:
        """The fault with the error that caused it, of the arm or its io; else with the reason in the arm's record."""
        if fault.reason:
            return fault
        near = sorted((error for error in self._errors if fault.instance in error.whose
                       and abs(error.at_ns - fault.at_ns) <= NEAR_NS), key=lambda error: error.at_ns)
        before = [error for error in near if error.at_ns <= fault.at_ns]
        for error in (before[-1:] or near[:1]):
            return replace(fault, reason=error.text, code=error.code)
        said = self._reason(fault.instance)
        return replace(fault, reason=f"{fault.instance}: {said}" if said else f"{fault.instance} is in FAULT")

    def _reason(self, instance: str) -> str:
        ring = self._states.get(instance)
        if ring is None or "reason" not in (ring.sampler.dtype.names or ()) or not ring.sampler.newest():
            return ""
        return str(plain(ring.sampler.field("reason").item()))

    def close(self) -> None:
        """Close all readers."""
        for _, reader in self._rings:
            reader.close()
