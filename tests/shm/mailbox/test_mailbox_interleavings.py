"""The mailbox's real code, owner and client, in every interleaving, with deaths of both; and seeded mutants of it."""

from __future__ import annotations

from typing import Any

import pytest

from tests.shm.interleave import Broken, Explored, Explorer, Outcome
from tests.shm.process import Actor, Address, Program
from tests.shm.simulated import FIRST, Change, Real, private
from trocar.shm.mailbox.mailbox import DIED
from trocar.shm.mailbox.mailbox_map import CURSOR_BYTES, CURSORS

pytestmark = [pytest.mark.slow, pytest.mark.searches]

PLACE_LOCKS = FIRST + 16 + CURSOR_BYTES * CURSORS.index("place")
SOMEBODY = 50  # holds a lock for ever
ONE_REPLY: Change = "mailbox_map", "REPLIES_DEPTH = 2", "REPLIES_DEPTH = 1"
ONE_COMMAND: Change = "mailbox_map", "COMMANDS_DEPTH = 2", "COMMANDS_DEPTH = 1"
TWO_PLACES: Change = "mailbox_map", "CLIENTS = 1", "CLIENTS = 2"
SAYS = {"refused": "no", "failed": DIED[:6]}


def client(real: Real, verbs: str, previous_state: str = "", who: int = 1000, heir: bool = False) -> Program:
    """Sends and polls; without an heir polls for a last time when all is quiet. Command n has the value `who` + n."""

    def run(me: Actor) -> None:
        if previous_state:
            me.after(previous_state)
        sender = real.on(me).sender()
        begin, got = sender._seen, 0
        me.private = lambda: private(sender)

        def poll() -> int:
            replies = sender.poll()
            for reply in replies:
                assert reply.text == (SAYS.get(reply.outcome) or str(reply.id)), f"torn: {reply}"
                me.note("reported", (reply.id, reply.outcome))
            return len(replies)

        for step, verb in enumerate(verbs.split()):  # step: `merge` sees it
            n = sender._count + 1
            if verb == "poll":
                got += poll()
            else:
                me.note("asks", (n, who + n))
                try:
                    assert sender.send("clear_fault", [who + n] * int(verb.removeprefix("send"))) == n
                    me.note("sent", n)
                except real.place.MailboxFull:
                    me.note("full", n)
            me.merge(step)
        if heir:
            return
        me.quiet()
        got += poll()
        assert got + sender.lost == sender._seen - begin, "got + lost is not what was answered"
        me.note("lost", sender.lost)

    return run


def owner(real: Real, rounds: int, previous_state: str = "", refuses: bool = False, numbered: bool = True) -> Program:
    """Runs what comes in, at last when all is quiet; an heir may refuse what it finds. `numbered`: values as ids."""

    def run(me: Actor) -> None:
        if previous_state:
            me.after(previous_state)
        box = real.on(me).owner()
        me.private = lambda: private(box)

        def serve() -> bool:
            some = False
            for got in box.drain():
                some = True
                assert got.values.size, f"torn: {got.id}"
                (value, *same) = got.values.tolist()
                right = value % 1000 == got.id or not numbered
                assert right and all(v == value for v in same), f"torn: {got.id} {got.values}"
                me.note("ran", (got.id, int(value)))
                got.done(str(got.id))
            return some

        if refuses:
            box.refuse_waiting("no")
        for _ in range(rounds):
            serve()
            me.merge()
        me.quiet()
        while serve():
            me.merge()
        assert box.resets == 0, "cursors out of step"

    return run


def judge(outcome: Outcome) -> None:
    """Each command ran once at most, in order, and who sent it was told once what became of it."""
    asked, ran, reported = outcome.all("asks"), outcome.all("ran"), outcome.all("reported")
    assert set(ran) <= set(asked), f"ran {ran}, but asked for were {asked}"
    numbers = [n for n, _ in ran]
    assert numbers == sorted(set(numbers)), f"ran {numbers}"
    known = [n for n, _ in reported]
    assert len(known) == len(set(known)), f"told twice: {reported}"
    for n, what in reported:
        assert n in numbers or what != "done", f"{n} never ran, but was told done"
        assert n not in numbers or what != "refused", f"{n} ran, but was told refused"
    sent, lost = outcome.all("sent"), sum(outcome.all("lost"))
    if outcome.killed in ((), ("client",)):
        assert set(sent) <= set(numbers), f"sent {sent}, ran {numbers}"
    if "second" not in outcome.notes:
        assert len(known) + lost == len(sent) and set(known) <= set(sent), f"sent {sent}, told {reported}, lost {lost}"


