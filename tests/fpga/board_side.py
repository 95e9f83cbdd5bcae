"""Datagrams of the wire, one at a time, as values with all their fields and back; and the blocks in them."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

from trocar.procs.fpga import registers
from trocar.procs.fpga.blocks import layout_of
from trocar.procs.fpga.wire import (
    BLOCK_OVERHEAD_BYTES,
    BLOCK_READ,
    BLOCK_RESPONSE,
    BLOCK_WRITE,
    BUS,
    HOST_ID,
    QUADLET_READ,
    QUADLET_RESPONSE,
    QUADLET_RESPONSE_BYTES,
    QUADLET_WRITE,
    RESPONSE_HEADER_BYTES,
    TRAILER_BYTES,
    Buffer,
    WireError,
    crc_bytes,
)

_REQUEST = struct.Struct(">BBIII")  # flags, generation, q0-q2
_PACKET = struct.Struct(">III")
_QUAD = struct.Struct(">I")
_TRAILER = struct.Struct(">BBBBHH")


def crc(data: Buffer) -> int:
    """CRC-32, polynomial 0x04C11DB7, most significant bit first, initial and final 0xFFFFFFFF."""
    return int.from_bytes(crc_bytes(data), "big")


def _fit(value: int, bits: int, where: str) -> int:
    if not 0 <= value < 1 << bits:
        raise WireError(f"{value} does not fit {bits} bits", where)
    return value


def _block(data: bytes, where: str) -> bytes:
    if len(data) % 4 or not 0 < len(data) <= 0xFFFC:
        raise WireError(f"{len(data)} data bytes; allowed: a multiple of 4 from 4 to 65532", where)
    return data


@dataclass(frozen=True, slots=True)
class WireRequest:
    """A datagram from host to board.

    `data` holds the payload of writes (4 bytes for a quadlet), `length` the requested bytes of a block read. `crc`
    (header) and `data_crc` (block write only) of None are computed when encoding.
    """

    tcode: int
    node: int
    address: int
    tl: int
    generation: int
    flags: int = 0
    data: bytes = b""
    length: int = 0
    bus: int = BUS
    source: int = HOST_ID
    retry: int = 0
    priority: int = 0
    crc: int | None = None
    data_crc: int | None = None

    @property
    def value(self) -> int:
        """Data of a quadlet write."""
        return int.from_bytes(self.data[:4], "big")


def encode_request(request: WireRequest) -> bytes:
    """The datagram of a request; raises WireError if a field does not fit."""
    r = request
    q0 = (_fit(r.bus, 10, "bus") << 22 | _fit(r.node, 6, "node") << 16 | _fit(r.tl, 6, "tl") << 10
          | _fit(r.retry, 2, "retry") << 8 | _fit(r.tcode, 4, "tcode") << 4 | _fit(r.priority, 4, "priority"))
    address = _fit(r.address, 48, "address")
    head = _REQUEST.pack(_fit(r.flags, 8, "flags"), _fit(r.generation, 8, "generation"), q0,
                         _fit(r.source, 16, "source") << 16 | address >> 32, address & 0xFFFFFFFF)
    if r.tcode == QUADLET_WRITE:
        if len(r.data) != 4:
            raise WireError(f"{len(r.data)} data bytes; allowed: 4", "quadlet write")
        head += r.data
    elif r.tcode == BLOCK_WRITE:
        head += _QUAD.pack(len(_block(r.data, "block write")) << 16)
    elif r.tcode == BLOCK_READ:
        head += _QUAD.pack(_fit(r.length, 16, "length") << 16)
    elif r.tcode != QUADLET_READ:
        raise WireError(f"tcode {r.tcode}; allowed: 0, 1, 4, 5", "request")
    head += crc_bytes(head[2:]) if r.crc is None else _QUAD.pack(_fit(r.crc, 32, "crc"))
    if r.tcode != BLOCK_WRITE:
        return head
    return head + r.data + (crc_bytes(r.data) if r.data_crc is None else _QUAD.pack(_fit(r.data_crc, 32, "data crc")))


def _block_length(data: Buffer, at: int, where: str) -> int:
    quad: int = _QUAD.unpack_from(data, at)[0]
    if quad & 0xFFFF:
        raise WireError(f"extended transaction code 0x{quad & 0xFFFF:04X}; allowed: 0", where)
    return quad >> 16


@dataclass(frozen=True, slots=True)
class Trailer:
    """The 8 bytes after every response; times in ticks of 1/49.152 MHz."""

    flags: int = 0
    generation: int = 0
    packet_errors: int = 0
    receive_ticks: int = 0
    total_ticks: int = 0
    spare: int = 0

    @classmethod
    def decode(cls, data: Buffer) -> Trailer:
        """The trailer in exactly 8 bytes."""
        if len(data) != TRAILER_BYTES:
            raise WireError(f"{len(data)} bytes; allowed: {TRAILER_BYTES}", "trailer")
        flags, generation, spare, errors, receive, total = _TRAILER.unpack(data)
        return cls(flags, generation, errors, receive, total, spare)


@dataclass(frozen=True, slots=True)
class Dropped:
    """The 8-byte reply to a read that the board dropped (bus in reset, or another bus generation)."""

    trailer: Trailer


@dataclass(frozen=True, slots=True)
class WireResponse:
    """A datagram from board to host; boards leave the CRCs of their own responses 0."""

    tcode: int
    node: int
    tl: int
    data: bytes
    trailer: Trailer = Trailer()
    rcode: int = 0
    bus: int = BUS
    destination: int = HOST_ID
    retry: int = 0
    priority: int = 0
    reserved: int = 0  # 44 bits
    crc: int = 0
    data_crc: int = 0  # block response only

    @property
    def value(self) -> int:
        """Data of a quadlet response."""
        return int.from_bytes(self.data[:4], "big")


def decode_response(data: Buffer) -> WireResponse | Dropped:
    """The response in a datagram; 8 bytes are a dropped read. Raises WireError for anything else."""
    size = len(data)
    if size == TRAILER_BYTES:
        return Dropped(Trailer.decode(data))
    if size < QUADLET_RESPONSE_BYTES:
        raise WireError(f"{size} bytes; allowed: 8, 28 or more", "response")
    q0, q1, q2 = _PACKET.unpack_from(data)
    tcode = q0 >> 4 & 0xF
    data_crc = 0
    if tcode == QUADLET_RESPONSE:
        end, payload, crc_at = QUADLET_RESPONSE_BYTES, bytes(data[12:16]), 16
    elif tcode == BLOCK_RESPONSE:
        crc_at, end = 16, BLOCK_OVERHEAD_BYTES + _block_length(data, 12, "response")
        payload = bytes(data[RESPONSE_HEADER_BYTES:-12])
    else:
        raise WireError(f"tcode {tcode}; allowed: 6, 7", "response")
    if size != end:
        raise WireError(f"{size} bytes with tcode {tcode}; allowed: {end}", "response")
    if tcode == BLOCK_RESPONSE:
        _block(payload, "block response")
        data_crc = _QUAD.unpack_from(data, size - 12)[0]
    return WireResponse(tcode, q1 >> 16 & 0x3F, q0 >> 10 & 0x3F, payload, Trailer.decode(data[size - TRAILER_BYTES:]),
                        q1 >> 12 & 0xF, q1 >> 22, q0 >> 16, q0 >> 8 & 3, q0 & 0xF, (q1 & 0xFFF) << 32 | q2,
                        _QUAD.unpack_from(data, crc_at)[0], data_crc)


def decode_request(data: Buffer) -> WireRequest:
    """The request in a datagram; raises WireError for anything else. CRCs are kept, not judged (see `crc_ok`)."""
    size = len(data)
    if size < 18:
        raise WireError(f"{size} bytes; a request has at least 18", "request")
    flags, generation, q0, q1, q2 = _REQUEST.unpack_from(data)
    tcode = q0 >> 4 & 0xF
    payload, length, data_crc, crc_at = b"", 0, None, 18
    if tcode == QUADLET_READ:
        crc_at = 14
    elif tcode == QUADLET_WRITE:
        payload = bytes(data[14:18])
    elif tcode not in (BLOCK_WRITE, BLOCK_READ):
        raise WireError(f"tcode {tcode}; allowed: 0, 1, 4, 5", "request")
    if size < crc_at + 4:
        raise WireError(f"{size} bytes with tcode {tcode}; allowed: {crc_at + 4} or more", "request")
    end = crc_at + 4
    if tcode in (BLOCK_WRITE, BLOCK_READ):
        length = _block_length(data, 14, "request")
    if tcode == BLOCK_WRITE:
        end += length + 4
        if size == end:
            payload, length = _block(bytes(data[22:-4]), "block write"), 0
            data_crc = _QUAD.unpack_from(data, size - 4)[0]
    if size != end:
        raise WireError(f"{size} bytes with tcode {tcode}; allowed: {end}", "request")
    address = (q1 & 0xFFFF) << 32 | q2
    return WireRequest(tcode, q0 >> 16 & 0x3F, address, q0 >> 10 & 0x3F, generation, flags, payload, length, q0 >> 22,
                       q1 >> 16, q0 >> 8 & 3, q0 & 0xF, _QUAD.unpack_from(data, crc_at)[0], data_crc)


def crc_ok(request: WireRequest) -> bool:
    """Whether every CRC of the request is correct."""
    return encode_request(replace(request, crc=None, data_crc=None)) == encode_request(request)


def encode_trailer(trailer: Trailer) -> bytes:
    """The 8 bytes; raises WireError where a field does not fit."""
    return _TRAILER.pack(_fit(trailer.flags, 8, "trailer flags"), _fit(trailer.generation, 8, "trailer generation"),
                         _fit(trailer.spare, 8, "trailer spare"), _fit(trailer.packet_errors, 8, "packet errors"),
                         _fit(trailer.receive_ticks, 16, "receive time"), _fit(trailer.total_ticks, 16, "total time"))


def encode_response(response: WireResponse | Dropped) -> bytes:
    """The datagram of a response; raises WireError where a field does not fit."""
    if isinstance(response, Dropped):
        return encode_trailer(response.trailer)
    r = response
    reserved = _fit(r.reserved, 44, "reserved")
    head = _PACKET.pack(
        _fit(r.destination, 16, "destination") << 16 | _fit(r.tl, 6, "tl") << 10 | _fit(r.retry, 2, "retry") << 8
        | _fit(r.tcode, 4, "tcode") << 4 | _fit(r.priority, 4, "priority"),
        _fit(r.bus, 10, "bus") << 22 | _fit(r.node, 6, "node") << 16 | _fit(r.rcode, 4, "rcode") << 12 | reserved >> 32,
        reserved & 0xFFFFFFFF)
    header_crc = _QUAD.pack(_fit(r.crc, 32, "crc"))
    if r.tcode == QUADLET_RESPONSE:
        if len(r.data) != 4:
            raise WireError(f"{len(r.data)} data bytes; allowed: 4", "quadlet response")
        return head + r.data + header_crc + encode_trailer(r.trailer)
    if r.tcode != BLOCK_RESPONSE:
        raise WireError(f"tcode {r.tcode}; allowed: 6, 7", "response")
    return b"".join((head, _QUAD.pack(len(_block(r.data, "block response")) << 16), header_crc, r.data,
                     _QUAD.pack(_fit(r.data_crc, 32, "data crc")), encode_trailer(r.trailer)))


def quadlet_response(node: int, tl: int, value: int, trailer: Trailer) -> bytes:
    """Datagram that answers a quadlet read."""
    return encode_response(WireResponse(QUADLET_RESPONSE, node, tl, _QUAD.pack(_fit(value, 32, "value")), trailer))


def block_response(node: int, tl: int, data: bytes, trailer: Trailer) -> bytes:
    """Datagram that answers a block read with `data` (big-endian quadlets)."""
    return encode_response(WireResponse(BLOCK_RESPONSE, node, tl, data, trailer))


def _words(data: Buffer, where: str) -> tuple[int, ...]:
    if len(data) % 4:
        raise WireError(f"{len(data)} bytes; allowed: whole quadlets", where)
    return struct.unpack(f">{len(data) // 4}I", data)


def _bytes(words: tuple[int, ...], where: str) -> bytes:
    try:
        return struct.pack(f">{len(words)}I", *words)
    except struct.error as error:
        raise WireError("a word does not fit 32 bits", where) from error


@dataclass(frozen=True, slots=True)
class ReadBlock:
    """One board's real-time sample; the tuples hold axis 1 first."""

    timestamp: int
    status: int
    digital_input: int
    temperature: int
    adc: tuple[int, ...]
    position: tuple[int, ...]
    period: tuple[int, ...]
    quarter_1: tuple[int, ...]
    quarter_5: tuple[int, ...]
    running: tuple[int, ...]
    motor_status: tuple[int, ...] = ()


