"""The ring: one writer, any number of readers, newest first, history kept.

Write (only the claimed writer); record n goes into slot n mod depth:
  W1  slot.sequence := BUSY + n     done right after record n - 1 is out (or at claim), so that it delays no reader
  W2  slot.stamp, payload := record one memcpy
  W3  slot.sequence := n            the record is out
  W4  head := n                     and is the newest

Read the newest (anyone, changes nothing):
  R1  n := head                     0: nothing was ever written
  R2  copy the slot of n            one memcpy
  R3  slot.sequence = n?            else the writer came round while we copied: again from R1, bounded, then reported

Read the next, n being one more than the last:
  S1  slot.sequence = n?            it is out; BUSY + n: not yet. Anything else: head tells what was overwritten
  R2, R3 as above

Read many, oldest first: R1, then block by block R2 for all its slots, and R3 for each. Behind a record that the writer
has overwritten are only newer ones; it and all older ones are left out.

Recovery. Wherever a writer dies, head names a whole record and one slot, that of head + 1, may be torn. A successor
claims the segment (epoch + 1):
  V0  slot of head says head?           else somebody else wrote into one of them: the slots tell the newest record
  V1  slot of head + 1 says head + 1?   then the dead writer stopped between W3 and W4: head := head + 1
  V2  go on at W1 with n = head + 1

Of depth slots one is always busy: depth - 1 records are kept.

Memory order: W1 → W2 → W3 → W4 are stores in program order, R1 → R2 → R3 and S1 → R2 → R3 loads in program order;
shm/memory/order.py says why that holds. A reader that saw any byte of a newer record therefore sees its W1 or later at
R3, and one that saw n in head or in the slot sees all of W2.

A reader trusts nothing: every index is a remainder, every loop is bounded, and what no writer does (a head that goes
backwards, a slot that contradicts the head) ends in False and a count, `backwards` or `torn`; see `problem`.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.shm.memory.layout import MAX_DEPTH, Schema, address_of
from trocar.shm.memory.segment import HEAD_AT, Segment, SegmentError
from trocar.shm.ring.slots import PlacesOnDemand, places, slots

RETRIES = 16
BUSY = 1 << 59  # no sequence gets there; and CPython is quicker with integers below 2**60
NEXT_BUSY = BUSY + 1
LAST_STAMP = 1 << 62  # ns; 146 years after boot
HEAD = HEAD_AT // 8
EPOCH_WORD = 8  # pid below, epoch above
ALL = slice(None)
BLOCK = 256  # slots copied at once; for up to 500, numpy does not let other threads run between R2 and R3
LAST_SEQUENCE = BUSY - 2  # ten thousand years at a million records a second


class RingError(Exception):
    """A ring that cannot be read or written as requested."""


def attach(segment: Segment, kind: str, expected: Schema | None) -> None:
    """Refuse a segment of another kind or with another schema, naming both sides."""
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

    def __init__(self, segment: Segment, name: str, expected: Schema | None = None, *, often: bool = True) -> None:
        """Claim `segment` (attached with write=True) as instance `name`, and resume at the last head.

        `often` prepares for fast writes.
        """
        attach(segment, "ring", expected)
        self._words = segment.words(segment.header.schema.dtype.itemsize)
        self.identity = segment.claim(name)
        self._segment = segment
        self._record = _Record(segment.header.schema)
        self._places = places(segment, 8) if often else PlacesOnDemand(segment, 8)
        self._source = self._record.bytes[8 : segment.header.schema.dtype.itemsize]
        self._stamp = self._record.words
        self._depth = segment.header.depth
        self.sequence: int = self._recover()
        self._at, self._slot = self._places[(self.sequence + 1) % self._depth]
        self._words[self._at] = self.sequence + NEXT_BUSY  # W1

    def _recover(self) -> int:
        """The sequence at which to resume; our record starts as the predecessor's last one, if that is whole."""
        words, n = self._words, self._words[HEAD]
        if n >= LAST_SEQUENCE:
            raise SegmentError(f"{self._segment.name}: head {n} is garbage; no writer counts that far")
        if words[self._places[n % self._depth][0]] != n:  # V0
            n = self._by_slots(n)
        if words[self._places[(n + 1) % self._depth][0]] == n + 1:  # V1
            n += 1
            words[HEAD] = n
        at, slot = self._places[n % self._depth]
        if n and words[at] == n:
            self._source[ALL] = slot
            if not 0 <= self._stamp[1] <= LAST_STAMP:
                self._stamp[1] = 0  # events count on from it
        return n

    def _by_slots(self, head: int) -> int:
        """The newest sequence by the slots, where they and `head` differ by more than a round.

        A number used twice would be overlooked by readers that wait for the next one.
        """
        kept = max((n for k in range(self._depth)
                    if (n := self._words[self._places[k][0]]) < LAST_SEQUENCE and n % self._depth == k), default=head)
        return head if kept <= head < kept + self._depth else kept

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the private record; resolve before the loop."""
        return self._record.field(name)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the record last published; 0 if there is none."""
        return int(self._stamp[1])

    def publish(self, stamp_ns: int) -> int:
        """Make the private record the newest; returns its sequence."""
        n = self.sequence + 1
        words = self._words
        self._stamp[1] = stamp_ns
        self._slot[ALL] = self._source  # W2
        words[self._at] = n  # W3
        words[HEAD] = n  # W4
        self.sequence = n
        self._at, self._slot = self._places[(n + 1) % self._depth]
        words[self._at] = n + NEXT_BUSY  # W1 of the next record, after ours is out: delays no reader
        return n

    def claim_again(self) -> None:
        """Let readers see a new epoch, as after a restart of our process; our private record keeps its values."""
        self.identity = self._segment.claim(self.identity.name)

    def copy(self, record: memoryview) -> None:
        """Copy the content of a record from another ring of this layout; `publish` adds our number and stamp."""
        self._source[ALL] = record[8:]

    def close(self) -> None:
        """Release the claim."""
        self._slot.release()
        self._segment.close()