def one_more(real: Real, before: dict[Address, int]) -> dict[Address, int]:
    """The memory after one more command was sent, answered, and the answer taken."""
    ends: list[dict[Address, int]] = []
    programs = {"owner": owner(real, 0), "client": client(real, "send1")}
    Explorer(programs, lambda outcome: ends.append(outcome.cells), before=before).explore()
    return ends[0]


def mailbox(real: Real, verbs: str, *, rounds: int = 1, refuses: bool = False, second: str = "", kill: str = "",
            model: str = "tso", place: int = 0, begun: int = 0) -> Explorer:
    """An owner and a client, and heirs of those who are killed.

    Places before `place` are taken by somebody else; `begun` commands have been answered before.
    """
    programs = {"owner": owner(real, rounds)}
    if "owner" in kill.split():
        programs["heir"] = owner(real, rounds, "owner", refuses)
    if "heir" in kill.split():
        programs["last"] = owner(real, rounds, "heir")
    programs["client"] = client(real, verbs, heir=bool(second))
    if second:
        programs["second"] = client(real, second, "client", 2000)
    before = {("lock", PLACE_LOCKS + i): SOMEBODY for i in range(place)}
    for _ in range(begun):
        before = one_more(real, before)
    return Explorer(programs, judge, model=model, kill=kill, before=before)


@pytest.mark.parametrize(("verbs", "rounds", "changes", "outcomes"), [
    ("send1 send1", 1, (), 18), ("send2 poll", 2, (), 13), ("send1 send1 poll", 1, (ONE_REPLY,), 33),
    ("send2 send2", 1, (ONE_COMMAND,), 14),
])
def test_every_command_runs_once_and_is_answered(verbs: str, rounds: int, changes: Any, outcomes: int) -> None:
    assert mailbox(Real(*changes), verbs, rounds=rounds).explore().outcomes == outcomes


def test_a_killed_owner_leaves_nothing_run_twice_or_untold() -> None:
    assert mailbox(Real(), "send1 poll", kill="owner heir").explore().outcomes == 80
    assert mailbox(Real(), "send1", kill="owner", begun=2).explore().outcomes == 23


def test_an_heir_that_refuses_tells_so() -> None:
    assert mailbox(Real(), "send1 poll", kill="owner", refuses=True).explore().outcomes == 33


def test_a_killed_client_leaves_no_half_command() -> None:
    assert mailbox(Real(), "send1", kill="client", second="send1").explore().outcomes == 96


def test_a_backlog_at_another_place_is_served() -> None:
    assert mailbox(Real(TWO_PLACES), "send1 send1", place=1).explore().outcomes == 18


def test_merging_leaves_no_schedule_out() -> None:
    def explored(merging: bool, reducing: bool) -> Explored:
        explorer = mailbox(Real(), "send1 poll", kill="owner")
        explorer.merging, explorer.reducing = merging, reducing
        return explorer.explore()

    merged = explored(True, False)
    assert explored(False, False).schedules == merged.schedules
    assert explored(True, True).outcomes == merged.outcomes


def test_each_of_two_clients_gets_its_own() -> None:
    real = Real(TWO_PLACES)
    programs = {"owner": owner(real, 1), "client": client(real, "send1"), "other": client(real, "send1", who=2000)}
    assert Explorer(programs, judge_two).explore().outcomes == 60


def judge_two(outcome: Outcome) -> None:
    """Each one's commands ran in its order, and each was told of its own."""
    ran = [value for _, value in outcome.all("ran")]
    for who, name in ((1000, "client"), (2000, "other")):
        sent = [note[1] for note in outcome.notes[name] if note[0] == "sent"]
        reported = [note[1] for note in outcome.notes[name] if note[0] == "reported"]
        assert [v - who for v in ran if who < v < who + 1000] == sent, f"{name} sent {sent}, ran {ran}"
        assert reported == [(n, "done") for n in sent], f"{name} sent {sent} and was told {reported}"


