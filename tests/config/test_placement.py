"""Which process runs on which cores, and when nobody is told."""

from __future__ import annotations

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import Machine
from trocar.procs.config.loading.processes import Placement, placed
from trocar.procs.tables.manifest import proc

FOUR = tuple((number,) for number in range(4))
EIGHT = tuple((number,) for number in range(8))
THREADS = tuple((number, number + 4) for number in range(4))


@pytest.mark.parametrize(("cores", "ios", "own", "robots", "others"), [
    (FOUR, {"IO1": None}, {"IO1": (3,)}, (1, 2), (0,)),
    (FOUR, {"IO1": None, "IO2": None}, {"IO1": (2,), "IO2": (3,)}, (1,), (0,)),
    (EIGHT, {"IO1": None}, {"IO1": (7,)}, (2, 3, 4, 5, 6), (0, 1)),
    (THREADS, {"IO1": None}, {"IO1": (3,)}, (1, 2, 5, 6), (0, 4)),
    (EIGHT, {"IO1": 0, "IO2": None}, {"IO2": (7,)}, (3, 4, 5, 6), (1, 2))])
def test_io_has_a_core_of_its_own_and_the_others_keep_away(
    cores: tuple[tuple[int, ...], ...], ios: dict[str, int | None], own: dict[str, tuple[int, ...]],
    robots: tuple[int, ...], others: tuple[int, ...],
) -> None:
    assert placed(cores, ios) == Placement(own, robots, others)


def test_nobody_is_placed_where_there_are_too_few_cores() -> None:
    assert placed(FOUR[:3], {"IO1": None}) == placed(FOUR, {}) == Placement()
    assert placed(FOUR, {"IO1": None, "IO2": None, "IO3": None}) == Placement()


def test_what_moves_robots_comes_after_io() -> None:
    places = placed(FOUR, {"IO1": None})
    assert places.of(proc("io"), "IO1") == (3,)
    for kind in ("arm", "suj", "teleop", "console", "io"):  # an io without boards as well
        assert places.of(proc(kind), "x") == (1, 2)
    for kind in ("system", "focus", "user"):
        assert places.of(proc(kind), "x") == (0,)


def test_real_boards_on_the_wall_clock_place_everybody(home: Home) -> None:
    home.edit(SYSTEM, "boards: emulated", "processes: {PSM1: {cpu: 0}}")
    system = home.load(machine=Machine(cores=FOUR)).system
    assert system is not None
    assert [(row.name, row.cpus) for row in system.processes] == [("IO1", (3,)), ("PSM1", (0,)), ("system", (0,))]
    assert system.cpus == (0,)
    emulated = {"boards": "emulated", "sets": ["clock=wall"]}
    for options in ({"sets": ["placement=none"]}, {"boards": "emulated"}, emulated,
                    {"machine": Machine(cores=FOUR[:2])}, {"machine": Machine()}):
        system = home.load(**{"machine": Machine(cores=FOUR), **options}).system
        assert system is not None and system.cpus == () and system.process("IO1").cpus == ()


def test_a_core_that_the_file_gives_to_io_is_left_to_it(home: Home) -> None:
    home.edit(SYSTEM, "boards: emulated", "io: {cpu: 1}")
    system = home.load(machine=Machine(cores=FOUR)).system
    assert system is not None
    assert [row.cpus for row in system.processes] == [(1,), (2, 3), (0,)] and system.cpus == (0,)
