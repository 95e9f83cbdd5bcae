"""Fault generations: commands given before a fault of a component are void for it, those given after it count."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import World
from trocar.shm.mailbox.generations import FaultCell, Faults, Watched, create_faults
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.segment import SegmentError

COMPONENTS = ("PSM1", "PSM2", "IO1/PSM1")


@pytest.fixture
def system(world: World) -> Iterator[str]:
    create_faults(world.name, COMPONENTS)
    yield world.name
    world.remove()


@pytest.fixture
def page(system: str) -> Iterator[Faults]:
    faults = Faults(system, write=True)
    yield faults
    faults.close()


def test_a_fault_voids_what_was_given_before_it_and_nothing_later(page: Faults) -> None:
    cell, before = FaultCell(page, "PSM1"), page.generation()
    assert before >= cell.valid_from
    cell.fault()
    assert before < cell.valid_from <= page.generation()


def test_a_fault_of_one_component_leaves_the_others_alone(page: Faults) -> None:
    one, other, before = FaultCell(page, "PSM1"), FaultCell(page, "PSM2"), page.generation()
    one.fault()
    assert before >= other.valid_from and page.void("PSM2") == 0


def test_a_successor_goes_on_with_the_cell_of_its_predecessor(page: Faults) -> None:
    FaultCell(page, "PSM1").fault()
    heir = FaultCell(page, "PSM1")
    assert heir.valid_from == 1 == page.void("PSM1")


def test_what_is_no_component_is_refused_by_name(page: Faults) -> None:
    with pytest.raises(KeyError, match=r"no component ECM; there are PSM1, PSM2, IO1/PSM1"):
        FaultCell(page, "ECM")
    assert page.void("ECM") == 0


def test_counters_that_somebody_has_scribbled_on_go_round(page: Faults) -> None:
    cell = FaultCell(page, "PSM1")
    page.words[page.cell("PSM1")[0]] = 2**64 - 1
    cell.fault()
    assert cell.valid_from == page.generation() == 0


def test_who_works_with_some_sees_their_last_fault_and_no_power_off(page: Faults) -> None:
    watched = Watched(page, ("PSM1", "PSM2", "somebody's own"))
    cell, alone = FaultCell(page, "PSM1"), FaultCell(page, "IO1/PSM1")
    alone.fault()
    cell.void_earlier(Origin(77, 0, "trocar home"))
    assert watched.valid_from == 0
    cell.fault()
    assert watched.valid_from == cell.valid_from == 3


def test_a_page_that_is_not_there_is_refused(world: World) -> None:
    with pytest.raises(SegmentError):
        Faults(world.name)


class Word:
    """The page in plain memory, for random interleavings: each load and store of a word is one step."""

    def __init__(self) -> None:
        self.counts, self.voids = [0, 0], [0, 0]


def owner(page: Word, place: int) -> Iterator[str]:
    """F1 and F2, step by step."""
    page.counts[place] += 1
    yield "counted"
    total = 0
    for other in range(len(page.counts)):
        total += page.counts[other]
        yield "summing"
    page.voids[place] = total
    yield "fault"


@given(st.lists(st.integers(0, 1), min_size=0, max_size=40), st.integers(0, 40))
def test_generations_order_commands_and_faults_however_two_owners_interleave(turns: list[int], when: int) -> None:
    page, owners = Word(), [owner(Word(), 0), owner(Word(), 1)]
    owners = [owner(page, 0), owner(page, 1)]
    begun, ended, given_at, before, after = set[int](), set[int](), None, set[int](), set[int]()
    for step, who in enumerate(turns):
        if step == when:  # a person's command, at one moment
            given_at, before, after = sum(page.counts), set(begun), set(ended)
        reported = next(owners[who], None)
        if reported is not None:
            begun.add(who)
        if reported == "fault":
            ended.add(who)
    if given_at is None:
        return
    for place in ended:
        if place not in before:  # the whole fault came after the command
            assert given_at < page.voids[place]
        if place in after:  # the whole fault came before it
            assert given_at >= page.voids[place]
