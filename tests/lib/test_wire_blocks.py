from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procs.lib import blocks, registers, wire

word = st.integers(0, 0xFFFFFFFF)
revision = st.sampled_from(registers.FIRMWARE_REVISIONS)


def words(count):
    return st.binary(min_size=4 * count, max_size=4 * count)


def recorded(folder):
    """(firmware, decoded datagram) of every recorded block transfer."""
    for path in sorted(folder.glob("*.jsonl")):
        for line in path.read_text().splitlines():
            row = json.loads(line)
            decode = {"host->board": wire.decode_request, "board->host": wire.decode_response}.get(row.get("dir"))
            if decode:
                yield int(path.name[3]), decode(bytes.fromhex(row["hex"]))


def test_every_recorded_block_encodes_back(data):
    seen = {"read": 0, "hub": 0, "write": 0}
    for firmware, item in recorded(data("golden/wire")):
        if item.tcode == wire.BLOCK_WRITE:
            groups = blocks.decode_write(item.data, firmware)
            assert blocks.encode_write(groups, firmware) == item.data
            seen["write"] += 1
        elif item.tcode == wire.BLOCK_RESPONSE and len(item.data) == 4 * blocks.read_quads(firmware):
            block = blocks.decode_read_block(item.data, firmware)
            assert blocks.encode_read_block(block, firmware) == item.data
            seen["read"] += 1
        elif item.tcode == wire.BLOCK_RESPONSE:
            hub = blocks.decode_hub(item.data, firmware)
            assert blocks.encode_hub(hub, firmware) == item.data
            assert [b.block.board for b in hub.blocks] == sorted(b.block.board for b in hub.blocks)
            assert blocks.hub_read_quads(firmware, len(hub.blocks)) * 4 == len(item.data)
            seen["hub"] += 1
    assert min(seen.values()) > 0


def test_worked_example_of_a_hub_read():
    header = bytes.fromhex("21060096")
    assert blocks.decode_hub_header(int.from_bytes(header, "big"), 8) == (6, 150, False, 33)
    assert blocks.decode_hub_header(0x00060096, 7) == (6, 150, False, 0)
    assert blocks.LAYOUTS[8].header(0x0106) == 0x21060000
    assert blocks.LAYOUTS[7].header(0x0106) == 0x01060000


@given(revision, st.data())
def test_any_real_time_block_survives(firmware, draw):
    payload = draw.draw(words(blocks.read_quads(firmware)))
    assert blocks.encode_read_block(blocks.decode_read_block(payload, firmware), firmware) == payload


@given(revision, st.integers(0, 16), st.data())
def test_any_hub_read_survives(firmware, count, draw):
    layout = blocks.LAYOUTS[firmware]
    payload = bytearray(draw.draw(words(blocks.hub_read_quads(firmware, count))))
    for at in range(0, 4 * layout.hub_quads * count, 4 * layout.hub_quads):
        header = int.from_bytes(payload[at : at + 4], "big") & (layout.check_mask | layout.time_mask)
        payload[at : at + 4] = header.to_bytes(4, "big")
    assert blocks.encode_hub(blocks.decode_hub(payload, firmware), firmware) == payload


@given(st.lists(st.tuples(st.integers(0, 15), st.lists(word, min_size=4, max_size=4), word), max_size=16), revision)
def test_any_write_survives(values, firmware):
    groups = tuple(
        blocks.WriteGroup(b, tuple(w & ~0x0F000000 | b << 24 for w in dac) if firmware == 7 else tuple(dac), control)
        for b, dac, control in values
    )
    assert blocks.decode_write(blocks.encode_write(groups, firmware), firmware) == groups


@pytest.mark.slow
@given(st.binary(max_size=300), st.integers(6, 10))
def test_noise_decodes_or_raises_wire_error(noise, firmware):
    for decode, encode in (
        (blocks.decode_read_block, blocks.encode_read_block),
        (blocks.decode_hub, blocks.encode_hub),
        (blocks.decode_write, blocks.encode_write),
    ):
        try:
            value = decode(noise, firmware)
        except wire.WireError:
            continue
        assert encode(value, firmware) == noise


def test_block_sizes_follow_motors_and_encoders():
    assert [blocks.read_quads(revision) for revision in (7, 8, 9)] == [28, 32, 32]
    assert blocks.read_quads(8, motors=8, encoders=8) == 60
    assert blocks.hub_read_quads(8, 2) == 67 and blocks.hub_read_quads(7, 2) == 59


@pytest.mark.parametrize(
    ("groups", "firmware"),
    [
        ((blocks.WriteGroup(16, (0,) * 4, 0),), 8),
        ((blocks.WriteGroup(1, (0,) * 4, 0),), 7),
        ((blocks.WriteGroup(1, (1 << 32,) * 4, 0),), 8),
        ((blocks.WriteGroup(1, (0,) * 4, 0),), 4),
    ],
)
def test_write_groups_that_do_not_fit_are_refused(groups, firmware):
    with pytest.raises(wire.WireError):
        blocks.encode_write(groups, firmware)
