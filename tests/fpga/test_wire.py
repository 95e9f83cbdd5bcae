from __future__ import annotations

import json
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.fpga import board_side
from trocar.procs.fpga import wire


def datagrams(folder, direction):
    files = sorted(folder.glob("*.jsonl"))
    assert files
    rows = [json.loads(line) for path in files for line in path.read_text().splitlines()]
    return [(row, bytes.fromhex(row["hex"])) for row in rows if row.get("dir") == direction]


def bits(count):
    return st.integers(0, (1 << count) - 1)


quads = st.integers(1, 100).flatmap(lambda count: st.binary(min_size=4 * count, max_size=4 * count))
trailers = st.builds(board_side.Trailer, bits(8), bits(8), bits(8), bits(16), bits(16), bits(8))


@st.composite
def requests(draw):
    tcode = draw(st.sampled_from([wire.QUADLET_WRITE, wire.BLOCK_WRITE, wire.QUADLET_READ, wire.BLOCK_READ]))
    data = {wire.QUADLET_WRITE: st.binary(min_size=4, max_size=4), wire.BLOCK_WRITE: quads}.get(tcode, st.just(b""))
    return board_side.WireRequest(
        tcode, draw(bits(6)), draw(bits(48)), draw(bits(6)), draw(bits(8)), draw(bits(8)), draw(data),
        draw(bits(16)) if tcode == wire.BLOCK_READ else 0, draw(bits(10)), draw(bits(16)), draw(bits(2)), draw(bits(4)),
        draw(bits(32)), draw(bits(32)) if tcode == wire.BLOCK_WRITE else None,
    )  # fmt: skip


@st.composite
def responses(draw):
    tcode = draw(st.sampled_from([wire.QUADLET_RESPONSE, wire.BLOCK_RESPONSE]))
    block = tcode == wire.BLOCK_RESPONSE
    return board_side.WireResponse(
        tcode, draw(bits(6)), draw(bits(6)), draw(quads if block else st.binary(min_size=4, max_size=4)),
        draw(trailers), draw(bits(4)), draw(bits(10)), draw(bits(16)), draw(bits(2)), draw(bits(4)), draw(bits(44)),
        draw(bits(32)), draw(bits(32)) if block else 0,
    )  # fmt: skip


def test_crc_has_the_published_check_value():
    assert board_side.crc(b"123456789") == 0xFC891918
    assert wire.crc_bytes(memoryview(b"123456789")) == bytes.fromhex("fc891918")


def test_every_recorded_request_encodes_back(data):
    kinds = {"QR": wire.QUADLET_READ, "QW": wire.QUADLET_WRITE, "BR": wire.BLOCK_READ, "BW": wire.BLOCK_WRITE}
    for row, datagram in datagrams(data("golden/wire"), "host->board"):
        request = board_side.decode_request(datagram)
        assert board_side.encode_request(request) == datagram
        assert (request.tcode, request.tl) == (kinds[row["kind"]], row["tl"])
        assert (request.node, request.address) == (int(row["node"], 16), int(row["addr"], 16))
        assert board_side.crc_ok(request) is row["crc_ok"]


def test_recorded_requests_are_what_the_builders_make(data):
    for _row, datagram in datagrams(data("golden/wire"), "host->board"):
        r = board_side.decode_request(datagram)
        last = (r.tl, r.generation, r.flags)
        built = {
            wire.QUADLET_READ: lambda r=r, last=last: wire.quadlet_read(r.node, r.address, *last),
            wire.QUADLET_WRITE: lambda r=r, last=last: wire.quadlet_write(r.node, r.address, r.value, *last),
            wire.BLOCK_READ: lambda r=r, last=last: wire.block_read(r.node, r.address, r.length, *last),
            wire.BLOCK_WRITE: lambda r=r, last=last: wire.block_write(r.node, r.address, r.data, *last),
        }[r.tcode]()
        assert built == datagram


def test_every_recorded_response_encodes_back(data):
    for row, datagram in datagrams(data("golden/wire"), "board->host"):
        response = board_side.decode_response(datagram)
        assert board_side.encode_response(response) == datagram
        assert (response.tcode == wire.QUADLET_RESPONSE) == (row["kind"] == "QRESP")
        build = board_side.quadlet_response if row["kind"] == "QRESP" else board_side.block_response
        payload = response.value if row["kind"] == "QRESP" else response.data
        assert build(response.node, response.tl, payload, response.trailer) == datagram


