"""The wire protocol of the controllers as pure functions: requests to datagrams, and the data in their responses.

A request is a 2-byte control word and a FireWire request packet; a response is a FireWire response packet and an 8-byte
trailer. Everything on the wire is big-endian. The cyclic path of `io` uses the layouts here on whole arrays.
"""

from __future__ import annotations

import struct
import zlib
from typing import Final, TypeAlias

UDP_PORT: Final = 1394
MULTICAST: Final = "224.0.0.100"  # Ethernet-only (Rev 9): all boards
PLAIN_FRAMES: Final = 0x0004  # ETH_P_802_2: the kernel's name for frames with a length instead of a protocol
FRAME_HEADER_BYTES: Final = 14  # of raw Ethernet: to, from, length
FRAME_DATAGRAM_BYTES: Final = 1023  # firmware treats a longer frame as another protocol
BOARD_MAC: Final = bytes.fromhex("fa610e1394")  # then the board id
GROUP_MAC: Final = bytes.fromhex("fb610e1394ff")  # all boards
BROADCAST: Final = 0x3F  # node number that means every node
BUS: Final = 0x3FF
HOST_ID: Final = 0xFFD0
NODES: Final = 16
TCODE_AT: Final = 5  # byte of a request with its type, in the upper half
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
ETHERNET_ERROR: Final = 0x08

Buffer: TypeAlias = bytes | bytearray | memoryview

_REQUEST = struct.Struct(">BBIII")  # flags, generation, q0-q2
_QUAD = struct.Struct(">I")
_RESPONSE = struct.Struct(">IIIHH")  # q0, q1, q2, and of a block length and extended transaction code
_REVERSED = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))


class WireError(ValueError):
    """Bytes (or values) that are not a valid datagram or block: the problem, and its place."""

    def __init__(self, what: str, where: str) -> None:
        super().__init__(f"{where}: {what}")


def crc_bytes(data: Buffer) -> bytes:
    """CRC of `data` in wire byte order (4 bytes)."""
    # CRC-32/BZIP2 is zlib's CRC with every byte and the result mirrored; zlib is far quicker than a table in Python.
    mirrored = zlib.crc32(bytes(data).translate(_REVERSED))
    return mirrored.to_bytes(4, "little").translate(_REVERSED)


def _fit(value: int, bits: int, where: str) -> int:
    if not 0 <= value < 1 << bits:
        raise WireError(f"{value} does not fit {bits} bits", where)
    return value


def _request(tcode: int, node: int, address: int, last: tuple[int, int, int], rest: bytes = b"") -> bytes:
    """A request without data of its own; `last`: transaction label, bus generation, control flags."""
    tl, generation, flags = last
    q0 = BUS << 22 | _fit(node, 6, "node") << 16 | _fit(tl, 6, "tl") << 10 | tcode << 4
    packet = _REQUEST.pack(_fit(flags, 8, "flags"), _fit(generation, 8, "generation"), q0,
                           HOST_ID << 16 | _fit(address, 48, "address") >> 32, address & 0xFFFFFFFF) + rest
    return packet + crc_bytes(packet[2:])


def quadlet_read(node: int, address: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that reads one quadlet."""
    return _request(QUADLET_READ, node, address, (tl, generation, flags))


def quadlet_write(node: int, address: int, value: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that writes one quadlet."""
    return _request(QUADLET_WRITE, node, address, (tl, generation, flags), _QUAD.pack(_fit(value, 32, "quadlet write")))


def block_read(node: int, address: int, length: int, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that reads `length` bytes."""
    return _request(BLOCK_READ, node, address, (tl, generation, flags), _QUAD.pack(_fit(length, 16, "length") << 16))


def block_write(node: int, address: int, data: bytes, tl: int, generation: int, flags: int = 0) -> bytes:
    """Datagram that writes `data` (big-endian quadlets)."""
    if len(data) % 4 or not 0 < len(data) <= 0xFFFC:
        raise WireError(f"{len(data)} data bytes; allowed: a multiple of 4 from 4 to 65532", "block write")
    return _request(BLOCK_WRITE, node, address, (tl, generation, flags), _QUAD.pack(len(data) << 16)) + b"".join(
        (data, crc_bytes(data)))


def response_data(datagram: Buffer, tcode: int, node: int) -> bytes | None:
    """The data of a whole response of this kind from this node (BROADCAST: any); None: the datagram is none."""
    size = len(datagram)
    if size < QUADLET_RESPONSE_BYTES:
        return None
    q0, q1, _, length, extended = _RESPONSE.unpack_from(datagram)
    if q0 >> 4 & 0xF != tcode or node not in (q1 >> 16 & 0x3F, BROADCAST):
        return None
    if tcode == QUADLET_RESPONSE:
        return bytes(datagram[12:16]) if size == QUADLET_RESPONSE_BYTES else None
    is_whole = not (extended or length % 4) and 0 < length == size - BLOCK_OVERHEAD_BYTES
    return bytes(datagram[RESPONSE_HEADER_BYTES:-12]) if is_whole else None
