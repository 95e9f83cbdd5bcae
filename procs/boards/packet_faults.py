"""Faults of single datagrams in transit: lost requests, and lost, late, doubled or wrong replies.

They act between the boards, which have answered, and the sockets. Randomness comes from a seed and one generator per
bus, so that the faults of a bus do not depend on the others; the caller supplies the time.
"""

from __future__ import annotations

import heapq
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass

from trocar.procs.boards.controllers.lines import NEVER
from trocar.procs.fpga.wire import DROPPED, TRAILER_BYTES, Buffer

LOST, LATE, DUPLICATED, DROPPED_REPLY, MISLABELLED = KINDS = ("lost", "late", "duplicated", "dropped", "mislabelled")
_LABEL_SHIFT, _LABEL_MASK = 10, 0x3F  # transaction label in the first quadlet
_QUAD = struct.Struct(">I")

Leaving = list[tuple[Buffer, object]]


@dataclass(slots=True)
class PacketFault:
    """One kind on one bus: the next `count` replies, and from then on each with probability `rate`."""

    count: int = 0
    rate: float = 0.0
    delay_ns: int = 0  # of late ones

    def strikes(self, chance: Callable[[], float]) -> bool:
        """Whether this reply is hit."""
        if self.count > 0:
            self.count -= 1
            return True
        return self.rate > 0.0 and chance() < self.rate


class PacketFaults:
    """For all buses. While `active` is False no calls are needed."""

    def __init__(self, buses: int, seed: int = 1) -> None:
        """No faults."""
        self.active = False
        self.next_ns = NEVER  # when a late reply is due
        self._kinds = [{kind: PacketFault() for kind in KINDS} for _ in range(buses)]
        self._loss = [0.0] * buses  # of datagrams, either way
        self._chance: list[Callable[[], float]] = []
        self.seed(seed, buses)
        self._kept: list[tuple[int, int, int, bytes, object]] = []  # due, order, bus, reply, sender
        self._order = 0

    def seed(self, seed: int, buses: int) -> None:
        """Restart the random sequence."""
        self._chance[:] = [random.Random(f"{seed}/{bus}").random for bus in range(buses)]

    # -- datagrams -----------------------------------------------------------------------------------------------------

    def arrives(self, bus: int) -> bool:
        """Whether a request reaches the boards."""
        loss = self._loss[bus]
        return not (loss > 0.0 and self._chance[bus]() < loss)

    def leave(self, bus: int, reply: Buffer, sender: object, now_ns: int) -> Leaving:
        """The datagrams sent now for a reply; `due` returns late ones, as a copy."""
        chance, kinds = self._chance[bus], self._kinds[bus]
        hit = kinds[LOST].strikes(chance) or (self._loss[bus] > 0.0 and chance() < self._loss[bus])
        if not hit:
            if kinds[DROPPED_REPLY].strikes(chance):
                reply = _dropped(reply)
            elif kinds[MISLABELLED].strikes(chance):
                reply = _relabelled(reply)
        copies = 0 if hit else 2 if kinds[DUPLICATED].strikes(chance) else 1
        late = kinds[LATE]
        if copies and late.strikes(chance):
            for _ in range(copies):
                heapq.heappush(self._kept, (now_ns + late.delay_ns, self._order, bus, bytes(reply), sender))
                self._order += 1
            copies = 0
        self._look()
        return [(reply, sender)] * copies

    def due(self, now_ns: int) -> list[tuple[int, bytes, object]]:
        """Late replies (bus, reply, sender) whose time has come, in the order they are due."""
        leaving = []
        while self._kept and self._kept[0][0] <= now_ns:
            _, _, bus, reply, sender = heapq.heappop(self._kept)
            leaving.append((bus, reply, sender))
        self._look()
        return leaving

    def _look(self) -> None:
        self.next_ns = self._kept[0][0] if self._kept else NEVER
        self.active = bool(self._kept) or any(self._loss) or any(
            packet_fault.count or packet_fault.rate for kinds in self._kinds for packet_fault in kinds.values())

    # -- settings ------------------------------------------------------------------------------------------------------

    def strike(self, kind: str, buses: range, *, count: int | None = None, rate: float | None = None,
               delay_ns: int = 0) -> None:
        """Apply the fault on each of these buses to the next `count` replies, or to each with probability `rate`.

        The rate holds until changed; None leaves count or rate unchanged, as does a delay of 0.
        """
        for bus in buses:
            fault = self._kinds[bus][kind]
            fault.count = fault.count if count is None else count
            fault.rate = fault.rate if rate is None else rate
            fault.delay_ns = delay_ns or fault.delay_ns
        self._look()

    def lose_packets(self, rate: float, buses: range) -> None:
        """Lose requests and replies with this probability, until changed."""
        for bus in buses:
            self._loss[bus] = rate
        self._look()

    def end(self) -> None:
        """End all faults; late replies are still sent when due."""
        for kind in KINDS:
            self.strike(kind, range(len(self._kinds)), count=0, rate=0.0)
        self.lose_packets(0.0, range(len(self._loss)))


def _dropped(reply: Buffer) -> bytes:
    """Reply of a board to a request it dropped: its trailer, which reports the drop."""
    trailer = bytearray(reply[-TRAILER_BYTES:])
    trailer[0] |= DROPPED
    return bytes(trailer)


def _relabelled(reply: Buffer) -> bytes:
    """The same with the next transaction label; the trailer alone has none."""
    if len(reply) <= TRAILER_BYTES:
        return bytes(reply)
    first = _QUAD.unpack_from(reply)[0]
    label = (first >> _LABEL_SHIFT) + 1 & _LABEL_MASK
    return _QUAD.pack(first & ~(_LABEL_MASK << _LABEL_SHIFT) | label << _LABEL_SHIFT) + bytes(reply[_QUAD.size :])