class RingReader:
    """The reading end; keeps one private copy with its fields prepared: valid after `newest` or `next` returned True.

    `lost` counts records that `next` left out because they were overwritten or about to be, `torn` reads given up after
    RETRIES, `backwards` heads older than the last one read. After an abandoned read the private copy has stamp 0, so
    that it never counts as fresh.
    """

    def __init__(self, segment: Segment, expected: Schema | None = None, *, often: bool = True) -> None:
        """Read `segment` (attached read-only); `next()` begins behind the newest record present now.

        `often` prepares for fast reads; without it, a single read starts sooner.
        """
        attach(segment, "ring", expected)
        self._words = segment.words()
        self._segment = segment
        self._dtype = segment.header.schema.dtype
        self._record = _Record(segment.header.schema)
        self._places = places(segment, 0) if often else PlacesOnDemand(segment, 0)
        self._target = self._record.bytes[: self._dtype.itemsize]
        self._stamp = self._record.words
        self._depth = segment.header.depth
        self.sequence = 0
        self.lost = self.torn = self.backwards = 0
        self._next: int
        self._at: int
        self._slot: memoryview
        head = self._words[HEAD]
        self.torn += self._words[self._places[head % self._depth][0]] % BUSY < head  # else we skip records
        self._go_to(head + 1)

    @property
    def info(self) -> dict[str, Any]:
        """Constants of the instance, from the header."""
        return self._segment.header.info

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The record's dtype, `sequence` and `stamp_ns` first."""
        return self._dtype

    @property
    def schema(self) -> Schema:
        """Its layout, from the header."""
        return self._segment.header.schema

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the private copy; resolve before the loop."""
        return self._record.field(name)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the copied record (monotonic); 0 before the first."""
        return int(self._stamp[1])

    @property
    def record(self) -> memoryview:
        """The private copy as bytes, for keeping."""
        return self._target

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of our map, our private copy and the first slot, see Segment.address."""
        maps = self._segment.address
        return maps, address_of(self._target), maps + self._segment.header.first

    @property
    def depth(self) -> int:
        """Slots, of which one is always busy."""
        return self._depth

    @property
    def stride(self) -> int:
        """Bytes from one slot to the next."""
        return self._segment.header.stride

    @property
    def head(self) -> int:
        """Sequence of the newest record, 0: none; one load, for polling."""
        return int(self._words[HEAD])

    @property
    def following(self) -> int:
        """Sequence of the record that `next` takes."""
        return self._next

    @property
    def epoch(self) -> int:
        """Number of claims of the ring; another number means another writer process."""
        return int(self._words[EPOCH_WORD] >> 32)

    @property
    def gone(self) -> str:
        """The writer that has ended, in words; empty while one is alive (makes a system call: for tools)."""
        return self._segment.gone

    @property
    def problem(self) -> str:
        """Content that none of our writers produces, in words; empty if all is well."""
        odd = [f"{self.backwards} times the head went backwards (last good: {self.sequence})"] * bool(self.backwards)
        odd += [f"{self.torn} reads found no whole record"] * bool(self.torn)
        return "; ".join(odd)

    def newest(self) -> bool:
        """Copy the newest record; False if there is none, or no whole one could be read (counted in `torn`)."""
        n = self._words[HEAD]  # R1
        at, slot = self._places[n % self._depth]
        self._target[ALL] = slot  # R2
        if self._words[at] == n >= self.sequence and n:  # R3
            self.sequence = n
            return True
        return self._newest_again()

    def _newest_again(self) -> bool:
        words = self._words
        for _ in range(RETRIES):
            n = words[HEAD]  # R1
            if n < self.sequence:
                if n < self.sequence - 1:
                    self.backwards += 1
                    return self._nothing()
                n = self.sequence  # `next` took it before its W4
            if n == 0:
                return self._nothing()
            at, slot = self._places[n % self._depth]
            self._target[ALL] = slot  # R2
            if words[at] == n:  # R3
                self.sequence = n
                return True
        self.torn += 1
        return self._nothing()

    def _nothing(self) -> bool:
        """The copy is not a record: make it the oldest possible."""
        self._stamp[0] = self._stamp[1] = 0
        return False

    def next(self) -> bool:
        """Copy the next record in order; False when there is none yet. Skipped records are added to `lost`."""
        words, at, n = self._words, self._at, self._next
        seen = words[at]  # S1
        if seen == n:
            self._target[ALL] = self._slot  # R2
            if words[at] == n:  # R3
                self.sequence = n
                self._next = n = n + 1
                self._at, self._slot = self._places[n % self._depth]
                return True
        elif seen == n + BUSY:
            return False
        return self._next_again(seen == n)

    def _next_again(self, spoilt: bool) -> bool:
        """`spoilt`: our copy is of something that is no whole record."""
        words = self._words
        for attempt in range(RETRIES):
            n, head = self._next, words[HEAD]
            if n > head and words[self._at] != n:
                if n > head + 2:  # two: we may have read a record before its W4
                    self.backwards += 1
                return self._nothing() if spoilt else False
            oldest = head - self._depth + 2
            if n >= oldest:
                self._target[ALL] = self._slot  # R2
                if words[self._at] == n:  # R3
                    self.sequence = n
                    self._go_to(n + 1)
                    return True
                spoilt = True
            room = max(0, min((1 << attempt) - 1, self._depth - 2))  # fast writers overtake the oldest
            self.lost += max(1, oldest + room - n)
            self._go_to(max(n + 1, oldest + room))
        self.torn += 1
        return self._nothing()

    def rewind(self, count: int = MAX_DEPTH) -> None:
        """`next` resumes with this many of the newest records, or with the oldest that is kept."""
        self._go_to(max(1, int(self._words[HEAD]) - min(count, self._depth - 1) + 1))

    def _go_to(self, n: int) -> None:
        self._next = n
        self._at, self._slot = self._places[n % self._depth]

    def last(self, count: int) -> NDArray[Any]:
        """Up to `count` newest records, oldest first, as one structured array: whole ones, without a gap. Records that
        the writer overwrites meanwhile are left out with all older ones: they are missing at the front.
        """
        head = int(self._words[HEAD])
        return self._collect(max(1, head - min(count, self._depth - 1) + 1), head)

    def since(self, stamp_ns: int) -> NDArray[Any]:
        """All records kept whose stamp is at least `stamp_ns`, oldest first; whole and without a gap, as in `last`."""
        head = int(self._words[HEAD])
        kept = range(max(1, head - self._depth + 2), head + 1)
        begin = bisect_left(kept, stamp_ns, key=lambda n: int(self._words[self._places[n % self._depth][0] + 1]))
        records = self._collect(kept.start + begin, head)
        return records[records["stamp_ns"] >= stamp_ns]

    def _collect(self, begin: int, end: int) -> NDArray[Any]:
        words, header, first, n = self._words, self._segment.header, 0, begin
        rows: NDArray[Any] = np.empty(max(0, end - begin + 1), self._dtype)
        source = slots(self._segment)
        target = rows.view(source.dtype)
        while n <= end:
            k, i = n % self._depth, n - begin
            count = min(BLOCK, end - n + 1, self._depth - k)
            target[i : i + count] = source[k : k + count]  # R2
            start = header.first + k * header.stride
            for at in range(start // 8, (start + count * header.stride) // 8, header.stride // 8):
                if words[at] != n:  # R3
                    first = n - begin + 1
                n += 1
        return rows[first:]

    def close(self) -> None:
        """Unmap."""
        self._slot.release()
        self._segment.close()
