"""The ring: one writer, any number of readers, newest first, history kept.

Write (only the claimed writer):
  W1  slot.sequence := 0            the slot is now nobody's
  W2  slot.stamp, payload := record one memcpy
  W3  slot.sequence := n
  W4  head := n

Read (anyone, changes nothing):
  R1  n := head                     0: nothing was ever written
  R2  copy the slot of n            one memcpy
  R3  slot.sequence = n?            else the writer came round while we copied: again from R1, bounded, then reported

Recovery: a writer that dies between W1 and W3 leaves a slot whose sequence is 0; head still names the one before. Its
successor claims the segment (epoch + 1) and goes on at W1 with n = head + 1.

Memory order: W1 → W2 → W3 → W4 are stores in program order, R1 → R2 → R3 loads in program order. x86-64 keeps both
orders (total store order; the stores of one memcpy may pass each other, but none passes a later or earlier store of
another instruction). A reader that saw any byte of a newer payload therefore sees W1 or a later W3 at R3. Each 64-bit
word is one aligned load or store: CPython copies a memoryview item of format "Q" with a single 8-byte move.
"""

from __future__ import annotations

import platform
from bisect import bisect_left
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shm.layout import Schema
from shm.segment import HEAD_AT, Segment, SegmentError

RETRIES = 16
HEAD = HEAD_AT // 8
ALL = slice(None)


class RingError(Exception):
    """A ring that cannot be read or written as asked."""


def attach(segment: Segment, kind: str, expected: Schema | None) -> None:
    """Refuse a segment of another kind or with another schema, naming both sides."""
    if platform.machine() not in ("x86_64", "AMD64"):
        raise RingError(f"{platform.machine()}: the ring's order of stores is shown for x86-64 only")
    if segment.header.kind != kind:
        raise SegmentError(f"{segment.name}: is a {segment.header.kind}, not a {kind}")
    if expected is not None and expected.fingerprint != segment.header.schema.fingerprint:
        raise SegmentError(
            f"{segment.name}: written with schema {segment.header.schema.fingerprint:016x}, this program has "
            f"{expected.fingerprint:016x}; both must be of the same version"
        )


class _Record:
    """A private record: numpy fields ready made, and its bytes for one memcpy."""

    def __init__(self, schema: Schema) -> None:
        self._bytes = bytearray(schema.stride)
        self.bytes = memoryview(self._bytes)
        self.words = self.bytes.cast("q")
        self._array: NDArray[Any] = np.frombuffer(self._bytes, dtype=schema.dtype, count=1)

    def field(self, name: str) -> NDArray[Any]:
        """A view on the field; scalars have shape (): set them with `[...] =`, read them with `[()]` or `item()`."""
        if name not in (self._array.dtype.names or ()):
            raise RingError(f"no field {name}; there are: {', '.join(self._array.dtype.names or ())}")
        view = self._array[name]
        return view.reshape(view.shape[1:])


