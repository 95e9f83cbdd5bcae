"""What the benchmark of the boards drives them with: two physics steps a window, amplifiers on, arms moving."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import World
from tests.fpga import board_side
from trocar.procs.boards.cost import BLOCK, CYCLES, MAX_OFF, SWITCH_ON_WINDOWS, WARM_UP, WINDOW_NS, BoardsBench, summary
from trocar.procs.config import load_system
from trocar.procs.fpga import blocks, wire
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import BOARDS_STATE
from trocar.tools.bench.io_loop import write_system

MEASURED = {"whole", "sockets", "paused", "physics", "query", "read", "write", "record", "answering"}


@pytest.fixture
def bench(world: World, tmp_path: Path) -> Iterator[BoardsBench]:
    """One PSM on two boards."""
    loaded = load_system(write_system(tmp_path, 1), boards="emulated", name=world.name)
    assert loaded.system is not None, loaded.errors
    create_ring(world.name, "boards", BOARDS_STATE, {"axes": 7, "boards": 2}, {})
    with contextlib.closing(BoardsBench(world.name, loaded.system)) as made:
        yield made
    world.remove()


def test_every_window_holds_two_physics_steps(bench: BoardsBench) -> None:
    begins = []
    for _ in range(4):
        bench.whole(bench._next())
        begins.append(bench.world.board_ns)
    assert np.diff(begins).tolist() == [WINDOW_NS] * 3
    assert round(1e9 * CYCLES / WINDOW_NS) == 1500


def test_a_turn_measures_everything_with_the_arms_moving(bench: BoardsBench) -> None:
    found, lowest, highest = bench.turn(0.0), bench.world.position.copy(), bench.world.position.copy()
    assert set(found) == MEASURED
    assert all(0 < reported["p10"] <= reported["p50"] <= reported["p99"] for reported in found.values())
    assert {reported["n"] for reported in found.values()} == {BLOCK - WARM_UP}
    for _ in range(500):  # half a period of the swing
        bench.whole(bench._next())
        np.minimum(lowest, bench.world.position, out=lowest)
        np.maximum(highest, bench.world.position, out=highest)
    assert ((highest - lowest) > 2e-3).all()


def test_a_hub_read_that_is_not_the_cycle_s_is_refused(bench: BoardsBench) -> None:
    at = (SWITCH_ON_WINDOWS + 1) * WINDOW_NS
    replies = [bench.world.answer(0, data, when) for when, data in bench.host.cycle(at)]
    good = bytes(replies[1] or b"")
    bench.host.check(good, at)
    with pytest.raises(ValueError, match="bytes; wanted"):
        bench.host.check(board_side.quadlet_response(0, 1, 0, wire.Trailer()), at)
    off = bytearray(good)
    off[20 + 4 * (1 + blocks.STATUS) + 2] ^= 1  # the feedback of one amplifier
    with pytest.raises(ValueError, match="not every amplifier is on"):
        bench.host.check(off, at)
    bench.host.cycle(at)
    with pytest.raises(ValueError, match="headers"):
        bench.host.check(good, at)


def test_arms_off_their_path_are_refused(bench: BoardsBench) -> None:
    bench._check()
    bench.host._middle += 1.1 * MAX_OFF
    with pytest.raises(ValueError, match="off its path"):
        bench._check()


def test_an_amplifier_that_went_off_is_refused(bench: BoardsBench) -> None:
    bench.world.advance((SWITCH_ON_WINDOWS + 30) * WINDOW_NS)  # nobody writes: the watchdog
    bench._windows += 30
    with pytest.raises(ValueError, match="not every amplifier is on"):
        bench._check()


def test_times_are_of_one_cycle() -> None:
    assert summary([300 * k for k in range(101)]) == {"p10": 1000, "p50": 5000, "p99": 9900, "n": 101}
