"""A console's decisions on plain data: the truth table, quick taps, selection and two consoles."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pytest

from tests.cases import cases
from tests.guarded import objection
from trocar.procs.console.logic import ALIGN, CAMERA, CLUTCH, DISABLE, ENABLE, OPERATOR, REFUSED_NS, Logic
from trocar.procs.console.selection import ECM, PSM, Selectable, at_load, tapped
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.tables.code_row import Code
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin

RIGHT = Selectable("MTMR_PSM1", "c", PSM, ("MTMR", "PSM1"))
LEFT = Selectable("MTML_PSM2", "c", PSM, ("MTML", "PSM2"))
THIRD = Selectable("MTML_PSM3", "c", PSM, ("MTML", "PSM3"))
SCOPE = Selectable("MTML_MTMR_ECM", "c", ECM, ("MTML", "MTMR", "ECM"))
ALL = (SCOPE, RIGHT, LEFT, THIRD)


class FakeDesk:
    """Remembers what it is told; `deaf` teleoperations cannot be asked. What their mailboxes refuse must not be asked.
    """

    def __init__(self) -> None:
        self.asks: list[tuple[str, str, tuple[float, ...], str]] = []
        self.reported_events: list[tuple[str, str]] = []
        self.freed: list[str] = []
        self.beeps: list[tuple[float, float]] = []
        self.deaf: set[str] = set()
        self.origins: list[object] = []

    def ask(self, teleop: str, command: str, values: Sequence[float] = (), text: str = "",
            origin: Origin = NO_ORIGIN) -> bool:
        self.origins.append(origin)
        assert not objection("teleop", command, values, text, origin), f"{command} {text} of {origin} is refused"
        if teleop not in self.deaf:
            self.asks.append((teleop, command, tuple(values), text))
        return teleop not in self.deaf

    def free(self, teleop: str) -> None:
        self.freed.append(teleop)

    def emit(self, event: str, text: str = "", component: str = "", value: float = 0.0) -> None:
        self.reported_events.append((event, text))

    def button(self, name: str, kind: int) -> None:
        self.reported_events.append(("button", name))

    def status(self, text: str) -> None:
        self.reported_events.append(("status", text))

    def report(self, code: Code, text: str) -> None:
        self.reported_events.append((code.code, text))

    def beep(self, duration_s: float, frequency_hz: float) -> None:
        self.beeps.append((duration_s, frequency_hz))

    def words(self, teleop: str) -> list[str]:
        return [text for name, command, _, text in self.asks if (name, command) == (teleop, "state_command")]


def console(members: Sequence[Selectable] = ALL, name: str = "c") -> tuple[Logic, FakeDesk]:
    desk = FakeDesk()
    return Logic(name, members, desk, 0.2), desk


@cases(("wanted", "selected", "camera", "operator"), list(itertools.product((False, True), repeat=4)))
def test_truth_table_of_a_psm(wanted: bool, selected: bool, camera: bool, operator: bool) -> None:
    logic, desk = console((RIGHT,))
    if not selected:
        logic.unselect(RIGHT.name)
    logic.press(CAMERA, PRESSED if camera else RELEASED)
    logic.press(OPERATOR, PRESSED if operator else RELEASED)
    logic.enable(wanted, PERSON)
    runs = wanted and selected and not camera
    assert desk.words(RIGHT.name)[-1] == (DISABLE if not runs else ENABLE if operator else ALIGN)


@cases(("wanted", "selected", "camera", "operator"), list(itertools.product((False, True), repeat=4)))
def test_truth_table_of_an_ecm(wanted: bool, selected: bool, camera: bool, operator: bool) -> None:
    logic, desk = console((SCOPE,))
    if not selected:
        logic.unselect(SCOPE.name)
    logic.press(CAMERA, PRESSED if camera else RELEASED)
    logic.press(OPERATOR, PRESSED if operator else RELEASED)
    logic.enable(wanted, PERSON)
    assert desk.words(SCOPE.name)[-1] == (ENABLE if wanted and selected and camera else DISABLE)


def test_camera_swaps_psms_for_the_ecm_and_back() -> None:
    logic, desk = console()
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    desk.asks.clear()
    logic.press(CAMERA, PRESSED)
    asked = [(name, text) for name, command, _, text in desk.asks if command == "state_command"]
    assert asked == [("MTMR_PSM1", DISABLE), ("MTML_PSM2", DISABLE), ("MTML_MTMR_ECM", ENABLE)], "stops come first"
    logic.press(CAMERA, RELEASED)
    assert desk.words("MTML_MTMR_ECM")[-1] == DISABLE and desk.words("MTMR_PSM1")[-1] == ENABLE


def test_operator_coming_while_camera_is_pressed_stops_what_aligns() -> None:
    logic, desk = console()
    logic.enable(True, PERSON)
    assert desk.words("MTMR_PSM1")[-1] == ALIGN
    logic.press(CAMERA, PRESSED)
    logic.press(OPERATOR, PRESSED)
    assert desk.words("MTMR_PSM1")[-1] == DISABLE


def test_operator_leaving_turns_following_into_aligning() -> None:
    logic, desk = console()
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    logic.press(OPERATOR, RELEASED)
    assert desk.words("MTMR_PSM1") == [DISABLE, ENABLE, ALIGN]


def test_nothing_is_asked_twice() -> None:
    logic, desk = console()
    logic.enable(True, PERSON)
    count = len(desk.asks)
    logic.enable(True, PERSON)
    logic.step(1)
    assert len(desk.asks) == count


def test_endoscope_comes_first_and_sharers_start_unselected() -> None:
    assert at_load(ALL) == {"MTML_MTMR_ECM", "MTMR_PSM1", "MTML_PSM2"}


def test_quick_tap_toggles_the_pair_of_a_master() -> None:
    logic, desk = console()
    logic.press(CLUTCH, CLICKED)
    assert logic.selected == {"MTML_MTMR_ECM", "MTMR_PSM1", "MTML_PSM3"}
    assert ("status", "MTML_PSM2 unselected to free MTML") in desk.reported_events
    logic.press(CLUTCH, CLICKED)
    assert "MTML_PSM2" in logic.selected and "MTML_PSM3" not in logic.selected
    assert desk.beeps == [(0.05, 2000.0)] * 4


def test_quick_tap_needs_exactly_two() -> None:
    fourth = Selectable("MTML_PSM1", "c", PSM, ("MTML", "PSM1"))
    assert tapped((RIGHT, LEFT, THIRD, fourth), {"MTML_PSM2"}) == ""
    assert tapped((LEFT, THIRD), set()) == "MTML_PSM2"


@pytest.mark.parametrize("camera", [False, True])
def test_of_a_clutch_those_hear_first_that_do_not_run(camera: bool) -> None:
    logic, desk = console()
    logic.enable(True, PERSON)
    logic.press(OPERATOR, PRESSED)
    if camera:
        logic.press(CAMERA, PRESSED)
    running = {name for name, word in logic.asked.items() if word == ENABLE}
    for kind in (PRESSED, RELEASED):
        desk.asks.clear()
        logic.press(CLUTCH, kind)
        reported = [name for name, command, _, _ in desk.asks if command == "clutch"]
        assert len(reported) == len(ALL) and set(reported[-len(running):]) == running


def test_clutch_goes_to_every_teleop_selected_or_not() -> None:
    logic, desk = console()
    logic.press(CLUTCH, PRESSED)
    pressed = [name for name, command, values, _ in desk.asks if command == "clutch" and values == (1.0,)]
    assert pressed == [member.name for member in ALL] and desk.beeps == [(0.1, 700.0)]


def test_selecting_frees_the_arm_within_a_console() -> None:
    logic, desk = console()
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    desk.asks.clear()
    assert logic.select("MTML_PSM3")
    assert [(row[0], row[3]) for row in desk.asks] == [("MTML_PSM2", DISABLE), ("MTML_PSM3", ENABLE)]
    assert {("unselected", "MTML_PSM2"), ("selected", "MTML_PSM3")} <= set(desk.reported_events)


def test_second_console_waits_until_the_first_has_let_go() -> None:
    other = Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1"))
    first, _ = console((RIGHT, other))
    second, desk = console((RIGHT, other), "d")
    assert first.selected == {"MTMR_PSM1"} and second.selected == set()
    second.elsewhere = {"MTMR_PSM1"}
    assert not second.select("MTMX_PSM1") and desk.freed == ["MTMR_PSM1"]
    second.step(1)
    assert second.selected == set() and desk.freed == ["MTMR_PSM1"], "asked once"
    first.unselect("MTMR_PSM1")
    second.elsewhere = set(first.selected)
    second.step(2)
    assert second.selected == {"MTMX_PSM1"}


def test_two_consoles_selecting_at_once_end_with_one() -> None:
    other = Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1"))
    first, _ = console((RIGHT, other))
    second, _ = console((RIGHT, other), "d")
    second.selected = {"MTMX_PSM1"}
    first.elsewhere, second.elsewhere = set(second.selected), set(first.selected)
    first.step(1)
    second.step(1)
    assert (first.selected, second.selected) == ({"MTMR_PSM1"}, set())


def test_teleop_that_began_anew_waits_for_presence() -> None:
    logic, desk = console()
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    logic.began_anew("MTMR_PSM1")
    logic.step(1)
    assert desk.words("MTMR_PSM1")[-1] == ALIGN and desk.words("MTML_PSM2")[-1] == ENABLE
    logic.press(OPERATOR, RELEASED)
    logic.press(OPERATOR, PRESSED)
    assert desk.words("MTMR_PSM1")[-1] == ENABLE


def test_teleop_that_had_stopped_by_itself_is_not_asked_again_because_it_began_anew() -> None:
    logic, desk = console((RIGHT,))
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    logic.shows("MTMR_PSM1", "DISABLED")
    logic.began_anew("MTMR_PSM1")
    for now_ns in range(1, 5):
        logic.step(now_ns)
        logic.shows("MTMR_PSM1", "DISABLED")
    assert desk.words("MTMR_PSM1") == [DISABLE, ENABLE]
    logic.press(OPERATOR, RELEASED)
    logic.press(OPERATOR, PRESSED)
    assert desk.words("MTMR_PSM1") == [DISABLE, ENABLE, ENABLE]


def test_who_cannot_be_told_is_asked_until_it_can() -> None:
    logic, desk = console((RIGHT,))
    desk.deaf = {"MTMR_PSM1"}
    logic.enable(True, PERSON)
    assert desk.asks == []
    desk.deaf = set()
    logic.step(5)
    assert desk.words("MTMR_PSM1") == [ALIGN]


def test_refused_is_asked_again_in_a_while() -> None:
    logic, desk = console((RIGHT,))
    logic.enable(True, PERSON)
    logic.refused("MTMR_PSM1", 10)
    logic.step(11)
    assert len(desk.words("MTMR_PSM1")) == 1
    logic.step(11 + REFUSED_NS)
    assert len(desk.words("MTMR_PSM1")) == 2


def test_scale_is_for_all_of_the_console() -> None:
    logic, desk = console()
    logic.set_scale(0.4, PERSON)
    assert [(row[0], row[2]) for row in desk.asks] == [(member.name, (0.4,)) for member in ALL]
    assert logic.scale == 0.4


def test_teleop_that_an_error_stopped_is_asked_again_by_a_person_only() -> None:
    logic, desk = console((RIGHT,))
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    logic.shows("MTMR_PSM1", "ENABLED")
    logic.shows("MTMR_PSM1", "DISABLED")
    logic.step(1)
    assert desk.words("MTMR_PSM1") == [DISABLE, ENABLE]
    logic.enable(True, PERSON)
    assert desk.words("MTMR_PSM1") == [DISABLE, ENABLE, ENABLE]


@pytest.mark.parametrize("last", [PRESSED, RELEASED])
def test_a_clutch_that_could_not_be_told_is_told_later(last: int) -> None:
    logic, desk = console()
    logic.enable(True, PERSON)
    if last == RELEASED:
        logic.press(CLUTCH, PRESSED)
    desk.deaf.add(RIGHT.name)
    logic.press(CLUTCH, last)
    logic.step(1)
    desk.deaf.clear()
    desk.asks.clear()
    logic.step(2)
    assert [ask for ask in desk.asks if ask[1] == "clutch"] == [(RIGHT.name, "clutch", (float(last == PRESSED),), "")]
    desk.asks.clear()
    logic.step(3)
    assert not desk.asks


PERSON, LATER = Origin(77, 3, "trocar send"), Origin(78, 4, "trocar send")


def test_tele_operations_run_on_behalf_of_the_person_who_enabled_them_whatever_the_pedals_do() -> None:
    logic, desk = console((RIGHT,))
    logic.enable(True, PERSON)
    logic.press(OPERATOR, PRESSED)
    logic.press(OPERATOR, RELEASED)
    assert desk.words(RIGHT.name) == [ALIGN, ENABLE, ALIGN] and desk.origins == [PERSON] * 3


def test_a_fault_of_an_arm_takes_what_was_desired_before_away_until_a_person_enables_again() -> None:
    logic, desk = console((RIGHT,))
    logic.press(OPERATOR, PRESSED)
    logic.enable(True, PERSON)
    logic.faults_until(3)
    assert logic.wanted and desk.words(RIGHT.name)[-1] == ENABLE
    logic.faults_until(4)
    assert not logic.wanted and desk.words(RIGHT.name)[-1] == DISABLE
    assert [text for code, text in desk.reported_events if code == "teleop-disabled"] == [
        "c: an arm had a fault; teleoperation is no longer enabled"]
    logic.press(OPERATOR, RELEASED)
    logic.press(OPERATOR, PRESSED)
    assert desk.words(RIGHT.name)[-1] == DISABLE
    logic.enable(True, LATER)
    logic.faults_until(4)
    assert logic.wanted and desk.words(RIGHT.name)[-1] == ENABLE


def test_teleop_that_began_anew_is_asked_anew_for_what_it_was_asked_for() -> None:
    logic, desk = console((RIGHT,))
    logic.enable(True, PERSON)
    logic.began_anew(RIGHT.name)
    logic.step(1)
    assert desk.words(RIGHT.name) == [ALIGN, ALIGN]


def test_teleop_that_began_anew_hears_of_a_pressed_clutch() -> None:
    logic, desk = console((RIGHT,))
    desk.asks.clear()
    logic.began_anew(RIGHT.name)
    assert not desk.asks, "as it began"
    logic.press(CLUTCH, PRESSED)
    desk.asks.clear()
    logic.began_anew(RIGHT.name)
    assert [ask[1:3] for ask in desk.asks] == [("clutch", (1.0,))]


def test_a_teleop_that_did_not_get_the_scale_is_named() -> None:
    logic, desk = console((RIGHT, LEFT))
    desk.deaf.add(LEFT.name)
    logic.set_scale(0.3, PERSON)
    assert desk.reported_events[0] == ("status", "MTML_PSM2 did not get the scale 0.3")


@pytest.mark.parametrize(("button", "kept"), [(OPERATOR, {SCOPE.name}), (CAMERA, {RIGHT.name}),
                                              (CLUTCH, {SCOPE.name, RIGHT.name})])
def test_presence_is_shown_again_by_the_first_press_of_what_a_teleop_waits_for(button: str, kept: set[str]) -> None:
    logic, _ = console((SCOPE, RIGHT))
    for member in (SCOPE, RIGHT):
        logic.began_anew(member.name)
    logic.press(button, RELEASED)
    assert logic.lapsed == {SCOPE.name, RIGHT.name}, "letting go shows nothing"
    logic.press(button, PRESSED)
    assert logic.lapsed == kept


@pytest.mark.parametrize(("button", "again"), [(OPERATOR, 1), (CAMERA, 1), (CLUTCH, 0)])
def test_a_press_but_of_the_clutch_asks_again_who_has_stopped(button: str, again: int) -> None:
    logic, desk = console((RIGHT, SCOPE))
    logic.enable(True, PERSON)
    logic.shows(RIGHT.name, "DISABLED")
    count = len(desk.words(RIGHT.name))
    logic.press(button, PRESSED)
    assert len(desk.words(RIGHT.name)) == count + again
