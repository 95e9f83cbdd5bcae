"""Whom a console talks to by mailbox, what it makes of the answers, and where it goes on after a restart."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.console.logic import ENABLE, Logic
from trocar.procs.console.outbox import Mailboxes
from trocar.procs.console.record import ConsoleRecord, go_on
from trocar.procs.console.selection import ECM, PSM, Selectable
from trocar.procs.document.consoles import Console
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.tables import codes
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.memory.layout import schema_of
from trocar.shm.operator_topics import CONSOLE_STATE

MEMBERS = (Selectable("MTML_MTMR_ECM", "c", ECM, ("MTML", "MTMR", "ECM")),
           Selectable("MTMR_PSM1", "c", PSM, ("MTMR", "PSM1")), Selectable("MTML_PSM2", "c", PSM, ("MTML", "PSM2")),
           Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1")), Selectable("MTMY_PSM2", "d", PSM, ("MTMY", "PSM2")),
           Selectable("MTMZ_PSM3", "away", PSM, ("MTMZ", "PSM3")))
RUNNING = ("MTMR_PSM1", "MTML_PSM2", "MTMX_PSM1", "MTMY_PSM2", "c", "d", "system")  # the ECM's is not there
PERSON = Origin(7, 2, "play")


class FakeClient:
    """A place in a mailbox, which may be full; answers that wait."""

    def __init__(self, name: str, log: list[str]) -> None:
        self.name, self.log, self.full, self.sent = name, log, False, 0
        self.answers: list[Any] = []

    def on_behalf(self, origin: Origin) -> None:
        self.log.append(f"{self.name} for {origin.id}")

    def send(self, name: str, values: Any, text: str) -> int:
        self.log.append(f"{self.name} < {name} {text} {tuple(values)}")
        self.sent += not self.full
        return 0 if self.full else self.sent

    def answer(self, number: int, outcome: str, text: str = "") -> None:
        self.answers.append(SimpleNamespace(id=number, outcome=outcome, text=text))

    def poll(self) -> list[Any]:
        found, self.answers = self.answers, []
        return found


class FakeStateRing:
    """The newest record of somebody."""

    def __init__(self, **fields: Any) -> None:
        self.epoch, self.there, self._fields = 1, True, {name: np.array(value) for name, value in fields.items()}

    def field(self, name: str) -> Any:
        return self._fields[name]

    def newest(self) -> bool:
        return self.there


class Office:
    """The mailboxes of console c, and a logic that says what it is told."""

    def __init__(self, running: tuple[str, ...] = RUNNING) -> None:
        self.log: list[str] = []
        self.clients: dict[str, FakeClient] = {}
        self.rings = {name: FakeStateRing(desired_state=b"ENABLED", selected=(False, True)) for name in running}
        log = self.log.append
        events = SimpleNamespace(
            emit=lambda event, text="", **rest: log(f"{event} {text} {sorted(rest.items())}"),
            status=lambda text, component: log(f"status of {component}: {text}"),
            report=lambda code, text, component: log(f"{code.code} of {component}: {text}"))
        node: Any = SimpleNamespace(
            name="c", events=events, commands=self.client, reads=lambda name, topic: self.rings[name],
            document=SimpleNamespace(processes=[SimpleNamespace(name=name) for name in running]))
        self.desk = Mailboxes(node, MEMBERS)
        self.logic: Any = SimpleNamespace(
            asked=dict.fromkeys((member.name for member in MEMBERS), ENABLE), elsewhere={"somebody"},
            refused=lambda name, now_ns: log(f"refused {name} {now_ns}"), began_anew=lambda name: log(f"anew {name}"),
            shows=lambda name, desired: log(f"shows {name} {desired}"))

    def client(self, name: str) -> FakeClient:
        return self.clients.setdefault(name, FakeClient(name, self.log))

    def heard(self) -> list[str]:
        """What came of listening, but for the states of those that go on as they were."""
        self.log.clear()
        self.desk.listen(self.logic, 55)
        return [line for line in self.log if not line.startswith("shows")]


@pytest.fixture
def office() -> Office:
    return Office()


def test_places_are_taken_with_those_that_run_and_are_needed(office: Office) -> None:
    assert sorted(office.clients) == ["MTML_PSM2", "MTMR_PSM1", "d", "system"]
    assert sorted(Office(("c", "MTMR_PSM1")).clients) == ["MTMR_PSM1"]


def test_what_is_asked_goes_out_on_behalf_of_a_person(office: Office) -> None:
    assert office.desk.ask("MTMR_PSM1", "state_command", text="enable", origin=PERSON)
    assert office.desk.ask("MTML_PSM2", "set_scale", (0.5,))
    assert not office.desk.ask("MTML_MTMR_ECM", "state_command", text="enable", origin=PERSON), "it does not run"
    office.clients["MTML_PSM2"].full = True
    assert not office.desk.ask("MTML_PSM2", "set_scale", (0.6,))
    assert office.log == ["MTMR_PSM1 for 7", "MTMR_PSM1 < state_command enable ()", f"MTML_PSM2 for {NO_ORIGIN.id}",
                          "MTML_PSM2 < set_scale  (0.5,)", f"MTML_PSM2 for {NO_ORIGIN.id}",
                          "MTML_PSM2 < set_scale  (0.6,)"]


def test_consoles_people_and_the_system_are_told(office: Office) -> None:
    desk = office.desk
    for teleop in ("MTMX_PSM1", "MTMZ_PSM3", "MTMR_PSM1", "nobody"):
        desk.free(teleop)
    desk.beep(0.1, 700.0)
    desk.emit("scale", "x", "MTMR_PSM1", 0.4)
    for kind in (PRESSED, RELEASED, CLICKED):
        desk.button("clutch", kind)
    desk.status("it is so")
    desk.report(codes.TELEOP_DISABLED, "why")
    assert office.log == [
        "d < unselect_teleop MTMX_PSM1 ()", "system < beep  (0.1, 700.0)",
        "scale x [('component', 'MTMR_PSM1'), ('value', 0.4)]",
        *(f"button {name} [('code', '{name}'), ('component', 'clutch'), ('value', {value})]"
          for name, value in (("pressed", 0.0), ("released", 1.0), ("clicked", 2.0))),
        "status of c: it is so", "teleop-disabled of c: why"]


def test_a_console_without_a_system_beeps_at_nobody() -> None:
    office = Office(("c", "MTMR_PSM1"))
    office.desk.beep(0.1, 700.0)
    assert office.heard() == [] and office.logic.elsewhere == {"somebody"}, "without others nobody is looked at"


def test_a_refusal_is_complained_of_once_and_asked_again_if_it_was_the_last_word(office: Office) -> None:
    client = office.clients["MTMR_PSM1"]
    for word in ("enable", "disable"):
        office.desk.ask("MTMR_PSM1", "state_command", text=word)
    office.desk.ask("MTMR_PSM1", "set_scale", (0.5,))
    complaint = "teleop-refused of MTMR_PSM1: MTMR_PSM1 refuses: busy"
    client.answer(1, "refused", "busy")
    assert office.heard() == ["refused MTMR_PSM1 55", complaint]
    client.answer(1, "refused", "busy")
    assert office.heard() == [], "it was answered, and said"
    client.answer(2, "refused", "why")
    assert office.heard() == ["teleop-refused of MTMR_PSM1: MTMR_PSM1 refuses: why"], "no longer what is wanted of it"
    client.answer(3, "refused", "busy")
    assert office.heard() == [complaint]
    for outcome in ("accepted", "done", "failed"):
        client.answer(office.desk._teleops["MTMR_PSM1"].sent, outcome, "busy again")
    assert office.heard() == []


def test_only_the_same_words_answer_counts(office: Office) -> None:
    for teleop in ("MTMR_PSM1", "MTML_PSM2"):
        office.desk.ask(teleop, "state_command", text="enable")
    office.clients["MTML_PSM2"].answer(1, "done")
    office.clients["MTMR_PSM1"].answer(1, "refused", "x")
    assert office.heard()[0] == "refused MTMR_PSM1 55"


def test_states_and_restarts_are_seen(office: Office) -> None:
    office.rings["MTML_PSM2"].field("desired_state")[...] = b"ALIGN"
    office.heard()
    assert office.log == ["shows MTMR_PSM1 ENABLED", "shows MTML_PSM2 ALIGN"]
    office.rings["MTMR_PSM1"].epoch, office.rings["MTML_PSM2"].there = 2, False
    office.heard()
    assert office.log == ["status of c: MTMR_PSM1 was restarted: it follows when the operator has left and returned",
                          "anew MTMR_PSM1"]
    office.heard()
    assert office.log == ["shows MTMR_PSM1 ENABLED"]


def test_what_others_have_selected_is_seen_and_their_answers_are_taken(office: Office) -> None:
    for name in ("d", "system"):
        office.clients[name].answer(1, "done")
    office.heard()
    assert office.logic.elsewhere == {"MTMY_PSM2"}
    assert not office.clients["d"].answers and not office.clients["system"].answers
    office.rings["d"].there = False
    office.heard()
    assert office.logic.elsewhere == set()


# -- the record --------------------------------------------------------------------------------------------------------


class Ledger(FakeStateRing):
    """A console's own ring."""

    def __init__(self) -> None:
        record: Any = np.zeros(1, dtype=schema_of(CONSOLE_STATE, {"teleops": 3}).dtype)
        super().__init__()
        self._fields = {name: record[name].reshape(record[name].shape[1:]) for name in record.dtype.names}


