"""The RTPS wire protocol: what is written is read back, and no packet does harm."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from trocar.procs.ros_messages import discovery, rtps
from trocar.procs.ros_messages.rtps import ACKNACK, DATA, GAP, HEARTBEAT, Inbox, Submessage

OURS, THEIRS = b"ours" * 3, b"them" * 3
WRITER, READER = b"\0\0\1\3", b"\0\0\1\4"
NUMBERS = st.integers(1, 1 << 40)
GAP_PART = b"\x08\x01\x1c\x00"  # kind, little-endian, size


def read(*parts: bytes, to: bytes = OURS) -> list[Submessage]:
    return list(rtps.messages(rtps.packet(THEIRS, to, *parts), OURS))


@given(sequence=NUMBERS, payload=st.binary(max_size=40).map(lambda raw: raw + bytes(-len(raw) % 4)),
       inline=st.lists(st.tuples(st.integers(2, 0xFFFF), st.binary(min_size=4, max_size=4)), max_size=3))
def test_a_message_is_read_as_it_was_written(sequence: int, payload: bytes, inline: list[tuple[int, bytes]]) -> None:
    (one,) = read(rtps.data(WRITER, READER, sequence, payload, inline))
    assert one == Submessage(DATA, THEIRS + WRITER, READER, sequence, sequence, inline=tuple(inline), payload=payload)


@given(first=NUMBERS, more=st.integers(0, 1 << 33), count=st.integers(0, 1000))
def test_ranges_are_read_as_they_were_written(first: int, more: int, count: int) -> None:
    beat, gap = read(rtps.heartbeat(WRITER, READER, first, first + more, count),
                     rtps.gap(WRITER, READER, first, first + more))
    assert (beat.kind, beat.first, beat.last, beat.is_final) == (HEARTBEAT, first, first + more, False)
    assert (gap.kind, gap.guid, gap.target, gap.first, gap.last) == (GAP, THEIRS + WRITER, READER, first, first + more)


@given(base=NUMBERS, missing=st.sets(st.integers(0, 255)))
def test_what_is_missing_is_read_as_it_was_written(base: int, missing: set[int]) -> None:
    asked = tuple(base + each for each in sorted(missing))
    (one,) = read(rtps.acknack(WRITER, READER, base, asked, 1))
    assert (one.kind, one.guid, one.target) == (ACKNACK, THEIRS + READER, WRITER)
    assert (one.first, one.missing, one.is_final) == (base, asked, not asked)


def test_what_is_for_another_participant_is_left_out() -> None:
    assert read(rtps.heartbeat(WRITER, READER, 1, 2, 3), to=b"else" * 3) == []
    assert len(read(rtps.heartbeat(WRITER, READER, 1, 2, 3), to=bytes(12))) == 1


@given(packet=st.binary(max_size=200), cut=st.integers(0, 80))
def test_no_packet_raises(packet: bytes, cut: int) -> None:
    whole = rtps.packet(THEIRS, OURS, rtps.data(WRITER, READER, 1, b"\0\3\0\0", [(1000, b"1234")]),
                        rtps.acknack(WRITER, READER, 1, [1, 2], 1))
    for raw in (packet, rtps.HEADER + packet, whole[:20] + packet, whole[:cut], whole[:cut] + packet):
        for one in rtps.messages(raw, OURS):
            discovery.rows_of(one.payload)


@example(first=(1 << 63) - 1, last=(1 << 63) - 1)
@given(first=st.integers(-(1 << 63), (1 << 63) - 1), last=st.integers(-(1 << 63), (1 << 63) - 1))
def test_whatever_numbers_a_writer_has_they_can_be_acknowledged(first: int, last: int) -> None:
    inbox = Inbox()
    parts = (rtps.heartbeat(WRITER, READER, first, last, 1), rtps.data(WRITER, READER, first, b"1234"),
             GAP_PART + READER + WRITER + rtps.number(first) + rtps.number(last) + bytes(4))
    for part in parts:
        for one in read(part):
            inbox.begins(one.first) if one.kind == HEARTBEAT else inbox.put(one)
            rtps.acknack(WRITER, READER, inbox.base, inbox.missing(one.last), 1)


@given(order=st.permutations(range(1, 9)), gaps=st.sets(st.integers(1, 8)))
def test_messages_come_in_order_once_whatever_the_network_does(order: list[int], gaps: set[int]) -> None:
    inbox, turn = Inbox(), list[int]()
    for sequence in (*order, *order):
        kind = GAP if sequence in gaps else DATA
        turn += [one.first for one in inbox.put(Submessage(kind, b"", b"", sequence, sequence))]
    assert turn == [k for k in range(1, 9) if k not in gaps]
    assert inbox.missing(10) == [9, 10] and inbox.base == 9


def test_a_writer_that_forgot_its_first_messages_is_heard_from_there_on() -> None:
    inbox = Inbox()
    assert inbox.put(Submessage(DATA, b"", b"", 1_000_002, 1_000_002)) == []
    assert inbox.begins(1_000_001) == [] and inbox.missing(1_000_002) == [1_000_001, 1_000_002]
    assert inbox.put(Submessage(DATA, b"", b"", 1_000_002, 1_000_002)) == []
    assert [one.first for one in inbox.begins(1_000_002)] == [1_000_002] and inbox.missing(1_000_002) == []
