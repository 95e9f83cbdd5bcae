"""The RTPS wire protocol (OMG DDSI-RTPS 2.3, chapters 8.3 and 9.4): what a participant that answers requests needs.

What we write is little-endian; what we read says which it is. A packet is untrusted: `messages` leaves out what it
cannot read.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

HEADER: Final = b"RTPS\x02\x03\x00\x00"
"""Version, and a vendor that OMG does not list."""
DATA, HEARTBEAT, GAP, ACKNACK, INFO_DESTINATION, INFO_SOURCE = 0x15, 0x07, 0x08, 0x06, 0x0E, 0x0C
LITTLE, FINAL, INLINE, PAYLOAD = 1, 2, 2, 12
UNKNOWN: Final = bytes(4)
PREFIX, GUID = 12, 16  # bytes
SENTINEL: Final = 1
SET_SIZE: Final = 256
HIGH_LIMIT: Final = 1 << 30  # of the upper half of a sequence number: those that follow one can still be written
Parameters = list[tuple[int, bytes]]


@dataclass(frozen=True, slots=True)
class Submessage:
    """One message of a writer (`data`, `heartbeat`, `gap`) or of a reader (`acknack`) to an entity of ours.

    `guid`: of the sender. `target`: our entity; zeros: all. `first`, `last`: sequence numbers; of `data` both are its
    own, of `gap` the missing ones. `missing`: of `acknack`, those to send again, all before `first` were received.
    """

    kind: int
    guid: bytes
    target: bytes
    first: int
    last: int
    is_final: bool = False
    missing: tuple[int, ...] = ()
    inline: tuple[tuple[int, bytes], ...] = ()
    payload: bytes = b""


@dataclass(slots=True)
class Inbox:
    """What a reliable writer has sent to one reader of ours: all before `base`, and `early` ones behind it."""

    base: int = 1
    early: dict[int, Submessage | None] = field(default_factory=dict)
    count: int = 0

    def put(self, one: Submessage) -> list[Submessage]:
        """Take a message, or a gap; returns the messages whose turn it is."""
        if one.kind == GAP and one.first <= self.base:
            return self.begins(one.last + 1)
        for sequence in range(max(one.first, self.base), min(one.last, self.base + SET_SIZE) + 1):
            self.early[sequence] = one if one.kind == DATA else None
        return self._turn()

    def begins(self, first: int) -> list[Submessage]:
        """The writer has none before this one any more."""
        self.base = max(self.base, first)
        self.early = {sequence: one for sequence, one in self.early.items() if sequence >= self.base}
        return self._turn()

    def _turn(self) -> list[Submessage]:
        found = []
        while self.base in self.early:
            one = self.early.pop(self.base)
            found += [one] if one is not None else []
            self.base += 1
        return found

    def missing(self, last: int) -> list[int]:
        """The sequence numbers to ask for, of those up to `last`."""
        return [k for k in range(self.base, min(last, self.base + SET_SIZE - 1) + 1) if k not in self.early]


def messages(packet: bytes, ours: bytes) -> Iterator[Submessage]:
    """The messages of a packet that are for the participant of prefix `ours`, until one that cannot be read."""
    if len(packet) < 20 or packet[:4] != HEADER[:4]:
        return
    prefix, is_ours, at = packet[8:20], True, 20
    try:
        while at + 4 <= len(packet):
            kind, flags = packet[at], packet[at + 1]
            order = "<" if flags & LITTLE else ">"
            size = struct.unpack_from(order + "H", packet, at + 2)[0]
            body = packet[at + 4:at + 4 + size] if size else packet[at + 4:]
            at += 4 + len(body)
            if kind == INFO_DESTINATION:
                is_ours = body[:PREFIX] in (ours, bytes(PREFIX))
            elif kind == INFO_SOURCE:
                (prefix,) = struct.unpack_from("12s", body, 8)
            elif is_ours and kind in (DATA, HEARTBEAT, GAP, ACKNACK):
                yield _read(kind, flags, body, order, prefix)
    except (struct.error, ValueError):
        return


def _read(kind: int, flags: int, body: bytes, order: str, prefix: bytes) -> Submessage:
    at = 4 if kind == DATA else 0
    reader, writer = struct.unpack_from("4s4s", body, at)
    first = _sequence(body, at + 8, order)
    if kind == DATA:
        start = 4 + struct.unpack_from(order + "H", body, 2)[0]
        inline, end = parameters(body, start, order) if flags & INLINE else ([], start)
        return Submessage(kind, prefix + writer, reader, first, first, inline=tuple(inline),
                          payload=body[end:] if flags & PAYLOAD else b"")
    if kind == HEARTBEAT:
        return Submessage(kind, prefix + writer, reader, first, _sequence(body, 16, order), bool(flags & FINAL))
    if kind == GAP:  # single numbers behind the range would be asked for again, and named again
        return Submessage(kind, prefix + writer, reader, first, _sequence(body, 16, order) - 1)
    bits = struct.unpack_from(order + "I", body, 16)[0]
    if bits > SET_SIZE:
        raise ValueError
    words = struct.unpack_from(f"{order}{(bits + 31) // 32}I", body, 20)
    missing = tuple(first + k for k in range(bits) if words[k // 32] >> (31 - k % 32) & 1)
    return Submessage(kind, prefix + reader, writer, first, first, bool(flags & FINAL), missing)


def _sequence(body: bytes, at: int, order: str) -> int:
    high, low = struct.unpack_from(order + "iI", body, at)
    if not 0 <= high < HIGH_LIMIT:
        raise ValueError
    return int(high << 32 | low)


def parameters(body: bytes, at: int, order: str) -> tuple[Parameters, int]:
    """A list of parameters from `at` on, each by its number, and where it ends."""
    found: Parameters = []
    while True:
        number, size = struct.unpack_from(order + "HH", body, at)
        at += 4
        if number == SENTINEL:
            return found, at
        if at + size > len(body):
            raise ValueError
        found.append((number, body[at:at + size]))
        at += size


def described(payload: bytes) -> tuple[Parameters, str]:
    """The parameters of a discovery message, and their byte order; ValueError: it is none."""
    if len(payload) < 8 or payload[:2] not in (b"\0\2", b"\0\3"):
        raise ValueError
    order = "<" if payload[1] & 1 else ">"
    return parameters(payload, 4, order)[0], order


def text_of(value: bytes, order: str) -> str:
    """A text parameter."""
    size = struct.unpack_from(order + "I", value)[0]
    return value[4:4 + size].rstrip(b"\0").decode(errors="replace")


def text(value: str) -> bytes:
    """A text as the value of a parameter."""
    return struct.pack("<I", len(value.encode()) + 1) + value.encode() + b"\0"


def listed(rows: Iterable[tuple[int, bytes]]) -> bytes:
    """Parameters, each padded to four bytes, and their end."""
    found = b""
    for number, value in rows:
        padded = value + bytes(-len(value) % 4)
        found += struct.pack("<HH", number, len(padded)) + padded
    return found + struct.pack("<HH", SENTINEL, 0)


def packet(prefix: bytes, to: bytes, *parts: bytes) -> bytes:
    """A packet of ours for one participant; zeros: for all."""
    destination = struct.pack("<BBH", INFO_DESTINATION, LITTLE, PREFIX) + to if any(to) else b""
    return HEADER + prefix + destination + b"".join(parts)


def _part(kind: int, flags: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    return struct.pack("<BBH", kind, flags | LITTLE, len(body)) + body


def number(sequence: int) -> bytes:
    """A sequence number on the wire."""
    return struct.pack("<iI", sequence >> 32, sequence & 0xFFFFFFFF)


def data(writer: bytes, reader: bytes, sequence: int, payload: bytes,
         inline: Sequence[tuple[int, bytes]] = ()) -> bytes:
    """A message: what a writer writes."""
    rows = listed(inline) if inline else b""
    body = struct.pack("<HH", 0, 16) + reader + writer + number(sequence) + rows + payload
    return _part(DATA, 4 | (INLINE if inline else 0), body)


def heartbeat(writer: bytes, reader: bytes, first: int, last: int, count: int) -> bytes:
    """The sequence numbers that a writer has; it asks for an acknack."""
    return _part(HEARTBEAT, 0, reader + writer + number(first) + number(last) + struct.pack("<I", count))


def gap(writer: bytes, reader: bytes, first: int, last: int) -> bytes:
    """These sequence numbers are not for this reader."""
    return _part(GAP, 0, reader + writer + number(first) + number(last + 1) + bytes(4))


def acknack(writer: bytes, reader: bytes, base: int, missing: Sequence[int], count: int) -> bytes:
    """A reader has all before `base`, and asks for these."""
    bits = min(SET_SIZE, missing[-1] - base + 1 if missing else 0)
    words = [0] * ((bits + 31) // 32)
    for each in missing:
        if each - base < bits:
            words[(each - base) // 32] |= 1 << (31 - (each - base) % 32)
    body = reader + writer + number(base) + struct.pack(f"<I{len(words)}II", bits, *words, count)
    return _part(ACKNACK, 0 if missing else FINAL, body)
