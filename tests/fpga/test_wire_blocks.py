from __future__ import annotations

import json

from tests.fpga import board_side
from trocar.procs.boards.devices.board import GIT_DESCRIPTIONS
from trocar.procs.document.emulated import MADE_FOR
from trocar.procs.fpga import blocks, registers, wire

DECODERS = {"host->board": board_side.decode_request, "board->host": board_side.decode_response}


def recorded(folder):
    """(firmware, decoded datagram) of every recorded block transfer."""
    for path in sorted(folder.glob("*.jsonl")):
        for line in path.read_text().splitlines():
            row = json.loads(line)
            decode = DECODERS.get(row.get("dir"))
            if decode:
                yield int(path.name[3]), decode(bytes.fromhex(row["hex"]))


def test_every_recorded_block_has_the_layout_of_its_revision(data):
    seen = {"read": 0, "hub": 0, "write": 0}
    for firmware, item in recorded(data("golden/wire")):
        layout, quads = blocks.LAYOUTS[firmware], len(item.data) // 4
        if item.tcode == wire.BLOCK_WRITE:
            assert quads == len(board_side.decode_write(item.data, firmware)) * layout.write_quads
            seen["write"] += 1
        elif item.tcode == wire.BLOCK_RESPONSE and quads == layout.read_quads:
            seen["read"] += 1
        elif item.tcode == wire.BLOCK_RESPONSE:
            count = quads // layout.hub_quads
            assert blocks.hub_read_quads([(firmware, "QLA1")] * count) == quads
            heads = [int.from_bytes(item.data[4 * at : 4 * at + 4], "big")
                     for at in range(0, quads - 1, layout.hub_quads)]
            for head in heads:
                assert not head & ~(layout.check_mask | layout.time_mask)
                sequence = head >> layout.sequence_shift
                assert head & layout.check_mask & ~layout.mismatch == layout.header(sequence)
            status = [4 * (at + 1 + blocks.STATUS) for at in range(0, quads - 1, layout.hub_quads)]
            boards = [registers.board_of(int.from_bytes(item.data[at : at + 4], "big")) for at in status]
            assert boards == sorted(boards)
            seen["hub"] += 1
    assert min(seen.values()) > 0


def test_worked_example_of_a_hub_header():
    assert blocks.LAYOUTS[8].header(0x0106) == 0x21060000
    assert blocks.LAYOUTS[7].header(0x0106) == 0x01060000


def test_every_revision_is_in_all_tables_of_revisions():
    assert set(blocks.LAYOUTS) == {revision for row in MADE_FOR.values() for revision in row}
    assert set(GIT_DESCRIPTIONS) == set(blocks.LAYOUTS) - {7}  # which has none


def test_block_sizes_follow_motors_and_encoders():
    assert [blocks.read_quads(revision) for revision in (7, 8, 9)] == [28, 32, 32]
    assert blocks.read_quads(8, motors=8, encoders=8) == 60
    assert [blocks.hub_read_quads([(revision, "QLA1")] * 2) for revision in (8, 7)] == [67, 59]