def console_of(desk: Any = None) -> Logic:
    quiet: Any = SimpleNamespace(**{name: lambda *_, **__: True for name in (
        "ask", "free", "emit", "button", "status", "report", "beep")})
    return Logic("c", MEMBERS, desk or quiet, 0.2)


@pytest.mark.parametrize(("scale", "wanted", "selected"), [
    (0.2, True, ("MTMR_PSM1",)), (0.3, False, ("MTML_PSM2", "MTML_MTMR_ECM")), (0.7, True, ())])
def test_a_console_goes_on_with_what_its_record_says(scale: float, wanted: bool, selected: tuple[str, ...]) -> None:
    ledger, before, after = Ledger(), console_of(), console_of()
    before.selected, before.wanted, before.scale, before.origin = set(selected), wanted, scale, PERSON
    before.operator = before.camera = before.clutch = True
    before.asked = {"MTML_MTMR_ECM": "enable", "MTMR_PSM1": "align_MTM", "MTML_PSM2": ""}
    inputs: Any = SimpleNamespace(valid=True, seen=3)
    ConsoleRecord(ledger.field, Console("c", "PEDALS_ONLY", 0.01), before).fill(inputs)
    assert {field.name: ledger.field(field.name).tolist() for field in CONSOLE_STATE.fields} == {
        "valid": True, "input_type": b"PEDALS_ONLY", "operator_present": True, "clutch": True, "camera": True,
        "teleop_enabled": wanted, "origin": 7, "generation": 2, "program": b"play", "scale": scale,
        "teleop": [b"MTML_MTMR_ECM", b"MTMR_PSM1", b"MTML_PSM2"], "kind": [b"ECM", b"PSM", b"PSM"],
        "selected": [member.name in selected for member in MEMBERS[:3]], "asked": [b"enable", b"align_MTM", b""],
        "present_inputs": 3}
    assert go_on(ledger, after)  # type: ignore[arg-type]
    assert (after.selected, after.wanted, after.scale, after.origin) == (set(selected), wanted, scale, PERSON)
    assert not (after.operator or after.clutch or after.camera)


def test_a_console_that_was_never_there_begins_as_the_file_says() -> None:
    ledger, logic = Ledger(), console_of()
    ledger.there = False
    assert not go_on(ledger, logic)  # type: ignore[arg-type]
    assert logic.selected == {"MTML_MTMR_ECM", "MTMR_PSM1", "MTML_PSM2"}


def test_what_is_no_longer_its_own_is_not_selected() -> None:
    ledger, logic = Ledger(), console_of()
    ledger.field("teleop")[...] = [b"MTMX_PSM1", b"MTMR_PSM1", b""]
    ledger.field("selected")[...] = True
    assert go_on(ledger, logic)  # type: ignore[arg-type]
    assert logic.selected == {"MTMR_PSM1"}