def encode_read_block(block: ReadBlock, firmware: int) -> bytes:
    """The bytes of a real-time block."""
    words = (block.timestamp, block.status, block.digital_input, block.temperature, *block.adc, *block.position,
             *block.period, *block.quarter_1, *block.quarter_5, *block.running, *block.motor_status)
    expected = layout_of(firmware).read_quads
    if len(words) != expected:
        raise WireError(f"{len(words)} quadlets; allowed for Rev {firmware}: {expected}", "real-time block")
    return _bytes(words, "real-time block")


@dataclass(frozen=True, slots=True)
class WriteGroup:
    """One board's part of a real-time write: its id, the DAC words (axis 1 first, as they are on the wire), control."""

    board: int
    dac: tuple[int, ...]
    control: int


def decode_write(data: Buffer, firmware: int) -> tuple[WriteGroup, ...]:
    """The groups of a real-time block write, in wire order."""
    words = _words(data, "real-time write")
    if layout_of(firmware).firmware != 7:
        return _decode_sized_groups(words)
    if len(words) % (registers.AXES + 1):
        raise WireError(f"{len(words)} quadlets; allowed for Rev 7: 5 a board", "real-time write")
    groups = []
    for at in range(0, len(words), (registers.AXES + 1)):
        dac = words[at : at + registers.AXES]
        boards = {word >> registers.DAC_BOARD_SHIFT & 0xF for word in dac}
        if len(boards) != 1:
            raise WireError(f"DAC words of boards {sorted(boards)} in one group", f"real-time write, quadlet {at}")
        groups.append(WriteGroup(boards.pop(), dac, words[at + registers.AXES]))
    return tuple(groups)


def _decode_sized_groups(words: tuple[int, ...]) -> tuple[WriteGroup, ...]:
    groups = []
    at = 0
    while at < len(words):
        length = words[at] & 0xFF
        if words[at] >> 12 or not 2 <= length <= len(words) - at:
            raise WireError(f"header 0x{words[at]:08X}", f"real-time write, quadlet {at}")
        groups.append(WriteGroup(words[at] >> 8, words[at + 1 : at + length - 1], words[at + length - 1]))
        at += length
    return tuple(groups)
