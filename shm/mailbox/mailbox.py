"""The mailbox: commands to one owner from up to 16 clients; each client has a queue and a reply ring of its own.

One segment (shm/mailbox/mailbox_map.py). Each place has: a command queue (single producer, single consumer), a reply
ring, and three cursors: `sent` is written by the client, `taken` and `answered` by the owner. Client and owner go by
private copies of their own cursors; the cells only tell the other side.

Submit (client):  M1  sent − taken < depth            else MailboxFull, nothing was queued
                  M2  write the slot of sent + 1
                  M3  sent := sent + 1                the command counts from now on
Drain (owner):    N1  sent ≠ taken?
                  N2  copy the slot of taken + 1
                  N3  taken := taken + 1              the slot may be written again
                  N4  run it, answer
Answer (owner):   A1  slot.sequence := 0   A2 write the slot   A3 slot.sequence := n   A4 answered := n
Poll (client):    B1  answered > seen?     B2 copy the slot    B3 slot.sequence = n?   else it was overwritten: `lost`
Stop (anybody):   L1  lock the place for stops
                  L2  count := sent, known := taken, seen := answered; write down who we are
                  M1 to M3, then
                  L3  unlock it; the answer is polled without the lock

N3 comes before N4: a command runs at most once, also when the owner dies in between.

Stops. One more place is kept for stops. A client that has no place of its own, or whose queue is full, stores a stop
there. It holds the lock only while it stores, so no client waits for the answer to another, or for ever. The owner
looks there first and refuses everything that is not a stop (shm/commands.py has the list). A stop ends what was asked
before it: a command that `expires` (shm/mailbox/command_row.py) is refused when it was sent before a stop, by any
sender, that the owner has taken. All stamps of sending are of one clock; one that is in the owner's future counts as
now. A bridge stamps a message of a client with the earliest time at which it may have been sent; so what follows a
stop of the same client in the same place was sent after it, whatever its stamp. A stop of one thing among several (a
robot of io, a setup arm) is about that only.

Recovery. An owner that begins:
  V1  slot of answered + 1 says answered + 1? then its predecessor died between A3 and A4: answered := answered + 1
  V2  the command of `taken` has no whole answer: its predecessor died in N4; it is answered "failed", never run again;
      so is every command that was accepted and, as far as the replies kept tell, has had no other answer since
  V3  `refuse_waiting`: what was queued for its predecessor is refused; a move or a power-on asked of the dead must not
      happen whenever somebody comes back
A client claims a place with a lock that the kernel frees when it dies, and writes down who it is, for those who find
all places taken. Its successor goes on from the cursors; commands past M3 are still run, what the dead one left of M2
is overwritten. The same goes for who dies in the place for stops.

Late. A command that `expires` and has waited longer than LATE_NS is refused (shm/mailbox/guard.py): its owner was
stalled, and its sender does not expect it any more. A stop is carried out however late.

Whose. Each command carries its origin (shm/mailbox/origins.py): the operator's command it comes from. With `guard`,
one that `needs_operator` is refused without, or with one given before the last fault of the owner's component
(shm/mailbox/generations.py). With `audit`, what became of each command is put into a ring.

Trust. The owner runs nothing whose slot was not written for its turn (each command carries its number), and nothing
whose cursor is out of step (sent − taken not in 0 … depth): it takes taken := sent there, runs nothing, and goes on. A
client passes over a place whose cursors make no sense, after pushing `sent` out of step so that the owner puts the
place right; it takes one that is full only when there is no other (one that only looks full stays so until the next
owner).

Memory order: stores M2 → M3, N3 → A1 … A4 and loads N1 → N2, B1 → B2 → B3 in program order (shm/memory/order.py). N3
is stored after the loads of N2: a store is never overtaken by, nor overtakes, an earlier load on x86-64. L1 and L3 are
calls of the kernel, which are full fences.

Nothing here is looked up by name while commands travel: a slot is one `struct` call into the map on
the way in, one copy of the bytes on the way out, with the numbers as a view on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.generations import Cell
from trocar.shm.mailbox.guard import LATE_NS, late, unauthorized
from trocar.shm.mailbox.mailbox_map import (
    CLIENTS,
    COMMAND_START,
    COMMANDS_DEPTH,
    COMMANDS_OF,
    CURSORS,
    MAX_VALUES,
    PLACES,
    REPLIES_DEPTH,
    REPLY_BODY,
    REPLY_START,
    REPLY_TEXT,
    RESERVED,
    STAMP_AND_NUMBER,
    VALUES_IN_RAW,
    MailboxMap,
)
from trocar.shm.mailbox.received import ACCEPTED, FAILED, OUTCOMES, REFUSED, CommandHead, Received
from trocar.shm.memory.holders import Holder
from trocar.shm.memory.layout import shorten
from trocar.shm.memory.locks import Places
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns

PER_CYCLE = 8
MAX_STOPS = 64  # about different things that are remembered apart
MAX_HEADS = 64  # of streams that are remembered: all but the stamp, the number and the values of their commands
DIED = "its process died meanwhile; it may have been carried out; it will not be repeated"

SHORT = 8  # values that come with the first copy
FLOAT, NDARRAY = np.dtype(np.float64), np.ndarray
NO_VALUES = np.frombuffer(b"", np.float64)
NEVER = -(1 << 63)
LAST_NUMBER = 1 << 62  # no honest cursor gets there
CURSOR_BITS = tuple((2**64 - 1) << 64 * place for place in range(PLACES))
NO_COUNTS = bytes(8 * PLACES)
NOTHING: Iterator[Received] = iter(())
HEAD = slice(STAMP_AND_NUMBER.size, VALUES_IN_RAW)


class Mailbox:
    """The owner's end. `resets` counts places that were out of step and have been put right."""

    def __init__(self, system: str, instance: str, rows: Sequence[CommandRow], *, guard: Cell | None = None,
                 audit: Audit | None = None, died: str = DIED) -> None:
        """Claim the mailbox of `instance`, whose kind has these commands; SegmentError if it lists other ones.

        `guard`: refuse commands that need an operator unless given after this cell's last fault. `audit`: the ring for
        outcomes. `died` answers commands that were under way (V2).
        """
        places = MailboxMap(system, instance)
        self._segment = segment = places.segment
        try:
            if [row.name for row in (*rows, *places.own)] != [row.name for row in places.table]:
                raise SegmentError(f"{segment.name}: its commands are not those of this program; both must be of the "
                                   "same version")
            segment.claim(instance)
        except BaseException:
            segment.close()
            raise
        self._locks = Places(segment, places.locks, CLIENTS)
        self._guard, self.audit = guard, audit
        self._map, self._table = places, (*rows, *places.own)
        self._known: dict[bytes, CommandHead] = {}
        self._stops: dict[str, tuple[int, Holder, str, tuple[int, int]]] = {}
        """By subject: when, by whom and for whom the newest stop was sent, and its place and peer."""
        self._stopped_ns = NEVER  # the newest of them
        self._stops_taken = NO_COUNTS[-8:]  # of the place for stops
        self._view, self._words = places.view, places.words
        self._sent_bytes = segment.keep(places.view[places.first : places.first + len(NO_COUNTS)])
        self._sent, self._taken_at, self._answered_at = (places.cursors(c) for c in CURSORS[:3])
        self._taken = [self._words[i] for i in self._taken_at]
        self._answered = [self._words[i] for i in self._answered_at]
        self._slots = tuple(places.commands(p) for p in range(PLACES))
        short = COMMANDS_OF[SHORT].size
        self._heads = tuple(tuple(segment.keep(places.view[at + COMMAND_START : at + COMMAND_START + short])
                                  for at in slots) for slots in self._slots)
        self._replies = tuple(places.replies(p) for p in range(PLACES))
        self._seen, self._seen_cursors, self._backlog = NO_COUNTS, 0, sum(CURSOR_BITS)
        self._last = self.resets = self._now_ns = 0
        for place in range(PLACES):
            self._recover(place, died)

    def _recover(self, place: int, died: str) -> None:
        """Resume where the predecessor stopped."""
        words, taken, answered = self._words, self._taken[place], self._last_answer(place)
        if words[self._replies[place][(answered + 1) % REPLIES_DEPTH] >> 3] == answered + 1:  # V1
            answered += 1
        self._answered[place] = words[self._answered_at[place]] = answered
        if 0 <= words[self._sent[place]] - taken <= COMMANDS_DEPTH:
            for number in self._unfinished(place, taken):
                self.answer(place, number, FAILED, died)  # V2
        else:
            self._put_right(place)

    def _last_answer(self, place: int) -> int:
        """Number of the last answer; 0, to restart, if the slot of that number has another one."""
        answered = self._answered[place]
        at = self._replies[place][answered % REPLIES_DEPTH]
        return answered if answered < LAST_NUMBER and self._words[at >> 3] == answered else 0

    def _unfinished(self, place: int, taken: int) -> list[int]:
        """Commands whose last whole answer is "accepted", and `taken` without any; the oldest may be torn (A2)."""
        last: dict[int, int] = {}
        end = self._answered[place]
        for n in range(max(1, end - REPLIES_DEPTH + 1), end + 1):
            at = self._replies[place][n % REPLIES_DEPTH]
            number, outcome, _ = REPLY_BODY.unpack_from(self._view, at + REPLY_START)
            if self._words[at >> 3] == n:
                last[number] = outcome
        if taken:
            last.setdefault(taken, ACCEPTED)
        return [number for number, outcome in last.items() if outcome == ACCEPTED]

    def drain(self, now_ns: int = 0) -> Iterator[Received]:
        """Commands received, in each client's order, at most 8 a client; unknown ones are refused here.

        `now_ns`: real monotonic time, for refusing late commands; 0: nothing is late (in lock-step). Answer (or accept)
        each before the next is taken: a successor can answer only the last one taken (V2).
        """
        sent = self._sent_bytes.tobytes()
        if sent == self._seen and not self._backlog:  # N1 for all places at once
            return NOTHING
        self._now_ns = now_ns
        return self._drain(sent)

    @property
    def has_news(self) -> bool:
        """Whether commands have arrived since the last `drain`, or some of them are left."""
        return bool(self._backlog) or self._sent_bytes.tobytes() != self._seen

    def refuse_waiting(self, reason: str) -> None:
        """Refuse all commands received before now: a restarted owner must not act on its predecessor's commands."""
        for _ in range(COMMANDS_DEPTH // PER_CYCLE):
            for command in self.drain():
                command.refuse(reason)

    def _drain(self, sent: bytes) -> Iterator[Received]:
        """Serve all places whose cursors have moved: first the place for stops, then the latest one.

        A place stays in the backlog until no command waits in it, also when the caller leaves the loop early.
        """
        if not sent.endswith(self._stops_taken):
            yield from self._serve(RESERVED)
            self._stops_taken = self._taken[RESERVED].to_bytes(8, "little")
        first, words = self._last, self._words
        n = self._taken[first] + 1
        if words[self._sent[first]] == n:  # one command, as usual
            received = self._take(first, n)
            if received is not None:
                yield received
        else:
            yield from self._serve(first)
        cursors = int.from_bytes(sent, "little")
        changed = cursors ^ self._seen_cursors | self._backlog
        self._seen, self._seen_cursors, self._backlog = sent, cursors, changed
        while changed:
            place = (changed & -changed).bit_length() - 1 >> 6
            changed &= ~CURSOR_BITS[place]
            if place != first:
                yield from self._serve(place)
            waiting = words[self._sent[place]] - self._taken[place]
            if not 0 <= waiting <= COMMANDS_DEPTH:
                self._put_right(place)
                waiting = 0
            if not waiting:
                self._backlog &= ~CURSOR_BITS[place]

    def _serve(self, place: int) -> Iterator[Received]:
        taken = self._taken[place]
        waiting = self._words[self._sent[place]] - taken
        if 0 < waiting <= COMMANDS_DEPTH:
            self._last = place
            for n in range(taken + 1, taken + 1 + min(waiting, PER_CYCLE)):
                received = self._take(place, n)
                if received is not None:
                    yield received

    def _put_right(self, place: int) -> None:
        """The cursors of a place are out of step: nothing in its queue can be believed, nothing of it is run."""
        sent = self._words[self._sent[place]]
        if sent >= LAST_NUMBER:
            sent = 0  # its next client moves its own cursor
        self._taken[place] = self._words[self._taken_at[place]] = sent
        self._answered[place] = self._words[self._answered_at[place]] = self._last_answer(place)
        self.resets += 1

    def _take(self, place: int, n: int) -> Received | None:
        slot = n % COMMANDS_DEPTH
        raw = self._heads[place][slot].tobytes()  # N2
        sent_ns, number = STAMP_AND_NUMBER.unpack_from(raw)
        head = self._known.get(raw[HEAD]) or self._learn(raw)
        count, command = head.count, head.command
        if SHORT < count <= MAX_VALUES:
            at = self._slots[place][slot] + COMMAND_START
            raw = raw[:VALUES_IN_RAW] + self._view[at + VALUES_IN_RAW : at + VALUES_IN_RAW + 8 * count].tobytes()
        self._taken[place] = self._words[self._taken_at[place]] = n  # N3
        if number == n and command is not None and count <= MAX_VALUES:
            values = NDARRAY(head.shape, FLOAT, raw, VALUES_IN_RAW) if count else NO_VALUES
            received, guard = Received(self, place, command, head, number, sent_ns, values), self._guard
            if (not command.stops and place != RESERVED
                    and sent_ns >= self._stopped_ns and self._now_ns - sent_ns <= LATE_NS
                    and (guard is None or (head.origin_id and head.generation >= guard.valid_from))):
                return received
            objection = self._stopped(received) or self._guarded(received, self._now_ns - sent_ns)
            if not objection:
                return received
            received.refuse(objection)
            return None
        wrong = f"command {head.code} is not in the table"
        if number != n:  # not written for this turn: never run an old command again
            wrong = f"the slot of command {n} holds command {number}"
        elif count > MAX_VALUES:
            wrong = f"{count} values; allowed are {MAX_VALUES}"
        self.answer(place, n, REFUSED, wrong)
        return None

    def _learn(self, raw: bytes) -> CommandHead:
        if len(self._known) >= MAX_HEADS:
            self._known.clear()
        head = self._known[raw[HEAD]] = CommandHead(raw, self._table)
        return head

    def _guarded(self, received: Received, waited_ns: int) -> str:
        row, text, values = received.command, received.text, received.values
        return late(row, text, values, waited_ns) or unauthorized(row, text, values, received.origin, self._guard)

    def _stopped(self, received: Received) -> str:
        """Why a stop voids this command; empty: it is a stop itself, or no stop concerns it."""
        command, text, values = received.command, received.text, received.values
        if command.is_stop(text, values):
            self._note_stop(command.about(text), min(received.sent_ns, monotonic_ns()), received)
            return ""
        if received.place == RESERVED:
            return f"{command.name}: this mailbox slot accepts only stop commands"
        if not command.expires(text, values):
            return ""
        for about in ("", command.about(text)):
            stop = self._stops.get(about)
            # behind the stop in the same place: sent after it, whatever the time of a message that a bridge has found
            if stop is not None and received.sent_ns < stop[0] and (received.place, received.peer) != stop[3]:
                return f"stopped by {stop[1].reported(stop[2])}"
        return ""

    def _note_stop(self, about: str, sent_ns: int, received: Received) -> None:
        """Refuse commands sent before this stop from now on, see above."""
        if len(self._stops) >= MAX_STOPS:  # not all of these are things: from now on it is about all there is
            self._stops, about, sent_ns = {}, "", max(sent_ns, self._stopped_ns)
        known = self._stops.get(about)
        if known is None or known[0] < sent_ns:
            by = received.place, received.peer
            self._stops[about] = sent_ns, self.holder(received.place), received.origin.program, by
            self._stopped_ns = max(self._stopped_ns, sent_ns)

    def holder(self, place: int) -> Holder:
        """The holder of a place, as it reported itself."""
        return self._map.holder(place)

    def home_of(self, place: int) -> int:
        """The place of the program that sent through this one: a different one only for the place for stops."""
        if place != RESERVED:
            return place
        who = self.holder(place)
        return next((other for other in range(CLIENTS) if self.holder(other) == who and self.has_client(other)), place)

    def has_client(self, place: int) -> bool:
        """Whether a place has a live client (makes a system call: not for loops of the robot)."""
        return self._locks.is_taken(place)

    def reply(self, received: Received, outcome: int, text: str) -> None:
        """Answer a command, and write its outcome to the audit ring."""
        self.answer(received.place, received.id, outcome, text)
        if self.audit is not None:
            self.audit.write(received, OUTCOMES[outcome], text)

    def answer(self, place: int, number: int, outcome: int, text: str) -> None:
        """Write a reply; the oldest is overwritten when a client does not read its replies."""
        words = self._words
        n = self._answered[place] + 1
        at = self._replies[place][n % REPLIES_DEPTH]
        words[at >> 3] = 0  # A1
        REPLY_BODY.pack_into(self._view, at + REPLY_START, number, outcome, shorten(text, REPLY_TEXT))  # A2
        words[at >> 3] = n  # A3
        self._answered[place] = words[self._answered_at[place]] = n  # A4

    def close(self) -> None:
        """Release the claim."""
        self._segment.close()
