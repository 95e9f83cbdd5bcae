"""A console that gives way, waits, is refused, or sees nobody any more."""

from __future__ import annotations

from tests.console.test_logic import PERSON, RIGHT, console
from trocar.procs.console.logic import ALIGN, CAMERA, OPERATOR, REFUSED_NS
from trocar.procs.console.selection import PSM, Selectable
from trocar.procs.node.debounce import PRESSED, RELEASED


def test_asking_for_another_selection_frees_what_that_needs_too() -> None:
    ours = (Selectable("MTML_PSM2", "c", PSM, ("MTML", "PSM2")), Selectable("MTMR_PSM1", "c", PSM, ("MTMR", "PSM1")))
    others = (Selectable("A_PSM1", "d", PSM, ("A", "PSM1")), Selectable("B_PSM2", "d", PSM, ("B", "PSM2")))
    for first, second in (ours, ours[::-1]):
        logic, desk = console((*others, *ours))
        logic.elsewhere = {member.name for member in others}
        assert not logic.select(first.name) and not logic.select(first.name) and len(desk.freed) == 1, "asked once"
        assert not logic.select(second.name) and len(desk.freed) == 2
        logic.elsewhere = set()
        logic.step(1)
        assert logic.selected == {second.name}, "the last one asked for"


def test_who_yields_to_two_others_says_so_once() -> None:
    mine = Selectable("MTMR_PSM1", "c", PSM, ("MTMR", "PSM1"))
    others = (Selectable("MTMR_PSM9", "d", PSM, ("MTMR", "PSM9")), Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1")))
    logic, desk = console((*others, mine))
    logic.selected, logic.elsewhere = {mine.name}, {other.name for other in others}
    logic.step(1)
    assert logic.selected == set() and desk.reported_events == [
        ("status", "MTMR_PSM1 unselected to free MTMR"), ("unselected", "MTMR_PSM1")]


def test_each_of_several_yields_what_it_must() -> None:
    second = Selectable("MTML_PSM2", "c", PSM, ("MTML", "PSM2"))
    other = Selectable("MTMX_PSM2", "d", PSM, ("MTMX", "PSM2"))
    logic, _ = console((other, RIGHT, second))
    logic.selected, logic.elsewhere = {second.name}, {other.name}
    logic.step(1)
    assert logic.selected == set(), "the first of ours is not selected, and not looked at"


def test_silent_inputs_count_as_nobody_there() -> None:
    logic, desk = console((RIGHT,))
    logic.enable(True, PERSON)
    logic.lose_operator("its inputs are silent")
    assert not desk.beeps and desk.words(RIGHT.name) == [ALIGN], "nobody was there"
    logic.press(OPERATOR, PRESSED)
    logic.lose_operator("its inputs are silent")
    assert not logic.operator and desk.words(RIGHT.name)[-1] == ALIGN
    assert ("status", "c: its inputs are silent; the operator counts as absent") in desk.reported_events


def test_what_was_refused_is_asked_again_at_the_very_end_of_its_time() -> None:
    logic, desk = console((RIGHT,))
    logic.enable(True, PERSON)
    logic.refused(RIGHT.name, 10)
    logic.step(9 + REFUSED_NS)
    assert len(desk.words(RIGHT.name)) == 1
    logic.step(10 + REFUSED_NS)
    assert len(desk.words(RIGHT.name)) == 2
    logic.refused(RIGHT.name, 10)
    logic.press(CAMERA, RELEASED)
    assert len(desk.words(RIGHT.name)) == 3, "what a person does is done at once"