def test_eight_bytes_are_a_dropped_read():
    dropped = board_side.decode_response(bytes.fromhex("02030000001a001a"))
    assert dropped == board_side.Dropped(board_side.Trailer(wire.DROPPED, 3, 0, 0x1A, 0x1A))
    assert board_side.encode_response(dropped) == bytes.fromhex("02030000001a001a")


@given(requests())
def test_any_request_survives_the_round_trip(request):
    assert board_side.decode_request(board_side.encode_request(request)) == request


@given(responses())
def test_any_response_survives_the_round_trip(response):
    assert board_side.decode_response(board_side.encode_response(response)) == response


def data_of(datagram, tcode, node):
    """What `response_data` should find, by the whole codec."""
    try:
        response = board_side.decode_response(datagram)
    except wire.WireError:
        return None
    is_it = isinstance(response, board_side.WireResponse) and (response.tcode, response.node) == (tcode, node)
    return response.data if is_it else None


@given(responses(), st.integers(-5, 5), st.integers(0, 31), bits(8))
def test_the_data_of_a_response_is_that_of_a_whole_one_only(response, cut, at, other):
    datagram = bytearray(board_side.encode_response(response))
    tcode, node = response.tcode, response.node
    assert wire.response_data(datagram, tcode, node) == response.data
    assert wire.response_data(datagram, tcode, wire.BROADCAST) == response.data
    assert wire.response_data(datagram, tcode ^ 1, node) is wire.response_data(datagram, tcode, (node + 1) % 63) is None
    datagram = datagram[:cut] if cut < 0 else datagram + bytes(cut)
    datagram[at % len(datagram)] = other
    assert wire.response_data(datagram, tcode, node) == data_of(datagram, tcode, node)


@given(bits(6), bits(16), bits(6), bits(8), quads)
def test_built_requests_carry_good_crcs(node, address, tl, generation, data):
    datagram = wire.block_write(node, address, data, tl, generation)
    assert board_side.crc_ok(board_side.decode_request(datagram))
    for at in (3, -5):
        broken = bytearray(datagram)
        broken[at] ^= 0x40
        assert not board_side.crc_ok(board_side.decode_request(broken))


def again_or_why_not(decode, encode, datagram):
    """What a decoded datagram encodes to; where it cannot be decoded, what is wrong with it, and where."""
    try:
        value = decode(datagram)
    except wire.WireError as error:
        return tuple(str(error).partition(": ")[::2])
    return encode(value)


def is_reason(outcome):
    return isinstance(outcome, tuple) and all(outcome)


@given(st.binary(max_size=80))
def test_random_bytes_decode_or_raise_wire_error(noise):
    request = again_or_why_not(board_side.decode_request, board_side.encode_request, noise)
    response = again_or_why_not(board_side.decode_response, board_side.encode_response, noise)
    assert request == noise or is_reason(request)
    assert response == noise or is_reason(response)


def test_mangled_recordings_decode_or_raise_wire_error(data):
    dice = random.Random(5)
    outcomes = {"whole": 0, "refused": 0}
    for direction, decode, encode in (
        ("host->board", board_side.decode_request, board_side.encode_request),
        ("board->host", board_side.decode_response, board_side.encode_response),
    ):
        for _row, datagram in datagrams(data("golden/wire"), direction):
            mangled = bytearray(datagram)
            for _ in range(dice.randint(1, 4)):
                mangled[dice.randrange(len(mangled))] = dice.randrange(256)
            cut = bytes(mangled[: dice.choice([len(mangled), dice.randrange(len(mangled) + 1)])])
            outcome = again_or_why_not(decode, encode, cut)
            assert outcome == cut or is_reason(outcome)
            outcomes["whole" if outcome == cut else "refused"] += 1
    assert all(outcomes.values()), outcomes


@cases(
    "build",
    [
        lambda: wire.quadlet_read(64, 0, 1, 0),
        lambda: wire.quadlet_read(0, 1 << 48, 1, 0),
        lambda: wire.quadlet_read(0, 0, -1, 0),
        lambda: wire.quadlet_write(0, 0, 1 << 32, 1, 0),
        lambda: wire.block_write(0, 0, b"12345", 1, 0),
        lambda: wire.block_read(0, 0, 1 << 16, 1, 0),
        lambda: board_side.quadlet_response(0, 1, -1, board_side.Trailer()),
        lambda: board_side.block_response(0, 1, b"", board_side.Trailer()),
        lambda: board_side.encode_trailer(board_side.Trailer(generation=256)),
        lambda: board_side.encode_request(board_side.WireRequest(9, 0, 0, 0, 0)),
    ],
)
def test_values_that_do_not_fit_are_refused(build):
    with pytest.raises(wire.WireError):
        build()
