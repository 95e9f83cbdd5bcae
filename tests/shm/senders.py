"""The victims of kills.py that end at a mailbox, and what must hold when one has died: a client, and the owner.

Every command carries who sent it and its count; all its values follow from these two, and so does its text.
"""

from __future__ import annotations

import mmap
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from tests.shm.witness import Notes, RingViolation, holds
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox import Mailbox, Received
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMANDS_DEPTH, create_mailbox
from trocar.shm.mailbox.place import MailboxFull, Place, Reply, StopPlace, take_place
from trocar.shm.memory.segment import Segment, segment_name

COMMAND, STOP = "bias_encoders", "servo_zero"
SIZES = 13  # longest command: more values than come with the owner's first copy
UNDER_WAY = COMMANDS_DEPTH - 1  # of each client: all their answers fit in the reply ring
EVERY = 25  # deaths from one look at all places to the next
JUST_STARTED = "just started"
PATIENT = 60_000  # ms


def values(sender: int, count: int) -> list[float]:
    """All that a command carries."""
    return [sender, count, *(sender * 31 + count * 7 + j for j in range(count % SIZES))]


def judged(got: Received, name: str = COMMAND) -> tuple[int, int]:
    """(sender, count) of a command; Violation when it is not whole."""
    numbers = got.values.tolist()
    if len(numbers) < 2:
        raise RingViolation(f"command {got.id} is torn: {numbers}")
    sender, count = int(numbers[0]), int(numbers[1])
    if got.name != name or numbers != values(sender, count) or got.text != f"{sender}:{count}":
        raise RingViolation(f"command {got.id} is torn: {got.name} {numbers} {got.text!r}")
    return sender, count


def send(client: Place, sender: int, count: int) -> int:
    """The command `count` of `sender`; its id."""
    return client.send(COMMAND, values(sender, count), f"{sender}:{count}")


def claim_all(system: str, taken: int) -> None:
    """All places but those taken can be had at once; else SegmentError."""
    clients = [take_place(system, "io") for _ in range(CLIENTS - taken)]
    for client in clients:
        client.close()


