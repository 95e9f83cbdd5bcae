"""The wire protocol of the controllers as pure functions: requests to datagrams, and their responses back to values.

A request is a 2-byte control word and a FireWire request packet; a response is a FireWire response packet and an 8-byte
trailer. CRCs, reserved bits and spare bytes are kept as fields. Everything on the wire is big-endian. The cyclic path
of `io` uses the layouts here on whole arrays instead of the dataclasses.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Final, TypeAlias

UDP_PORT: Final = 1394
MULTICAST: Final = "224.0.0.100"  # Ethernet-only (Rev 9): all boards
FRAME_HEADER_BYTES: Final = 14  # of raw Ethernet: to, from, length
FRAME_DATAGRAM_BYTES: Final = 1023  # firmware treats a longer frame as another protocol
BOARD_MAC: Final = bytes.fromhex("fa610e1394")  # then the board id
GROUP_MAC: Final = bytes.fromhex("fb610e1394ff")  # all boards
BROADCAST: Final = 0x3F  # node number that means every node
BUS: Final = 0x3FF
HOST_ID: Final = 0xFFD0
NO_FORWARD: Final = 0x01  # control flag: do not relay to FireWire
MAX_DATA: Final = 2024  # bytes of a block transfer on any link
TL_COUNT: Final = 64

QUADLET_WRITE: Final = 0
BLOCK_WRITE: Final = 1
QUADLET_READ: Final = 4
BLOCK_READ: Final = 5
READS: Final = (QUADLET_READ, BLOCK_READ)
QUADLET_RESPONSE: Final = 6
BLOCK_RESPONSE: Final = 7

RESPONSE_HEADER_BYTES: Final = 20
TRAILER_BYTES: Final = 8
QUADLET_RESPONSE_BYTES: Final = 28
BLOCK_OVERHEAD_BYTES: Final = 32  # block response without its data

BUS_RESET: Final = 0x01  # trailer flags
DROPPED: Final = 0x02
FPGA_ERROR: Final = 0x04
ETHERNET_ERROR: Final = 0x08

Buffer: TypeAlias = bytes | bytearray | memoryview

_REQUEST = struct.Struct(">BBIII")  # flags, generation, q0-q2
_PACKET = struct.Struct(">III")
_QUAD = struct.Struct(">I")
_TRAILER = struct.Struct(">BBBBHH")
_REVERSED = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))


class WireError(ValueError):
    """Bytes (or values) that are not a valid datagram or block: the problem, and its place."""

    def __init__(self, what: str, where: str) -> None:
        super().__init__(f"{where}: {what}")
        self.what = what
        self.where = where


def crc_bytes(data: Buffer) -> bytes:
    """CRC of `data` in wire byte order (4 bytes)."""
    # CRC-32/BZIP2 is zlib's CRC with every byte and the result mirrored; zlib is far quicker than a table in Python.
    mirrored = zlib.crc32(bytes(data).translate(_REVERSED))
    return mirrored.to_bytes(4, "little").translate(_REVERSED)


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


# -- requests ----------------------------------------------------------------------------------------------------------


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

    @property
    def crc_ok(self) -> bool:
        """Whether every CRC of the request is correct."""
        fresh = encode_request(WireRequest(self.tcode, self.node, self.address, self.tl, self.generation, self.flags,
                                           self.data, self.length, self.bus, self.source, self.retry, self.priority))
        return fresh == encode_request(self)


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


def quadlet_read(node: int, address: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that reads one quadlet."""
    return encode_request(WireRequest(QUADLET_READ, node, address, tl, generation, flags))


def quadlet_write(node: int, address: int, value: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that writes one quadlet."""
    data = _QUAD.pack(_fit(value, 32, "quadlet write"))
    return encode_request(WireRequest(QUADLET_WRITE, node, address, tl, generation, flags, data))


def block_read(node: int, address: int, length: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that reads `length` bytes."""
    return encode_request(WireRequest(BLOCK_READ, node, address, tl, generation, flags, length=length))


def block_write(node: int, address: int, data: bytes, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that writes `data` (big-endian quadlets)."""
    return encode_request(WireRequest(BLOCK_WRITE, node, address, tl, generation, flags, data))


def _block_length(data: Buffer, at: int, where: str) -> int:
    quad: int = _QUAD.unpack_from(data, at)[0]
    if quad & 0xFFFF:
        raise WireError(f"extended transaction code 0x{quad & 0xFFFF:04X}; allowed: 0", where)
    return quad >> 16


# -- responses ---------------------------------------------------------------------------------------------------------


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
