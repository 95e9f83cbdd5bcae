"""A hostile client, or whole hostile processes, write into a live mailbox: the others are served as if nothing were."""

from __future__ import annotations

import contextlib
import itertools
import os

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from tests.examples import examples
from tests.shm.memory.test_hostile import bounded
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import mailbox as m
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMAND_SCHEMA, MAX_VALUES, REPLY_SCHEMA, MailboxMap, create_mailbox
from trocar.shm.mailbox.place import MailboxFull, Place, take_place
from trocar.shm.memory.segment import SegmentError, segment_name, unlink

SYSTEM = f"tbox{os.getpid()}"
COUNTER = itertools.count()
ODD = st.one_of(
    st.sampled_from([0, 1, 31, 32, 33, 64, 65, 2**31, 2**62 - 1, 2**62, 2**63, 2**64 - 1]), st.integers(0, 2**64 - 1)
)
CURSORS = st.sampled_from(m.CURSORS[:3])


class OneBadClient(RuleBasedStateMachine):
    """One client writes anything into its own place; two others are good, and nothing of theirs is lost."""

    @initialize()
    def make(self) -> None:
        self.instance = f"IO{next(COUNTER)}"
        create_mailbox(SYSTEM, self.instance, "io", COMMANDS["io"])
        self.owner = Mailbox(SYSTEM, self.instance, COMMANDS["io"])
        self.bad = take_place(SYSTEM, self.instance)
        self.good = [take_place(SYSTEM, self.instance) for _ in range(2)]
        self.sent: list[list[int]] = [[], []]
        self.run: list[list[int]] = [[], []]
        self.answers: list[list[int]] = [[], []]
        self.serial = itertools.count(1)

    @rule(which=CURSORS, value=ODD)
    def bad_cursor(self, which: str, value: int) -> None:
        self.bad._words[self.bad._map.cursor(which, 0)] = value

    @rule(slot=st.integers(0, m.COMMANDS_DEPTH - 1), at=st.integers(0, 600), data=st.binary(min_size=1, max_size=80))
    def bad_command(self, slot: int, at: int, data: bytes) -> None:
        begin = self.bad._queue[slot] + at % COMMAND_SCHEMA.stride
        self.put(begin, data, self.bad._queue[slot] + COMMAND_SCHEMA.stride)

    @rule(slot=st.integers(0, m.REPLIES_DEPTH - 1), at=st.integers(0, 255), data=st.binary(min_size=1, max_size=80))
    def bad_reply(self, slot: int, at: int, data: bytes) -> None:
        begin = self.bad._replies[slot] + at % REPLY_SCHEMA.stride
        self.put(begin, data, self.bad._replies[slot] + REPLY_SCHEMA.stride)

    def put(self, begin: int, data: bytes, end: int) -> None:
        data = data[: end - begin]
        self.bad._view[begin : begin + len(data)] = data

    @rule()
    def bad_sends_and_polls(self) -> None:
        with bounded(), contextlib.suppress(MailboxFull):
            self.bad.send("power_off", (666,), "bad")
            assert all(reply.outcome and isinstance(reply.text, str) for reply in self.bad.poll())

    @rule(which=st.integers(0, 1), count=st.integers(1, 12))
    def good_sends(self, which: int, count: int) -> None:
        for _ in range(count):
            serial = next(self.serial)
            try:
                self.good[which].send("power_off", (serial,), f"good {which}")
            except MailboxFull:
                assert len(self.sent[which]) - len(self.run[which]) == m.COMMANDS_DEPTH
                return
            self.sent[which].append(serial)

    @rule()
    def drain(self) -> None:
        with bounded():
            for count, got in enumerate(self.owner.drain()):
                assert count < 3 * m.PER_CYCLE
                assert got.values.size <= MAX_VALUES and got.name
                if got.text in ("good 0", "good 1") and got.place:
                    which = int(got.text[-1])
                    self.run[which].append(int(got.values[0]))
                    got.done(str(self.run[which][-1]))
                else:
                    assert got.place == 0
                    got.refuse("bad")
        for which, client in enumerate(self.good):
            assert self.run[which] == self.sent[which][: len(self.run[which])]
            replies = client.poll()
            assert all(reply.outcome == "done" for reply in replies) and client.lost == 0
            self.answers[which] += [int(reply.text) for reply in replies]
            assert self.answers[which] == self.run[which]

    @rule()
    def replace_owner(self) -> None:
        self.owner.close()
        with bounded():
            self.owner = Mailbox(SYSTEM, self.instance, COMMANDS["io"])
            self.drain()

    @rule()
    def replace_bad(self) -> None:
        """It goes, and the place is used again as soon as the owner has looked."""
        waiting = self.bad._words[self.bad._sent] - self.bad._words[self.bad._taken]
        self.bad.close()
        if waiting == m.COMMANDS_DEPTH:  # a place that only looks full stays so until the next owner
            self.replace_owner()
        for _ in range(m.COMMANDS_DEPTH // m.PER_CYCLE + 1):
            with contextlib.closing(take_place(SYSTEM, self.instance)):
                self.drain()
        self.bad = take_place(SYSTEM, self.instance)
        assert self.bad._sent == self.bad._map.cursor("sent", 0)
        self.bad.poll()
        number = self.bad.send("power_off", (7,), "heir")
        got = [c for _ in range(6) for c in self.owner.drain()]
        ours = [c for c in got if c.place == 0 and c.text == "heir"]
        assert [c.id for c in ours] == [number] and ours[0].values.tolist() == [7.0]
        ours[0].done("it was")
        assert ("done", "it was") in [(r.outcome, r.text) for r in self.bad.poll()]
        for c in got:
            if c.place:
                self.run[int(c.text[-1])].append(int(c.values[0]))
                c.done(str(int(c.values[0])))
        self.drain()

    def teardown(self) -> None:
        try:
            for _ in range(6):
                self.drain()
            assert self.run == self.sent
        finally:
            for part in (self.owner, self.bad, *self.good):
                part.close()
            unlink(segment_name(SYSTEM, self.instance, "mailbox"))


def test_who_believed_a_false_cursor_still_gets_its_answers() -> None:
    instance = f"IO{next(COUNTER)}"
    create_mailbox(SYSTEM, instance, "io", COMMANDS["io"])
    with contextlib.closing(take_place(SYSTEM, instance)) as bad:
        with contextlib.closing(Mailbox(SYSTEM, instance, COMMANDS["io"])) as owner:
            for _ in range(40):
                bad.send("power_off")
                for got in owner.drain():
                    got.done("to the one before")
        answered = bad._map.cursor("answered", 0)
        bad._words[answered] = 0  # where the next owner goes on
        owner = Mailbox(SYSTEM, instance, COMMANDS["io"])
        bad._words[answered] = 31  # there is an answer of that number
    with contextlib.closing(owner), contextlib.closing(take_place(SYSTEM, instance)) as heir:
        number = heir.send("power_off")
        for got in owner.drain():
            got.done("ours")
        reply = heir.poll()[-1]
        assert (reply.id, reply.text) == (number, "ours")
    unlink(segment_name(SYSTEM, instance, "mailbox"))


TestOneBadClient = OneBadClient.TestCase
TestOneBadClient.settings = examples(24, stateful_step_count=40)


class NobodyIsSpared(RuleBasedStateMachine):
    """Somebody writes anywhere in the segment: afterwards every place works again."""

    @initialize()
    def make(self) -> None:
        self.instance = f"IO{next(COUNTER)}"
        create_mailbox(SYSTEM, self.instance, "io", COMMANDS["io"])
        self.owner = Mailbox(SYSTEM, self.instance, COMMANDS["io"])
        self.hand = MailboxMap(SYSTEM, self.instance)
        self.first = self.hand.first - 16
        self.good_header = self.hand.view[: self.first].tobytes()
        self.clients = [take_place(SYSTEM, self.instance) for _ in range(3)]

    @rule(at=st.integers(64, 1 << 20), data=st.binary(min_size=1, max_size=300))
    def scribble(self, at: int, data: bytes) -> None:
        begin = 64 + (at - 64) % (len(self.hand.view) - 64)
        data = data[: len(self.hand.view) - begin]
        self.hand.view[begin : begin + len(data)] = data
        self.hand.view[256 : self.first] = self.good_header[256:]

    @rule(which=CURSORS, place=st.integers(0, CLIENTS - 1), value=ODD)
    def cursor(self, which: str, place: int, value: int) -> None:
        self.hand.words[self.hand.cursor(which, place)] = value

    @rule(which=st.integers(0, 2), count=st.integers(1, 40))
    def send(self, which: int, count: int) -> None:
        with bounded(), contextlib.suppress(MailboxFull):
            for _ in range(count):
                self.clients[which].send("power_off", (1,))

    @rule(which=st.integers(0, 2))
    def poll(self, which: int) -> None:
        with bounded():
            before = self.clients[which].lost
            assert len(self.clients[which].poll()) <= m.REPLIES_DEPTH and self.clients[which].lost >= before

    @rule()
    def drain(self) -> None:
        with bounded():
            for count, got in enumerate(self.owner.drain()):
                assert count < CLIENTS * m.PER_CYCLE
                got.accept()
                got.done(got.text)
            assert self.owner.resets >= 0

    @rule()
    def replace_owner(self) -> None:
        self.owner.close()
        with bounded():
            self.owner = Mailbox(SYSTEM, self.instance, COMMANDS["io"])
            self.owner.refuse_waiting("just started")

    @rule(which=st.integers(0, 2))
    def replace_client(self, which: int) -> None:
        self.clients[which].close()
        self.drain()
        with bounded():
            self.clients[which] = take_place(SYSTEM, self.instance)

    def teardown(self) -> None:
        for client in self.clients:
            client.close()
        try:
            for _ in range(m.COMMANDS_DEPTH // m.PER_CYCLE + 1):
                self.drain()
            self.clients = self.everybody()
            assert len(self.clients) == CLIENTS
            for client in self.clients:
                self.try_out(client)
        finally:
            for part in (self.owner, self.hand.segment, *self.clients):
                part.close()
            unlink(segment_name(SYSTEM, self.instance, "mailbox"))

    def try_out(self, client: Place) -> None:
        """One command there and its answer back."""
        client.poll()
        try:
            number = client.send("power_off", (3,), "mine")
        except MailboxFull:  # it looks full and is not, which the next owner puts right
            self.replace_owner()
            client.poll()
            number = client.send("power_off", (3,), "mine")
        (got,) = [c for _ in range(5) for c in self.owner.drain()]
        assert (got.id, got.text, got.values.tolist()) == (number, "mine", [3.0])
        got.done("fine")
        reply = client.poll()[-1]  # a cursor put back may show it what its predecessor was told
        assert (reply.id, reply.outcome, reply.text) == (number, "done", "fine")

    def everybody(self) -> list[Place]:
        """A client in every place; one out of step is passed over, and right when the owner has looked."""
        found: list[Place] = []
        for _ in range(3):
            with contextlib.suppress(SegmentError):
                while True:
                    found.append(take_place(SYSTEM, self.instance))
            self.drain()
        return found


TestNobodyIsSpared = NobodyIsSpared.TestCase
TestNobodyIsSpared.settings = examples(20, stateful_step_count=30)
