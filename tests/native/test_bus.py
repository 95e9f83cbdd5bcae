"""The datagrams of a broadcast cycle by native code and by numpy: the same for all mixes of boards and firmware."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.link import Link
from trocar.procs.io.bus.protocols import Groups
from trocar.procs.io.bus.rows import HubBlocks, Rows
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

MIXES = ((8, ("QLA1",) * 8), (8, ("QLA1", "DQLA")), (9, ("dRA1", "QLA1", "DQLA")), (7, ("QLA1",) * 3),
         (8, ("dRA1",) * 2), (9, ("QLA1",)))


class NoTransport:
    """Nobody sends anything."""

    where = "nowhere"


def rows_of(revision: int, hardware: tuple[str, ...]) -> Rows:
    layouts = tuple(blocks.layout_of(revision, *blocks.AXES_OF[name]) for name in hardware)
    columns = blocks.Columns(max(max(layout.motors, layout.encoders) for layout in layouts))
    count = len(hardware)
    return Rows(tuple(range(1, 2 * count, 2)), layouts, columns, np.zeros((count, columns.count), np.uint32),
                np.zeros((count, columns.width + 1), np.uint32), np.zeros(count, bool), np.zeros(count, bool),
                {}, 1)


def answered(found: HubBlocks, link: Link, rng: np.random.Generator) -> None:
    """A reply in the buffer that answers the query: anything but for headers and statuses."""
    link.rx_quads[...] = rng.integers(0, 2**32, len(link.rx_quads), dtype=np.uint32)
    for (head, status), check, expected in zip(found.heads, found.check, found.expected, strict=True):
        for at, mask, value in ((head, check[0], expected[0]), (status, check[1], expected[1])):
            link.rx_quads[at] = link.rx_quads[at] & ~mask | value


@given(st.integers(0, 2**32 - 1), st.sampled_from(MIXES), st.integers(1, 0xFFFF), st.booleans())
def test_queries_and_what_answers_them(seed: int, mix: tuple[int, tuple[str, ...]], sequence: int, away: bool) -> None:
    rng, rows = np.random.default_rng(seed), rows_of(*mix)
    if away and len(rows.board_ids) > 1:
        rows.away[-1] = True
    link = Link(NoTransport(), lambda: 0, real_time=False)  # type: ignore[arg-type]
    found = HubBlocks(link, rows, np.flatnonzero(~rows.away).tolist())
    assert found.ask != HubBlocks.ask, "the native library does it"
    found.order(rng.permutation(len(found.quads)).tolist())
    results = []
    tl, generation = int(rng.integers(64)), int(rng.integers(256))
    for ask, take in ((found.ask, found.take), (lambda *a: HubBlocks.ask(found, *a), lambda: HubBlocks.take(found))):
        found.expected[:, 0] = 0
        rows.blocks.fill(0)
        rows.bad.fill(True)
        ask(sequence, tl, generation)
        answered(found, link, np.random.default_rng(seed))
        taken = take()
        results.append((bytes(found.query), found.expected.tobytes(), taken, rows.blocks.tobytes(), rows.bad.tobytes()))
        link.rx_quads[found.heads[0, 0]] ^= found.check[0, 0]
        rows.blocks.fill(7)
        assert not take() and (rows.blocks == 7).all(), "nothing is taken where one answers something else"
    assert results[0] == results[1] and results[0][2]
    value = sequence << 16 | found.mask_of_boards
    assert results[0][0] == wire.quadlet_write(wire.BROADCAST, registers.QUERY, value, tl, generation)


def test_what_is_made_anew_when_boards_come_and_go_leaves_nothing_for_the_garbage_collection() -> None:
    link = Link(NoTransport(), lambda: 0, real_time=False)  # type: ignore[arg-type]
    gc.disable()
    try:
        found = HubBlocks(link, rows_of(*MIXES[0]), range(8))
        seen = weakref.ref(found)
        del found
        assert seen() is None
    finally:
        gc.enable()


@given(st.integers(0, 2**32 - 1), st.sampled_from(MIXES))
def test_commands_of_all_boards(seed: int, mix: tuple[int, tuple[str, ...]]) -> None:
    rng, rows = np.random.default_rng(seed), rows_of(*mix)
    groups = Groups(rows)
    assert groups.pack != Groups.pack, "the native library does it"
    rows.out[...] = rng.integers(0, 2**32, rows.out.shape, dtype=np.uint32)
    before = rows.out.copy()
    groups.pack()
    by_native = bytes(groups.datagram)
    groups.datagram[22:] = bytes(len(groups.datagram) - 22) if mix[0] == 7 else groups.datagram[22:]
    Groups.pack(groups)
    assert bytes(groups.datagram) == by_native and np.array_equal(rows.out, before)
    assert by_native[-4:] == wire.crc_bytes(groups.data)