class RingWriter:
    """The writing end. Fill the fields, then `publish`."""

    def __init__(self, segment: Segment, name: str, expected: Schema | None = None) -> None:
        """Claim `segment` (attached with write=True) as instance `name`, going on from the last head."""
        attach(segment, "ring", expected)
        self.identity = segment.claim(name)
        header = segment.header
        self._segment = segment
        self._record = _Record(header.schema)
        self._view = segment.view
        self._words = segment.words()
        self._depth = header.depth
        starts = [header.first + i * header.stride for i in range(header.depth)]
        self._at = [s // 8 for s in starts]
        size = header.schema.dtype.itemsize
        self._slices = [slice(s + 8, s + size) for s in starts]
        self._source = self._record.bytes[8:size]
        self._stamp = self._record.words
        self.sequence: int = self._words[HEAD]
        if self.sequence:
            self._load_last(starts[self.sequence % self._depth], size)

    def _load_last(self, start: int, size: int) -> None:
        """Begin with what the predecessor wrote last, when that slot is whole."""
        if self._words[start // 8] == self.sequence:
            self._record.bytes[:size] = self._view[start : start + size]

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the private record; resolve before the loop."""
        return self._record.field(name)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the record last published; 0 when nothing was."""
        return int(self._stamp[1])

    def publish(self, stamp_ns: int) -> int:
        """Make the private record the newest; returns its sequence."""
        n = self.sequence + 1
        slot = n % self._depth
        at = self._at[slot]
        words = self._words
        self._stamp[1] = stamp_ns
        words[at] = 0  # W1
        self._view[self._slices[slot]] = self._source  # W2
        words[at] = n  # W3
        words[HEAD] = n  # W4
        self.sequence = n
        return n

    def close(self) -> None:
        """Give the claim back."""
        self._segment.close()


class RingReader:
    """The reading end; keeps one private copy, its fields ready made: good after `newest` or `next` said True."""

    def __init__(self, segment: Segment, expected: Schema | None = None) -> None:
        """Read `segment` (attached read-only); `next()` begins behind the newest record present now."""
        attach(segment, "ring", expected)
        header = segment.header
        self._segment = segment
        self._record = _Record(header.schema)
        self._dtype = header.schema.dtype
        self._view = segment.view
        self._words = segment.words()
        self._depth = header.depth
        size = self._dtype.itemsize
        starts = [header.first + i * header.stride for i in range(header.depth)]
        self._at = [s // 8 for s in starts]
        self._slots = [self._view[s : s + size] for s in starts]  # made once: a slice costs as much as the copy
        segment.at_close(self._release)
        self._target = self._record.bytes[:size]
        self._stamp = self._record.words
        self.sequence = 0
        self.lost = 0
        self.torn = 0
        self._next: int = self._words[HEAD] + 1

    @property
    def info(self) -> dict[str, Any]:
        """Constants of the instance, from the header."""
        return self._segment.header.info

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The record's dtype, `sequence` and `stamp_ns` first."""
        return self._dtype

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the private copy; resolve before the loop."""
        return self._record.field(name)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the copied record (monotonic); 0 before the first."""
        return int(self._stamp[1])

    @property
    def head(self) -> int:
        """Sequence of the newest record, 0: none; one load, for polling."""
        return int(self._words[HEAD])

    @property
    def epoch(self) -> int:
        """How often the ring was claimed; another number means another writer process."""
        return int(self._words[8] >> 32)

    def newest(self) -> bool:
        """Copy the newest record; False when there is none, or none could be had whole (counted in `torn`)."""
        n = self._words[HEAD]  # R1
        slot = n % self._depth
        self._target[ALL] = self._slots[slot]  # R2
        if self._words[self._at[slot]] == n and n:  # R3
            self.sequence = n
            return True
        return self._newest_again()

    def _newest_again(self) -> bool:
        for _ in range(RETRIES):
            n = self._words[HEAD]  # R1
            if n == 0:
                return False
            slot = n % self._depth
            self._target[ALL] = self._slots[slot]  # R2
            if self._words[self._at[slot]] == n:  # R3
                self.sequence = n
                return True
        self.torn += 1
        return False

    def next(self) -> bool:
        """Copy the next record in order; False when there is none yet. What was overwritten is added to `lost`."""
        n, head = self._next, self._words[HEAD]
        if n > head:
            return False
        if head - n < self._depth:
            slot = n % self._depth
            self._target[ALL] = self._slots[slot]
            if self._words[self._at[slot]] == n:
                self.sequence = n
                self._next = n + 1
                return True
        return self._next_again()

    def _next_again(self) -> bool:
        words = self._words
        for _ in range(RETRIES):
            head = words[HEAD]
            n = self._next
            if n > head:
                return False
            if head - n >= self._depth:
                self._skip_to(head - self._depth + 1)
                continue
            slot = n % self._depth
            self._target[ALL] = self._slots[slot]
            if words[self._at[slot]] == n:
                self.sequence = n
                self._next = n + 1
                return True
            self._skip_to(n + 1)
        self.torn += 1
        return False

    def _skip_to(self, n: int) -> None:
        self.lost += n - self._next
        self._next = n

    def last(self, count: int) -> NDArray[Any]:
        """Up to `count` newest records, oldest first, as one structured array; only whole ones."""
        head = int(self._words[HEAD])
        return self._collect(max(1, head - min(count, self._depth - 1) + 1), head)

    def since(self, stamp_ns: int) -> NDArray[Any]:
        """All records kept whose stamp is at least `stamp_ns`, oldest first."""
        head = int(self._words[HEAD])
        kept = range(max(1, head - self._depth + 2), head + 1)
        begin = bisect_left(kept, stamp_ns, key=lambda n: int(self._words[self._at[n % self._depth] + 1]))
        records = self._collect(kept.start + begin, head)
        return records[records["stamp_ns"] >= stamp_ns]

    def _collect(self, begin: int, end: int) -> NDArray[Any]:
        numbers = range(begin, end + 1)
        rows: NDArray[Any] = np.zeros(len(numbers), dtype=self._dtype)
        keep = np.zeros(len(numbers), dtype=bool)
        size = self._dtype.itemsize
        target = rows.view(np.uint8).reshape(-1).data
        for i, n in enumerate(numbers):
            slot = n % self._depth
            target[i * size : (i + 1) * size] = self._slots[slot]
            keep[i] = self._words[self._at[slot]] == n
        whole: NDArray[Any] = rows[keep & (rows["sequence"] == np.arange(begin, end + 1, dtype=np.uint64))]
        return whole

    def _release(self) -> None:
        for slot in self._slots:
            slot.release()

    def close(self) -> None:
        """Unmap."""
        self._segment.close()
