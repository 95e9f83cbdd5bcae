"""Reading an instrument's memory: sequence and times, absence, insertion and removal at any tick."""

from __future__ import annotations

import weakref

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.examples import examples
from trocar.procs.boards.devices.dallas import BIDIRECTIONAL, BUSY, PROBING, Dallas, instrument_memory
from trocar.procs.fpga.instrument import MEMORY_BYTES

MS = 49152
RESET_OK, RESET_NO_ANSWER = 1, 3  # as the tools know them
MEMORY = bytes(k * 7 + k // 256 & 0xFF for k in range(MEMORY_BYTES))
PROBE = 1 + 97_280 + 3 * (48_640 + 2) + 76_801
SLOTS = 7 * 8192
WRITE, READ = SLOTS + 4425, SLOTS + 5949
ANSWERED = 30_001 + 74 + 1476 + 1  # after a command on Rev 7, or after the probe
FIRST_BYTE = ANSWERED + 5650 + 24_577 + WRITE + 1 + 8 * (READ + 1) + 3 * WRITE + 2 + 1
FAMILY_KNOWN = ANSWERED + 5650 + 24_577 + WRITE + 1 + READ + 1


def chunk(dallas: Dallas, tick: int) -> bytes:
    return b"".join(quad.to_bytes(4, "big") for quad in dallas.read(0, 64, tick))


def idle(dallas: Dallas, tick: int) -> bool:
    """As the library asks."""
    return dallas.status(tick) & 0x20F0 == 0


def present(firmware: int = 8) -> Dallas:
    dallas = Dallas(firmware)
    dallas.insert(MEMORY, 0)
    return dallas


@pytest.mark.parametrize("firmware", [7, 8, 9])
def test_whole_memory_is_read_in_eight_chunks(firmware: int) -> None:
    dallas, tick, data = present(firmware), 1000, b""
    assert dallas.status(tick) == 0x00FF_0000 | BIDIRECTIONAL
    dallas.write(2, tick)
    for _ in range(8):
        assert not idle(dallas, tick)
        while not idle(dallas, tick):
            tick += MS
        data += chunk(dallas, tick)
        dallas.write(3, tick)
    assert data == MEMORY
    status = dallas.status(tick + 1000 * MS)
    assert status & 0xFF00_0007 == 0x0B00_0000 | RESET_OK << 1 | 1
    assert 0 < status >> 16 & 0xFF < 246  # rise time: below 5 µs
    assert chunk(dallas, tick + 1000 * MS) == b"\xff" * 256  # past the end


@pytest.mark.parametrize(("firmware", "start"), [(7, 0), (8, PROBE)])
def test_states_follow_each_other_at_their_ticks(firmware: int, start: int) -> None:
    dallas = present(firmware)
    dallas.write(2, 0)
    write, begin, read, store = (6, 12, 7, 13) if firmware == 7 else (10, 16, 11, 17)
    end = FIRST_BYTE + 256 * (READ + 1)
    states = {0: 1, 30_000: 1, 30_001: 2, 30_075: 3, 31_551: 4, 31_552: 5, 31_552 + 30_227: write,
              FIRST_BYTE - 1: begin, FIRST_BYTE: read, FIRST_BYTE + READ: store, end - 1: store, end: 0}
    for tick, state in states.items():
        status = dallas.status(start + tick)
        assert (tick, status >> 4 & 0x1F) == (tick, state)
        assert bool(status & BUSY) == (firmware > 7 and state != 0)
    assert chunk(dallas, start + end) == MEMORY[:256]


def test_rev_8_looks_for_another_interface_first() -> None:
    dallas = present(8)
    dallas.write(2, 0)
    assert dallas.status(0) == BUSY | PROBING | 12 << 4 | BIDIRECTIONAL | 1
    assert dallas.status(PROBE - 1) == BUSY | PROBING | 11 << 4 | BIDIRECTIONAL | RESET_OK << 1 | 1
    assert dallas.status(PROBE) == 0x00FF_0000 | BUSY | 1 << 4 | BIDIRECTIONAL | 1
    assert abs(PROBE / MS - 6.5) < 0.05
    assert present(7).status(0) & PROBING == 0


def test_bytes_appear_one_after_the_other() -> None:
    dallas = present(7)
    dallas.write(0x123 << 16 | 2, 0)
    assert dallas.status(FAMILY_KNOWN - 1) >> 24 == 0
    assert dallas.status(FAMILY_KNOWN) >> 24 == 0x0B
    assert dallas.read(0, 2, FIRST_BYTE + READ) == [0, 0]
    assert dallas.read(0, 2, FIRST_BYTE + READ + 1) == [MEMORY[0x123], 0]
    five = FIRST_BYTE + 5 * (READ + 1)
    assert dallas.read(0, 3, five) == [int.from_bytes(MEMORY[0x123:0x127], "big"), MEMORY[0x127], 0]
    assert dallas.read(63, 2, five)[1] == int.from_bytes(MEMORY[0x123:0x127], "big")


def test_without_an_instrument_nobody_answers_the_reset() -> None:
    dallas = Dallas(7)
    dallas.write(2, 0)
    over = 30_001 + 74 + 1476 + 14_751
    assert dallas.status(over - 1) >> 4 & 0xF == 4
    assert dallas.status(over) == 74 << 16 | BIDIRECTIONAL | RESET_NO_ANSWER << 1 | 1
    assert chunk(dallas, over) == bytes(256)
    dallas.write(3, over)
    assert chunk(dallas, over + 500 * MS) == b"\xff" * 256


def test_failed_reset_keeps_the_last_family_and_chunk() -> None:
    dallas = present()
    dallas.write(2, 0)
    dallas.remove(500 * MS)
    dallas.write(2, 500 * MS)
    assert dallas.status(600 * MS) & 0xFF00_0006 == 0x0B00_0000 | RESET_NO_ANSWER << 1
    assert chunk(dallas, 600 * MS) == MEMORY[:256]


def test_writes_while_reading_are_not_heeded() -> None:
    dallas = present(7)
    dallas.write(2, 0)
    dallas.write(0x100 << 16 | 2, 1000)
    dallas.write(0, 2000)
    assert chunk(dallas, 500 * MS) == MEMORY[:256]
    assert dallas.enabled


def test_line_is_taken_and_left() -> None:
    dallas = Dallas(8)
    for value, taken in ((1, True), (0, False), (3, False), (1, True), (3, True)):
        dallas.write(value, 0)
        assert (dallas.enabled, dallas.status(0) & 1) == (taken, taken)
        dallas = Dallas(8) if not taken else dallas
    assert Dallas(8).status(0) & 0x3F0 == 0


@pytest.mark.parametrize(("firmware", "busy"), [(7, 0), (8, 2 * (WRITE + 2))])
def test_end_of_transfer_changes_nothing_here(firmware: int, busy: int) -> None:
    dallas = present(firmware)
    dallas.write(9, 100)
    assert busy == 0 or not idle(dallas, 100 + busy - 1)
    assert idle(dallas, 100 + busy)
    assert dallas.enabled


def test_removal_within_a_byte_leaves_ones() -> None:
    memory = bytes(MEMORY_BYTES)
    for sampled in range(1, 9):
        dallas = Dallas(7)
        dallas.insert(memory, 0)
        dallas.write(2, 0)
        dallas.remove(FIRST_BYTE + 2 * (READ + 1) + (sampled - 1) * 8192 + 737 + 1)
        ones = 0xFF << sampled & 0xFF
        assert dallas.read(0, 1, 500 * MS) == [ones << 8 | 0xFF]
        assert chunk(dallas, 500 * MS) == bytes([0, 0, ones]) + b"\xff" * 253
    last = Dallas(7)
    last.insert(memory, 0)
    last.write(2, 0)
    last.remove(FIRST_BYTE + 2 * (READ + 1) + 737)  # at the very tick: too late
    assert chunk(last, 500 * MS) == bytes(2) + b"\xff" * 254


def test_instrument_put_back_is_silent_until_the_next_reset() -> None:
    dallas = present(7)
    dallas.write(2, 0)
    dallas.remove(FIRST_BYTE + 100 * (READ + 1))
    dallas.insert(MEMORY, FIRST_BYTE + 100 * (READ + 1) + 10)
    assert chunk(dallas, 500 * MS) == MEMORY[:100] + b"\xff" * 156
    dallas.write(2, 500 * MS)
    assert chunk(dallas, 1000 * MS) == MEMORY[:256]


def test_family_code_is_the_first_byte_of_the_rom() -> None:
    for removed, family in ((FAMILY_KNOWN, 0x0B), (FAMILY_KNOWN - READ - 1, 0xFF)):
        dallas = present(7)
        dallas.write(2, 0)
        dallas.remove(removed)
        assert dallas.status(500 * MS) >> 24 == family


def test_instrument_put_back_within_a_byte_does_not_answer_either() -> None:
    dallas = Dallas(7)
    dallas.insert(bytes(MEMORY_BYTES), 0)
    dallas.write(2, 0)
    dallas.remove(FIRST_BYTE + 8192)
    dallas.insert(bytes(MEMORY_BYTES), FIRST_BYTE + 5 * 8192)
    assert chunk(dallas, 500 * MS) == b"\xfe" + b"\xff" * 255


@pytest.mark.parametrize(("at", "result"), [(30_074, RESET_OK), (30_076, RESET_NO_ANSWER)])
def test_instrument_must_be_in_place_when_the_reset_ends(at: int, result: int) -> None:
    dallas = Dallas(7)
    dallas.write(2, 0)
    dallas.insert(MEMORY, at)
    assert dallas.status(100 * MS) >> 1 & 3 == result
    gone = present(7)
    gone.write(2, 0)
    gone.remove(at + 1000)
    assert gone.status(100 * MS) >> 1 & 3 == RESET_NO_ANSWER


# -- contents ----------------------------------------------------------------------------------------------------------


def test_memory_of_an_instrument_has_its_fields_in_place() -> None:
    memory = instrument_memory("LARGE_NEEDLE_DRIVER", 400006, 7)
    assert len(memory) == 2048
    assert memory[0x80:0x83] == b"997"
    assert memory[0xA4:0xA9] == bytes([0, *(400006).to_bytes(3, "big"), 7])
    assert memory[0x160:0x17C] == b"LARGE_NEEDLE_DRIVER".ljust(28, b"\0")
    rest = memory[:0x80] + memory[0x83:0xA4] + memory[0xA9:0x160] + memory[0x17C:]
    assert set(rest) == {0xFF}
    assert instrument_memory("x" * 28, (1 << 24) - 1, 255)[0x160:0x17C] == b"x" * 28


@cases(("name", "model", "version"), [
    ("x" * 29, 1, 1), ("Größe", 1, 1), ("a\0b", 1, 1), ("x", 1 << 24, 1), ("x", -1, 1), ("x", 1, 256), ("x", 1, -1)])
def test_fields_that_do_not_fit_are_refused(name: str, model: int, version: int) -> None:
    with pytest.raises(ValueError, match="allowed"):
        instrument_memory(name, model, version)


def test_power_up_ends_a_read_and_leaves_nothing_of_it() -> None:
    dallas = present()
    dallas.write(2, 0)
    assert not idle(dallas, PROBE + FIRST_BYTE + 10 * READ)
    reading = weakref.ref(dallas._steps)
    dallas.power_up()
    assert reading() is None, "nobody collects cycles in a running process"
    assert idle(dallas, 2 * PROBE) and chunk(dallas, 2 * PROBE) == bytes(256)
    dallas.write(2, 3 * PROBE)
    assert idle(dallas, 1000 * PROBE) and chunk(dallas, 1000 * PROBE) == MEMORY[:256]


def test_memory_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="2048"):
        Dallas(8).insert(bytes(256), 0)


# -- whoever asks ------------------------------------------------------------------------------------------------------

EVENTS = st.lists(st.tuples(st.integers(0, 90 * MS), st.sampled_from(
    ("insert", "remove", 0, 1, 2, 3, 0x7F0 << 16 | 2, 9))), max_size=8)


@examples(60)
@given(EVENTS, st.integers(5_000, 500_000), st.sampled_from((7, 8)))
@pytest.mark.slow
def test_asking_often_changes_nothing(events: list[tuple[int, int | str]], period: int, firmware: int) -> None:
    seldom, often, tick = present(firmware), present(firmware), 0
    for wait, event in [*events, (200 * MS, 1)]:
        for asked in range(tick, tick + wait, period):
            often.status(asked)
        tick += wait
        for dallas in (seldom, often):
            if isinstance(event, int):
                dallas.write(event, tick)
            elif event == "insert":
                dallas.insert(MEMORY, tick)
            else:
                dallas.remove(tick)
    for later in (0, MS, 10 * MS, 1000 * MS):
        assert seldom.status(tick + later) == often.status(tick + later)
        assert chunk(seldom, tick + later) == chunk(often, tick + later)