@pytest.mark.parametrize(("scenario", "outcomes"), [
    pytest.param({"verbs": "send1 send1", "kill": "client", "second": "send1"}, 278, marks=pytest.mark.soak),
    ({"verbs": "send1", "kill": "owner client", "second": "send1"}, 408),
    ({"verbs": "send1 send1", "kill": "owner heir"}, 205),
    pytest.param({"verbs": "send1 send1 send1", "kill": "owner"}, 233, marks=pytest.mark.soak),
    pytest.param({"verbs": "send2 send1 send2 poll", "rounds": 2}, 461, marks=pytest.mark.soak),
])
def test_commands_and_deaths_go_together(scenario: dict[str, Any], outcomes: int) -> None:
    assert mailbox(Real(), **scenario).explore().outcomes == outcomes


TAKEN = "self._taken[place] = self._words[self._taken_at[place]] = n  # N3"
COPY = "raw = self._heads[place][slot].tobytes()  # N2"
VALUES = "self._view, at, when_ns, n, *whose, code, count, peer, by.encode(), encoded, *numbers"
PACK = f"            COMMANDS_OF[count].pack_into(\n                {VALUES})  # M2\n"
SENT = "        self._count = self._words[self._sent] = n  # M3\n"
A1, A3 = "        words[at >> 3] = 0  # A1\n", "        words[at >> 3] = n  # A3\n"
A2 = "        REPLY_BODY.pack_into(self._view, at + REPLY_START, number, outcome, shorten(text, REPLY_TEXT))  # A2\n"
A4 = "        self._answered[place] = words[self._answered_at[place]] = n  # A4\n"
FULL = "n - self._known > COMMANDS_DEPTH"
OVERTAKEN = {"verbs": "send1 send1 poll", "rounds": 2}
MUTANTS: dict[str, tuple[dict[str, Any], tuple[Change, ...]]] = {
    "sent before the slot": ({"verbs": "send1"}, (("place", PACK, "    " + SENT + PACK), ("place", SENT, ""))),
    "queue fuller than it is": ({"verbs": "send1 send1"}, (ONE_COMMAND, ("place", FULL, FULL + " + 1"))),
    "taken behind the run": ({"verbs": "send1", "kill": "owner"}, (
        ("mailbox", TAKEN, "self._taken[place] = n"),
        ("mailbox", A1, A1 + "        words[self._taken_at[place]] = number\n"))),
    "taken before the copy": ({"verbs": "send1 send1"}, (ONE_COMMAND, ("mailbox", COPY, f"{TAKEN}\n        {COPY}"))),
    "taken before the long copy": ({"verbs": "send2 send2"}, (
        ONE_COMMAND, ("mailbox", COPY, f"{COPY}\n        {TAKEN}"),)),
    "answer while its number stands": (OVERTAKEN, (ONE_REPLY, ("mailbox", A1, ""))),
    "number before the answer": ({"verbs": "send1 poll"}, (("mailbox", A1 + A2 + A3 + A4, A3 + A4 + A2),)),
    "client does not look at the number": (OVERTAKEN, (
        ONE_REPLY, ("place", "if self._words[at >> 3] == n:  # B3", "if True:"))),
    "nobody answers for the dead": ({"verbs": "send1", "kill": "owner"}, (
        ("mailbox", "            last.setdefault(taken, ACCEPTED)", "            pass"),)),
    "a torn answer counts": ({"verbs": "send1", "kill": "owner", "begun": 2}, (
        ("mailbox", "            if self._words[at >> 3] == n:\n", "            if True:\n"),)),
    "the backlog is forgotten": ({"verbs": "send1 send1"}, (("mailbox", " and not self._backlog", ""),)),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_seeded_mutant_of_the_mailbox_is_caught(name: str) -> None:
    scenario, changes = MUTANTS[name]
    with pytest.raises(Broken, match=r"AssertionError|at the end"):
        mailbox(Real(*changes), **scenario).explore()


def test_fenced_words_keep_a_weaker_memory_in_order() -> None:
    assert mailbox(Real(fenced=True), "send1 poll", model="weak").explore().outcomes == 10


def test_plain_words_do_not() -> None:
    with pytest.raises(Broken):
        mailbox(Real(), "send1 poll", model="pso").explore()
