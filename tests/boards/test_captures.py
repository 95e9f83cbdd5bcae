"""Captures of the original host library played to our boards: replies must be like those it worked with.

Which fields are compared, and which are the stub's own: `captures`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.boards.captures import Capture, Comparison, Exchange, read_capture
from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

ALL = ("d_r7_p0", "d_r7_p1", "d_r7_p2", "d_r8_p0", "d_r8_p1", "d_r8_p2", "d_r9_p0", "d_r9_p1", "d_r9_p2", "d_r9b_p2")
Data = Callable[[str], Path]
Replies = list[wire.Buffer | None]


def bus_of(capture: Capture) -> EmulatedBus:
    """Boards like those of a capture."""
    fpga = "V3" if capture.firmware >= 9 else "V2"
    controllers = (Controller(board, firmware=capture.firmware, fpga=fpga) for board in capture.controllers)
    return EmulatedBus(tuple(controllers), network=capture.network)


@cache
def read(path: Path) -> Capture:
    """Captures do not change."""
    return read_capture(path)


def captured(data: Data, name: str) -> Capture:
    return read(data("golden/wire") / f"{name}.jsonl")


def replayed(capture: Capture, bus: EmulatedBus) -> Replies:
    """Replies of our boards to the requests of a capture, each at its time."""
    replies: Replies = []
    for exchange in capture.exchanges:
        reply = bus.answer(capture.asked(exchange, bus.generation), exchange.tick, capture.board(exchange.to))
        replies.append(None if reply is None else bytes(reply))  # good until the next call only
    return replies


def compared(capture: Capture, generation: int, replies: Replies) -> list[str]:
    comparison = Comparison(capture, generation)
    found = []
    for exchange, reply in zip(capture.exchanges, replies, strict=True):
        found += [f"line {exchange.line}: {text}" for text in comparison.differences(exchange, reply)]
    return found


@pytest.mark.parametrize("name", ALL)
def test_boards_answer_as_the_captured_ones(data: Data, name: str) -> None:
    capture = captured(data, name)
    bus = bus_of(capture)
    assert not compared(capture, bus.generation, replayed(capture, bus))


# -- what the comparison notices ---------------------------------------------------------------------------------------


def stub_of(data: Data, name: str) -> tuple[Capture, Replies]:
    """A capture and its own replies, nodes as they are."""
    capture = captured(data, name)
    capture = dataclasses.replace(capture, hub=capture.boards[0])
    return capture, [exchange.reply for exchange in capture.exchanges]


@pytest.mark.parametrize("name", ALL)
def test_a_capture_is_like_itself(data: Data, name: str) -> None:
    capture, replies = stub_of(data, name)
    assert sum(reply is not None for reply in replies) >= 22
    assert not compared(capture, capture.generation, replies)


@pytest.mark.parametrize("name", ["d_r7_p0", "d_r8_p1", "d_r9_p2", "d_r9b_p2"])
def test_every_reply_missed_or_too_many_or_of_another_length_is_noticed(data: Data, name: str) -> None:
    capture, replies = stub_of(data, name)
    any_reply = next(reply for reply in replies if reply)
    for place, reply in enumerate(replies):
        others = (None, bytes(reply)[:-4], bytes(reply) + bytes(4), b"") if reply else (any_reply,)
        for other in others:
            wrong = [*replies[:place], other, *replies[place + 1:]]
            assert compared(capture, capture.generation, wrong)


def unnoticed(capture: Capture, exchange: Exchange) -> list[int]:
    """Bits of every quadlet of a reply that may be turned without being noticed."""
    comparison = Comparison(capture, capture.generation)
    assert exchange.reply is not None
    comparison.differences(exchange, exchange.reply)  # time stamps are compared from the second sample on
    masks = [0] * (len(exchange.reply) // 4)
    for bit in range(8 * len(exchange.reply)):
        reply = bytearray(exchange.reply)
        reply[bit // 8] ^= 128 >> bit % 8
        if not comparison.differences(exchange, bytes(reply)):
            masks[bit // 32] |= 1 << 31 - bit % 32
    return masks


BLOCK = [0x7FFF, 0x000A_FFFF, *[0xFFFF_FFFF] * 6, *[0xFE00_0000] * 4, *[0] * 16, *[0x2001_0000] * 4]
BLOCK_7 = [0x7FFF, 0x000A_FFF0, *BLOCK[2:28]]


@pytest.mark.parametrize(("name", "tcode", "address", "expected"), [
    ("d_r8_p0", wire.QUADLET_READ, reg.HARDWARE_ID, [0]),
    ("d_r9_p0", wire.QUADLET_READ, reg.ETHERNET, [0]),
    ("d_r8_p0", wire.QUADLET_READ, reg.STATUS, [0x000A_FFFF]),
    ("d_r7_p0", wire.QUADLET_READ, reg.STATUS, [0x000A_FFF0]),
    ("d_r7_p0", wire.BLOCK_READ, reg.REAL_TIME, BLOCK_7),
    ("d_r8_p0", wire.BLOCK_READ, reg.REAL_TIME, BLOCK),
    ("d_r7_p2", wire.BLOCK_READ, reg.HUB, [0x3FFF, *BLOCK_7] * 2),
    ("d_r9_p2", wire.QUADLET_WRITE, reg.QUERY, [0x7FFF, *BLOCK] * 3),
])
def test_every_bit_that_counts_is_noticed(data: Data, name: str, tcode: int, address: int,
                                          expected: list[int]) -> None:
    capture, _ = stub_of(data, name)
    asked = (tcode, address)
    exchange = [x for x in capture.exchanges if x.reply and (x.request.tcode, x.request.address) == asked][-1]
    *masks, trailer, times = unnoticed(capture, exchange)
    assert trailer == 0x6000_0000  # the switch port
    assert not times & 1 << 31  # a receive time beyond the whole
    if len(expected) == 1:
        expected = [0, 0, 0, *expected, 0]
    else:
        timing = [0xFFFF_FFFF] * (address != reg.REAL_TIME)
        expected = [0] * 5 + expected + timing + [0]
    assert not any(mask & ~free for mask, free in zip(masks, expected, strict=True))