class ClientVictim:
    """A mailbox's client dies; its owner, and another client, live on in the parent."""

    SENT, ID, ANSWERED = range(Notes.FREE, Notes.FREE + 3)
    NEIGHBOUR = 0

    def __init__(self, system: str, notes: Notes) -> None:
        create_mailbox(system, "io", "io", COMMANDS["io"])
        self._system, self._notes = system, notes.words
        self._box, self._neighbour = Mailbox(system, "io", COMMANDS["io"]), take_place(system, "io")
        self._life = self._ran = self._id = self._own_sent = self._own_ran = 0
        self.figures = {"sent": 0, "ran": 0, "died_unrecorded": 0, "answers_seen": 0, "neighbour_ran": 0}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Send and poll for ever; the answers come in the order sent, each once."""
        client, notes, sent, answered = take_place(self._system, "io"), self._notes, 0, 0
        ready()
        while True:
            if sent - answered < UNDER_WAY + 8:  # more than fit: MailboxFull is part of it
                try:
                    notes[self.ID] = send(client, life, sent + 1)
                    notes[self.SENT] = sent = sent + 1
                except MailboxFull:
                    pass
            for reply in client.poll():
                if reply.text.split(":")[0] == str(life):  # else to what its predecessor sent
                    answered += 1
                    holds(reply.text == f"{life}:{answered}", f"answer {answered} is {reply}")
            holds(not client.lost, f"{client.lost} answers were overwritten")
            notes[self.ANSWERED] = answered

    def serve(self) -> None:
        """Run what came in; the neighbour sends and polls as well."""
        for got in self._box.drain():
            sender, count = judged(got)
            if sender == self.NEIGHBOUR:
                self._own_ran += 1
                holds(count == self._own_ran, f"the neighbour's command {count} ran as its {self._own_ran}th")
            else:
                self._run(got, sender, count)
            got.done(got.text)
        if self._own_sent == self._own_ran:
            self._own_sent += 1
            send(self._neighbour, self.NEIGHBOUR, self._own_sent)
        self._neighbour.poll()

    def _run(self, got: Received, sender: int, count: int) -> None:
        if sender != self._life:
            self._life, self._ran = sender, 0
        self._ran += 1
        holds(count == self._ran, f"command {count} of life {sender} ran as its {self._ran}th")
        holds(got.id == self._id + 1, f"command {sender}:{count} has id {got.id} after {self._id}")
        self._id = got.id
        self.figures["ran"] += 1

    def inspect(self, life: int, pid: int) -> None:
        """Every command whose `send` returned ran once, at most one more had been stored; the place is free."""
        for _ in range(2 + (COMMANDS_DEPTH + 2) // 8):
            self.serve()
        sent, ran = self._notes[self.SENT], self._ran if self._life == life else 0
        holds(ran in (sent, sent + 1), f"{sent} commands were sent, {ran} ran")
        if sent and ran == sent:
            number = self._notes[self.ID]  # noted before SENT
            holds(number in (self._id, self._id + 1), f"sent as {number}, ran as {self._id}")
        holds(not self._box.resets, "the owner found cursors out of step")
        self.figures["sent"] += sent
        self.figures["died_unrecorded"] += ran - sent
        self.figures["answers_seen"] += self._notes[self.ANSWERED]
        self.figures["neighbour_ran"] = self._own_ran
        if life % EVERY == 0:
            claim_all(self._system, taken=1)

    def finish(self) -> None:
        """All places can be had again; something has run."""
        claim_all(self._system, taken=1)
        holds(self.figures["ran"] and self._own_ran, "nothing has run")
        self._neighbour.close()
        self._box.close()


class StopVictim:
    """Who stops dies in the place for stops; its owner, and another who stops, live on in the parent."""

    SENT, ANSWERED = range(Notes.FREE, Notes.FREE + 2)
    NEIGHBOUR = 0

    def __init__(self, system: str, notes: Notes) -> None:
        create_mailbox(system, "io", "io", COMMANDS["io"])
        self._system, self._notes = system, notes.words
        self._box, self._neighbour = Mailbox(system, "io", COMMANDS["io"]), StopPlace(system, "io", "neighbour")
        self._life = self._ran = self._id = self._own_sent = self._own_ran = self._own_answered = 0
        self.figures = {"sent": 0, "ran": 0, "died_unrecorded": 0, "answers_seen": 0, "neighbour_ran": 0}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Stop for ever, some at a time; the answers come in the order sent, each once.

        The neighbour's go through the same ring, which comes round when we are without a core: we begin anew then.
        """
        stops, notes, sent, answered = StopPlace(self._system, "io", f"life {life}"), self._notes, 0, 0
        ready()
        while True:
            if sent - answered < 4:
                try:
                    stops.stop(STOP, values(life, sent + 1), f"{life}:{sent + 1}")
                    notes[self.SENT] = sent = sent + 1
                except MailboxFull:
                    pass
            for reply in stops.answers():
                count = int(reply.text.removeprefix(f"{life}:"))
                follows = answered < count <= sent if stops.lost else count == answered + 1
                holds(follows, f"answer {count} of {sent} came after {answered}; {stops.lost} were overwritten")
                answered = count
            notes[self.ANSWERED] = answered
            if stops.lost:
                stops.close()
                stops, answered = StopPlace(self._system, "io", f"life {life}"), sent

    def serve(self) -> None:
        """Run what came in; the neighbour stops something as well, and is never kept out."""
        for got in self._box.drain():
            sender, count = judged(got, STOP)
            holds(got.id == self._id + 1, f"stop {sender}:{count} has id {got.id} after {self._id}")
            self._id = got.id
            if sender == self.NEIGHBOUR:
                self._own_ran += 1
                holds(count == self._own_ran, f"the neighbour's stop {count} ran as its {self._own_ran}th")
            else:
                self._run(sender, count)
            got.done(got.text)
        for reply in self._neighbour.answers():
            self._own_answered += 1
            holds(reply.text == f"{self.NEIGHBOUR}:{self._own_answered}", f"the neighbour was told {reply}")
        if self._own_sent == self._own_answered:
            self._own_sent += 1
            text = f"{self.NEIGHBOUR}:{self._own_sent}"
            # whoever is in the place may be short of a core, and is not killed before we return
            self._neighbour.stop(STOP, values(self.NEIGHBOUR, self._own_sent), text, tries=PATIENT)

    def _run(self, sender: int, count: int) -> None:
        if sender != self._life:
            self._life, self._ran = sender, 0
        self._ran += 1
        holds(count == self._ran, f"stop {count} of life {sender} ran as its {self._ran}th")
        self.figures["ran"] += 1

    def inspect(self, life: int, pid: int) -> None:
        """Every stop whose sending returned ran once, at most one more had been stored; the place is free."""
        for _ in range(2 + (COMMANDS_DEPTH + 2) // 8):
            self.serve()
        sent, ran = self._notes[self.SENT], self._ran if self._life == life else 0
        holds(ran in (sent, sent + 1), f"{sent} stops were sent, {ran} ran")
        holds(not self._box.resets, "the owner found cursors out of step")
        self.figures["sent"] += sent
        self.figures["died_unrecorded"] += ran - sent
        self.figures["answers_seen"] += self._notes[self.ANSWERED]
        self.figures["neighbour_ran"] = self._own_ran

    def finish(self) -> None:
        """Something has run."""
        holds(self.figures["ran"] and self._own_ran, "nothing has run")
        self._neighbour.close()
        self._box.close()


@dataclass(slots=True)
class Pending:
    """A command without its last answer."""

    id: int
    count: int
    accepted: bool = False


class Account:
    """What one client of a dying owner has sent, and what became of each command; `runs` is filled by the owners."""

    SPAN = 1 << 14  # commands of which the runs are known

    def __init__(self, client: Place, sender: int, runs: memoryview) -> None:
        self.client, self._sender, self._runs = client, sender, runs
        self._pending: deque[Pending] = deque()
        self._sent = 0
        self._over: deque[tuple[int, int]] = deque()  # (count, runs when it was answered), to be looked at again
        self.outcomes = {"done": 0, "refused": 0, "failed": 0, "failed_after_run": 0, "failed_after_accept": 0}

    @property
    def waiting(self) -> int:
        """Commands without their last answer."""
        return len(self._pending)

    def send(self) -> None:
        """One command more, unless many are under way or the queue is full."""
        if len(self._pending) >= UNDER_WAY:
            return
        self._runs[(self._sent + 1) % self.SPAN] = 0
        try:
            number = send(self.client, self._sender, self._sent + 1)
        except MailboxFull:
            return
        self._sent += 1
        self._pending.append(Pending(number, self._sent))

    def poll(self) -> None:
        """Every command gets one last answer, in the order sent, and it is true."""
        for reply in self.client.poll():
            holds(self._pending, f"an answer to what has its last already: {reply}")
            first = self._pending[0]
            holds(reply.id == first.id, f"an answer to {reply.id} where {first.id} was due: {reply}")
            if reply.outcome == "accepted":
                holds(not first.accepted, f"accepted twice: {reply}")
                first.accepted = True
            else:
                self._judge(self._pending.popleft(), reply)
        holds(not self.client.lost, f"{self.client.lost} answers were overwritten")

    def _judge(self, command: Pending, reply: Reply) -> None:
        runs = self._runs[command.count % self.SPAN]
        fits = {"done": runs == 1, "refused": runs == 0, "failed": runs <= 1}
        holds(fits.get(reply.outcome), f"command {self._sender}:{command.count} ran {runs} times and was {reply}")
        self.outcomes[reply.outcome] += 1
        self.outcomes["failed_after_run"] += reply.outcome == "failed" and runs == 1
        self.outcomes["failed_after_accept"] += reply.outcome == "failed" and command.accepted
        self._over.append((command.count, runs))
        if len(self._over) > self.SPAN // 2:
            self.look_again()

    def look_again(self) -> None:
        """What was answered has not run since."""
        for count, runs in self._over:
            now = self._runs[count % self.SPAN]
            holds(now == runs, f"command {self._sender}:{count} ran {now - runs} times after its last answer")
        self._over.clear()


class OwnerVictim:
    """A mailbox's owner dies; two clients live on in the parent."""

    EPOCH = Notes.FREE

    def __init__(self, system: str, notes: Notes) -> None:
        create_mailbox(system, "io", "io", COMMANDS["io"])
        self._system, self._notes, self._epoch = system, notes.words, 0
        self._segment = Segment(segment_name(system, "io", "mailbox"))
        self._runs = memoryview(mmap.mmap(-1, 2 * Account.SPAN))
        self._clients = [take_place(system, "io") for _ in range(2)]
        halves = (self._runs[: Account.SPAN], self._runs[Account.SPAN :])
        self._accounts = [Account(client, i, halves[i]) for i, client in enumerate(self._clients)]

    @property
    def figures(self) -> dict[str, int]:
        """Of the whole run."""
        both = [account.outcomes for account in self._accounts]
        return {**{key: sum(o[key] for o in both) for key in both[0]}, "claims": self._epoch}

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """Claim, refuse what waits (every other life), and run for ever."""
        box = Mailbox(self._system, "io", COMMANDS["io"])
        if life % 2:
            box.refuse_waiting(JUST_STARTED)
        ready()
        while True:
            for got in box.drain():
                self._run(got)

    def _run(self, got: Received) -> None:
        sender, count = judged(got)
        if count % 7 == 6:
            got.refuse("not this one")
            return
        if count % 7 == 5:
            got.accept()
        self._runs[sender * Account.SPAN + count % Account.SPAN] += 1  # this is what it does
        got.done()

    def serve(self) -> None:
        """Both clients send and poll."""
        for account in self._accounts:
            account.send()
            account.poll()

    def inspect(self, life: int, pid: int) -> None:
        """The claim is free, answers are in order; what is under way is the successor's to answer."""
        holds(not self._segment.claimed(), "the claim of the dead is not free")
        identity = self._segment.identity()
        holds(identity.epoch == self._epoch + (identity.pid == pid), f"epoch {identity.epoch} after {self._epoch}")
        self._epoch = identity.epoch
        for account in self._accounts:
            account.poll()
            for _ in range(life % 40):  # the queue may be full when the successor comes
                account.send()

    def finish(self) -> None:
        """The last successor answers everything."""
        box = Mailbox(self._system, "io", COMMANDS["io"])
        for _ in range(2 * COMMANDS_DEPTH):
            for got in box.drain():
                self._run(got)
        for account in self._accounts:
            account.poll()
            account.look_again()
            holds(not account.waiting, f"{account.waiting} commands were never answered")
            holds(all(account.outcomes[o] for o in ("done", "refused")), f"not all outcomes came: {account.outcomes}")
        holds(not box.resets, "the owner found cursors out of step")
        for end in (box, *self._clients, self._segment):
            end.close()
