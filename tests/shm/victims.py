"""The victims of kills.py that end at a ring or a control page, and what must hold when one has died: a ring's
writer, a reader who also sleeps until it is woken, and a subscriber. Those at a mailbox are in senders.py."""

from __future__ import annotations

import time
from collections.abc import Callable

from tests.shm.witness import Author, Lives, Notes, RingViolation, Witness, holds, topic
from trocar.shm.memory.rows import Field, Topic
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.system.subscriptions import Clearing, Subscriber, Subscriptions
from trocar.shm.time.control_page import ControlPage, create_control

QUIET_NS = 100_000
NAP_NS = 2_000_000


class WriterVictim:
    """A ring's writer dies; readers live on in the parent."""

    EPOCH, RECOVERED, PUBLISHED = range(Notes.FREE, Notes.FREE + 3)

    def __init__(self, system: str, notes: Notes, slots: int, size: int) -> None:
        create_ring(system, "io", topic(slots, size), {}, {})
        self._name, self._notes, self._kept = segment_name(system, "io", "telling"), notes.words, slots - 1
        self._segment, self._lives = Segment(self._name), Lives()
        self._ordered, self._latest, self._mixed = (self._witness() for _ in range(3))
        self._end = self._lost = self._epoch = 0

    def _witness(self) -> Witness:
        return Witness(RingReader(Segment(self._name)), self._lives)

    @property
    def figures(self) -> dict[str, int]:
        """Of the whole run."""
        received = sum(w.received for w in (self._ordered, self._latest, self._mixed))
        return {"records": self._end, "reads": received, "lost": self._lost, "claims": self._epoch}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Claim, and publish for ever."""
        author, notes = Author(RingWriter(Segment(self._name, write=True), "io"), life), self._notes
        notes[self.RECOVERED], notes[self.EPOCH] = author.writer.sequence, author.writer.identity.epoch
        ready()
        while True:
            notes[self.PUBLISHED] = author.publish()

    def serve(self) -> None:
        """Read what there is: by `next`, by `newest`, and by both in one reader."""
        self._ordered.next()
        self._latest.newest()
        for verb in (self._mixed.reader.newest, self._mixed.reader.next):
            if verb():
                self._mixed.judge()
                self._mixed.received += 1

    def inspect(self, life: int, pid: int) -> None:
        """The ring is at rest: everything is read to its end, and nothing is amiss."""
        before, torn = self._end, self._ordered.reader.torn
        while self._ordered.next():
            pass
        self._end = self._ordered.last
        self._judge_numbers(before, pid)
        lost, self._lost = self._lost, self._ordered.reader.lost
        if self._end - before <= self._kept:
            holds(self._lost == lost, f"{self._lost - lost} records were counted as lost that nobody had overwritten")
        holds(self._ordered.reader.torn == torn, "`next` found no whole record in a ring at rest")
        holds(not self._segment.claimed(), "the claim of the dead is not free")
        if self._ordered.reader.head:
            self._latest.newest()
            holds(self._mixed.reader.newest(), "`newest` found no record in a ring at rest")
            self._mixed.judge()
        for witness in (self._ordered, self._latest, self._mixed):
            holds(not witness.reader.backwards, witness.reader.problem)
        self._come_late()

    def _judge_numbers(self, before: int, pid: int) -> None:
        """What the dead wrote down fits what the ring holds, and what its predecessor left."""
        head, out, seen = self._ordered.reader.head, self._notes[self.PUBLISHED] or before, self._end
        holds(seen in (out, out + 1), f"{seen} can be read, {out} was published")
        holds(head in (seen, seen - 1), f"head is {head}, {seen} can be read")
        identity, epoch = self._segment.identity(), self._notes[self.EPOCH]
        claimed = identity.epoch == self._epoch + 1
        holds(claimed or (identity.epoch == self._epoch and not epoch), f"epoch {identity.epoch} after {self._epoch}")
        holds(claimed == (identity.pid == pid), f"epoch {identity.epoch}, but pid {identity.pid}, after {pid} died")
        if epoch:
            recovered = self._notes[self.RECOVERED]
            holds(epoch == identity.epoch, f"claimed with epoch {epoch}, the header says {identity.epoch}")
            holds(recovered == before, f"went on from {recovered} where {before} was the last")
        self._epoch = identity.epoch

    def _come_late(self) -> None:
        """A reader that attaches now finds the whole history."""
        late = self._witness()
        head = late.reader.head
        holds(late.newest() == bool(head) and late.last == head, f"newest gives {late.last}, head is {head}")
        kept = list(range(max(1, head - self._kept + 1), head + 1))
        holds(late.history(late.reader.last(1 << 20)) == kept, f"`last` does not give the {len(kept)} records kept")
        middle = head - len(kept) // 2
        holds(late.history(late.reader.since(middle)) == [n for n in kept if n >= middle], "`since` leaves some out")
        late.last = late.received = 0
        holds(late.next() == (self._end == head + 1), f"`next` gives {late.last}, {self._end} is out, head is {head}")
        late.reader.close()

    def finish(self) -> None:
        """A last successor goes on."""
        heir = Author(RingWriter(Segment(self._name, write=True), "io"), 0)
        holds(heir.writer.identity.epoch == self._epoch + 1, "the last claim does not count")
        heir.publish()
        holds(self._ordered.next() and self._ordered.last == self._end + 1, "the last record did not come")
        for end in (heir.writer, self._ordered.reader, self._latest.reader, self._mixed.reader, self._segment):
            end.close()


class ReaderVictim:
    """A ring's reader dies, who sleeps and is woken by the writer, which lives on in the parent."""

    READS, LOST, SLEEPS = range(Notes.FREE, Notes.FREE + 3)

    def __init__(self, system: str, notes: Notes) -> None:
        create_ring(system, "io", topic(16, 1024), {}, {})
        create_control(system, "io")
        self._system, self._notes = system, notes.words
        self._name = segment_name(system, "io", "telling")
        self._author = Author(RingWriter(Segment(self._name, write=True), "io"), 1)
        self._page = ControlPage(system, "io", write=True)
        self._wakeup = self._page.wakeup()
        self._due = self._steady = 0
        self.figures = {"records": 0, "reads": 0, "lost": 0, "sleeps": 0, "left_asleep": 0}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Attach, and read for ever: by `next`, by `newest`, or history."""
        witness = Witness(RingReader(Segment(self._name)), Lives())
        wakeup = ControlPage(self._system, "io", write=True).wakeup()
        notes, reader, seen = self._notes, witness.reader, 0

        def ready_to_read() -> bool:
            return reader.head != seen

        ready()
        while True:
            if wakeup.sleep(ready_to_read, NAP_NS):
                seen = reader.head
                notes[self.READS] += self._read(witness, life % 3)
                notes[self.LOST] = reader.lost
            holds(not reader.backwards, reader.problem)
            notes[self.SLEEPS] += 1

    @staticmethod
    def _read(witness: Witness, verb: int) -> int:
        """How many whole records one turn gave."""
        if verb == 0:
            return len(witness.history(witness.reader.last(9)))
        if verb == 1:
            return int(witness.newest())
        before = witness.received
        while witness.received < before + 16 and witness.next():
            pass
        return witness.received - before

    def serve(self) -> None:
        """Publish and wake: at full speed, or now and then, so that the reader sleeps."""
        now = time.monotonic_ns()
        if now >= self._due:
            self._author.publish()
            self._wakeup.wake()
            self._due = now + self._steady

    def inspect(self, life: int, pid: int) -> None:
        """The dead is not taken for a sleeper for ever, and the ring is as it was."""
        self._steady = QUIET_NS if life % 2 else 0
        for figure, at in (("reads", self.READS), ("lost", self.LOST), ("sleeps", self.SLEEPS)):
            self.figures[figure] += self._notes[at]
        self.figures["left_asleep"] += int(self._wakeup.sleeps)
        self.figures["records"] = n = self._author.publish()
        self._wakeup.wake()
        holds(not self._wakeup.sleeps, "the dead still seems to sleep")
        fresh = Witness(RingReader(Segment(self._name)), Lives())
        holds(fresh.newest() and fresh.last == n, f"a fresh reader gets {fresh.last} instead of {n}")
        fresh.reader.close()

    def finish(self) -> None:
        """Nothing is left to do."""
        if not self.figures["reads"]:
            raise RingViolation("nobody has read anything")
        self._author.writer.close()
        self._page.close()


class SubscriberVictim:
    """A subscriber dies; another lives on in the parent, with the instance, and the supervisor who clears."""

    TURNS = Notes.FREE

    def __init__(self, system: str, notes: Notes) -> None:
        fields = tuple(Field(group, "<f8", "", "", group) for group in ("first", "second", "third"))
        create_control(system, "io", topics=(Topic("telling", "io", fields, depth=4),))
        self._system, self._notes = system, notes.words
        self._own, self._supervisors = (ControlPage(system, "io", write=True) for _ in range(2))
        self._subscriptions, self._clearing = Subscriptions(self._own), Clearing(self._supervisors)
        self._steady = Subscriber(system, "io", "steady")
        self._steady.want("telling", "third")
        self._always = self._subscriptions.bits("telling") | self._subscriptions.bits("telling", "third")
        self.figures = {"turns": 0, "cleared": 0, "changes": 0}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Come, want, drop and go for ever."""
        first, begun = Subscriber(self._system, "io", "victim"), False
        while True:
            first.want("telling", "first")
            if not begun:
                ready()
                begun = True
            second = Subscriber(self._system, "io", "second")
            second.want("telling", "first", "second")
            second.drop("telling", "first")
            first.drop("telling")
            second.close()
            first.close()
            first = Subscriber(self._system, "io", "victim")
            self._notes[self.TURNS] += 1

    def serve(self) -> None:
        """Look and clear; what the living want is never lost."""
        self.figures["changes"] += self._subscriptions.look()
        holds(self._subscriptions.wanted & self._always == self._always, "what somebody wants was lost")
        self.figures["cleared"] += self._clearing.clear()

    def inspect(self, life: int, pid: int) -> None:
        """Nothing of what the dead wanted is left once it was cleared, and its place is free."""
        self.figures["turns"] += self._notes[self.TURNS]
        self.serve()
        self._subscriptions.look()
        holds(self._subscriptions.wanted == self._always, f"{self._subscriptions.wanted:b} is wanted by nobody alive")
        heir = Subscriber(self._system, "io", "heir")
        holds(heir.place == self._steady.place + 1, f"place {heir.place} is the first that is free")
        heir.close()

    def finish(self) -> None:
        """Everybody goes."""
        if not self.figures["cleared"]:
            raise RingViolation("nothing was ever left to be cleared")
        self._steady.close()
        self._subscriptions.look()
        holds(self._subscriptions.wanted == 0, "something is wanted by nobody")
        self._own.close()
        self._supervisors.close()
