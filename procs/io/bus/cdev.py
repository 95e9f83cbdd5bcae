"""The kernel's FireWire character devices (linux/firewire-cdev.h): requests and events as bytes and back.

Structures are laid out as the C compiler of this machine does it. Payloads are the bytes on the bus: big-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, TypeAlias

from trocar.procs.fpga.wire import Buffer

ABI_VERSION: Final = 4  # the version implemented here; later ones have time stamps in responses
EVENT_BYTES: Final = 4096  # more than any event requested here
ROM_BYTES: Final = 1024
NODE_MASK: Final = 0x3F

# Types of events
BUS_RESET: Final = 0
RESPONSE: Final = 1

# Codes of responses; from 0x10 on the kernel's own
COMPLETE: Final = 0
STALE_GENERATION: Final = 0x13

BROADCAST_BYTES: Final = 512  # it broadcasts at 100 Mbit/s, which has no longer packets
STATE_CLEAR: Final = 0xFFFF_F000_0000  # register of every node; bits written 1 are cleared
CYCLE_MASTER: Final = 0x100
VENDOR: Final = 0xFA610E  # of our boards, in their configuration ROM

_INFO = struct.Struct("@IIQQQI0Q")  # version, ROM length, pointers to ROM and reset event, closure, card
_REQUEST = struct.Struct("@IIQQQI0Q")  # tcode, length, offset, closure, pointer to data, generation
_RESET = struct.Struct("@QIIIIIII0Q")  # closure, type, nodes (device, card, three managers), generation
_RESPONSE = struct.Struct("@QIII")  # closure, type, rcode, length; then data
_ROM = struct.Struct("@4I")

INFO_BYTES: Final = _INFO.size
REQUEST_BYTES: Final = _REQUEST.size
RESET_BYTES: Final = _RESET.size


def _ioctl(direction: int, number: int, size: int) -> int:
    """The code of an ioctl of these devices (1: the kernel reads, 3: reads and writes)."""
    return direction << 30 | size << 16 | ord("#") << 8 | number


GET_INFO: Final = _ioctl(3, 0x00, INFO_BYTES)
SEND_REQUEST: Final = _ioctl(1, 0x01, REQUEST_BYTES)
SEND_BROADCAST_REQUEST: Final = _ioctl(1, 0x12, REQUEST_BYTES)


@dataclass(frozen=True, slots=True)
class BusReset:
    """The bus was reset; in an answer to `GET_INFO`, its present state. Node ids include the bus in the upper ten bits.
    """

    node: int  # of the device
    local_node: int  # of the card
    generation: int

    @property
    def is_local(self) -> bool:
        """Whether the device is the card itself."""
        return self.node == self.local_node


@dataclass(frozen=True, slots=True)
class CdevResponse:
    """Outcome of a request; `data` only for reads that were answered."""

    closure: int
    code: int
    data: bytes = b""


Event: TypeAlias = BusReset | CdevResponse


def decode_event(data: Buffer) -> Event | None:
    """The event in bytes read from a device; None for events of other kinds and for malformed ones."""
    if len(data) < _RESPONSE.size:
        return None
    closure, kind, code, length = _RESPONSE.unpack_from(data)
    if kind == RESPONSE and len(data) >= _RESPONSE.size + length:
        return CdevResponse(closure, code, bytes(data[_RESPONSE.size : _RESPONSE.size + length]))
    if kind == BUS_RESET and len(data) >= _RESET.size:
        _, _, node, local, _, _, _, generation = _RESET.unpack_from(data)
        return BusReset(node, local, generation)
    return None


def encode_info(rom_at: int, reset_at: int) -> bytearray:
    """Request a device's ROM and bus state; the kernel writes them to these addresses, and the card into the answer."""
    return bytearray(_INFO.pack(ABI_VERSION, ROM_BYTES, rom_at, reset_at, 0, 0))


def card_of(info: Buffer) -> int:
    """The card of a device, from the answer to `encode_info`."""
    return int(_INFO.unpack(info)[5])


def encode_request(tcode: int, length: int, offset: int, closure: int, data_at: int, generation: int) -> bytes:
    """One transaction; `length` bytes are written from address `data_at`, or read."""
    return _REQUEST.pack(tcode, length, offset, closure, data_at, generation)


def vendor_of(rom: Buffer) -> int:
    """The vendor in a configuration ROM, as quadlets of this machine; 0 if it has none."""
    first, _, _, fourth = _ROM.unpack_from(rom)
    vendor: int = first & 0xFF_FFFF if first >> 24 == 1 else fourth >> 8  # a minimal ROM is one quadlet
    return vendor
