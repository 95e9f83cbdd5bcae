"""What a fuzz sends to emulated boards, and which replies the protocol forbids."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass

import numpy as np

from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.controllers.models import HARDWARE
from trocar.procs.document.system import BusConfig, Controller
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg

MS = 1_000_000
SECOND = 1000 * MS
LONGEST = 2200  # of a random datagram
READS = (wire.QUADLET_READ, wire.BLOCK_READ)

REGIONS = (reg.REAL_TIME, reg.HUB, reg.QUERY, reg.FPGA_PROM, reg.QLA_PROM_COMMAND, reg.QLA_PROM_BUFFER, 0x4000, 0x4080,
           0x4090, 0x40A0, 0x41A0, 0x42A0, 0x44A0, 0x5000, reg.DALLAS_MEMORY, reg.DATA_BUFFER, 0x7400,
           reg.DATA_BUFFER_STATUS, reg.WAVEFORM, 0x9000, 0xA000, 0xB000, 0xFFFF)
BUFFERS = (reg.FPGA_PROM, reg.QLA_PROM_BUFFER, reg.WAVEFORM, reg.WAVEFORM, reg.HUB, reg.DALLAS_MEMORY, 0x4000, 0x9000)
CODES = (0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x9F, 0xAB, 0xB9, 0xC7, 0xD8, 0xFE, 0xFF)  # of the PROMs

# What is written to registers on purpose; elsewhere, and now and then here, anything is.
VALUES = {
    reg.STATUS: (0x000C0000, 0x000C0F0F, 0x000C0000, 0x00080000, 0x00000F0F, 0x00000F00, 0x00030000, 0x00020000,
                 0x01C00000),
    reg.PHY_REQUEST: (0, 1, 0x1100 | 7, 0x1140, 0x1540, 0x1700 | 0x20, 8),
    reg.WATCHDOG: (0, 1, 0x1680, 0xFFFF, 0x80001680),
    reg.DIGITAL_OUTPUT: (0x80000F00, 0x80000100, 0x0F0F, 0x0F00, 0x0305, 0),
    reg.ETHERNET: (1 << 29, 1 << 26, 1 << 26 | 1 << 15 | 1 << 7, 0x03C00000, 0x00780000),
    reg.DALLAS: (2, 2 | 0x80 << 16, 3, 0, 1, 8, 2 | 0x7FF << 16),
}
AXIS_VALUES = {
    reg.DAC: (0xB0008100, 0xB0009000, 0xB000FFFF, 0x80008000, 0xC0008000, 0x80000000, 0x20000000, 0x30000000,
              0xB1008000),
    reg.PWM: (0, 1, 1 << 16, 0x00010001, 0xFFFFFFFF, 0x0064012C),
    reg.MOTOR_CONFIG: (0x80000000, 0x03780418, 0xC3FF7FFF),
}


def read_quads(controller: Controller) -> int:
    """Quadlets of the real-time block of a controller."""
    hardware = HARDWARE[controller.hardware]
    return blocks.read_quads(controller.firmware, hardware.motors, hardware.encoders)


@dataclass(frozen=True)
class Rules:
    """What boards may reply: `forbidden` says what is wrong with a reply, or nothing."""

    bus: BusConfig

    @property
    def _hub(self) -> Controller:
        return self.bus.controllers[0]

    def source(self, flags: int, node: int, to: int) -> set[int]:
        """Source nodes that the reply to a read may have."""
        ids, late, stays = [c.board_id for c in self.bus.controllers], self._hub.firmware > 8, flags & wire.NO_FORWARD
        if self.bus.network == "ethernet":
            here = ids if to == GROUP else [i for i in ids if i == to]
            if not stays:
                return {0} & {node} if here else set()
            return {self._hub.board_id} & set(here) if node == wire.BROADCAST else {node} & set(here)
        own = self._hub.board_id if late and stays else 0
        if node == wire.BROADCAST:
            return set() if late and not stays else {own}
        if node == own:
            return {own}
        return set() if stays else {node} & set(range(len(ids)))

    def forbidden(self, data: bytes, reply: bytes, generation: int, to: int = GROUP) -> str:
        """`generation` is the bus's; empty when the reply may be."""
        if len(data) < 18:
            return "a reply to less than a request"
        flags, stamp, q0, _, q2 = struct.unpack_from(">BBIII", data)
        node, tcode, late = q0 >> 16 & 0x3F, q0 >> 4 & 0xF, self._hub.firmware > 8
        if q0 >> 22 != wire.BUS:
            return "a reply to another bus"
        try:
            response = board_side.decode_response(reply)
        except wire.WireError as error:
            return str(error)
        trailer = response.trailer
        echo = 0x10 if late and flags & wire.NO_FORWARD else 0
        if trailer.flags & 0xF0 & ~(0x60 if late else 0) != echo or trailer.spare or trailer.generation != generation:
            return f"trailer {trailer}"
        dropped = (tcode in READS and node != wire.BROADCAST and stamp != generation
                   and not (late and flags & wire.NO_FORWARD))
        if isinstance(response, board_side.Dropped) != dropped or bool(trailer.flags & wire.DROPPED) != dropped:
            return "dropped and answered do not agree"
        if isinstance(response, board_side.Dropped):
            return ""
        if (response.tl, response.destination) != (q0 >> 10 & 0x3F, wire.HOST_ID) or response.bus != wire.BUS:
            return f"label {response.tl}, destination {response.destination:#x}, bus {response.bus:#x}"
        if any((response.rcode, response.retry, response.priority, response.reserved, response.crc, response.data_crc)):
            return f"bits that are 0 in {response}"
        if tcode in READS:
            return self._of_read(data, response, self.source(flags, node, to))
        return self._of_query(tcode, flags, q2 & 0xFFFF, data, response)

    def _of_read(self, data: bytes, response: board_side.WireResponse, sources: set[int]) -> str:
        if response.node not in sources:
            return f"source node {response.node}; allowed: {sources or 'no reply'}"
        if response.tcode != (data[5] >> 4) + 2:
            return f"tcode {response.tcode}"
        if response.tcode == wire.QUADLET_RESPONSE:
            return self._of_identity(struct.unpack_from(">H", data, 12)[0], response)
        if len(data) < 22:
            return "an unrequested block"
        asked = struct.unpack_from(">H", data, 14)[0]
        if len(response.data) != asked & ~3 or asked > wire.MAX_DATA + 3:
            return f"{len(response.data)} data bytes; asked for: {asked}"
        return ""

    def _of_identity(self, address: int, response: board_side.WireResponse) -> str:
        """Some registers never change."""
        if address not in (reg.HARDWARE_ID, reg.FIRMWARE):
            return ""
        known = {(HARDWARE[c.hardware].identity if address == reg.HARDWARE_ID else c.firmware)
                 for c in self.bus.controllers}
        return "" if response.value in known else f"register {address} reads {response.value:#x}"

    def _of_query(self, tcode: int, flags: int, address: int, data: bytes, response: board_side.WireResponse) -> str:
        """A reply without a read: Ethernet-only, to a query of the hub's board among others."""
        if self.bus.network != "ethernet" or tcode != wire.QUADLET_WRITE or address != reg.QUERY or len(data) < 22:
            return "a reply to a write"
        mask = struct.unpack_from(">H", data, 16)[0]
        asked = [c for c in self.bus.controllers if mask >> c.board_id & 1]
        if not flags & wire.NO_FORWARD or self._hub not in asked or response.node != self._hub.board_id:
            return f"an unsolicited response of {response.node} to mask {mask:#x}"
        wanted = 4 * (sum(read_quads(c) + 1 for c in asked) + 1)
        if response.tcode != wire.BLOCK_RESPONSE or len(response.data) != wanted or wanted > wire.MAX_DATA:
            return f"{len(response.data)} data bytes; wanted: {wanted}"
        return ""


class Sender:
    """Datagrams of every kind for one bus, real and spoilt ones, and when and to whom they go; the same for a seed."""

    def __init__(self, bus: BusConfig, seed: int) -> None:
        self.random = random.Random(seed)
        self.now_ns = 0
        self.generation = 0  # as the host knows it
        self._bus, self._ethernet = bus, bus.network == "ethernet"
        self._ids = [c.board_id for c in bus.controllers]
        self._mask = sum(1 << i for i in self._ids)
        self._hub_bytes = 4 * (sum(read_quads(c) + 1 for c in bus.controllers) + 1)
        self._kinds = (self._cycle, self._quadlet_read, self._quadlet_write, self._quadlet_write, self._block_read,
                       self._block_write)

    def next(self) -> tuple[bytes, int, int]:
        """A datagram, its time of arrival in ns, and its addressee."""
        chance, dice = self.random.random, self.random
        if chance() < 0.03:
            data = dice.randbytes(dice.randrange(LONGEST))
        else:
            data = dice.choice(self._kinds)()
            if chance() < 0.3:
                data = self._spoil(data)
        to = dice.choice((GROUP, *self._ids, dice.randrange(16))) if self._ethernet else GROUP
        return data, self._time(), to

    def _time(self) -> int:
        luck, dice = self.random.random(), self.random
        if luck < 0.004:
            self.now_ns += dice.randrange(100 * MS)
        elif luck < 0.005:
            self.now_ns += dice.randrange(600 * SECOND)
        elif luck < 0.02:
            return self.now_ns - dice.randrange(2 * SECOND)
        elif luck < 0.8:
            self.now_ns += dice.randrange(700_000)
        return self.now_ns

    # -- real requests -------------------------------------------------------------------------------------------------

    def _head(self) -> tuple[int, int, int, int]:
        """Node, transaction label, generation and flags."""
        dice = self.random
        flags = int(dice.random() < (0.9 if self._ethernet else 0.1))
        nodes = self._ids if flags else range(len(self._ids))
        node = wire.BROADCAST if dice.random() < 0.3 else dice.choice(nodes)
        return node, dice.randrange(64), self.generation, flags

    def _cycle(self) -> bytes:
        """What a running host sends."""
        dice, (node, tl, generation, flags) = self.random, self._head()
        kind = dice.randrange(4)
        if kind == 0:
            mask = self._mask if dice.random() < 0.7 else dice.getrandbits(16)
            value = dice.getrandbits(16) << 16 | mask
            return wire.quadlet_write(wire.BROADCAST, reg.QUERY, value, tl, generation, flags)
        if kind == 1:
            return wire.block_read(node, reg.HUB, self._hub_bytes, tl, generation, flags)
        if kind == 2:
            length = 4 * read_quads(dice.choice(self._bus.controllers))
            return wire.block_read(node, reg.REAL_TIME, length, tl, generation, flags)
        everyone = dice.random() < 0.7
        boards = self._bus.controllers if everyone else [dice.choice(self._bus.controllers)]
        quads = [quad for c in sorted(boards, key=lambda c: c.board_id) for quad in self._group(c)]
        data = struct.pack(f">{len(quads)}I", *quads)
        return wire.block_write(wire.BROADCAST if everyone else node, reg.REAL_TIME, data, tl, generation, flags)

    def _group(self, controller: Controller) -> list[int]:
        dice, motors = self.random, HARDWARE[controller.hardware].motors
        control = dice.choice((0, 0, 0, 0x000C0000, 0x00000F0F, 0x000F0000, dice.getrandbits(20)))
        level = dice.choice((0x8000, 0x8100, 0x9000, 0x7000, dice.getrandbits(16)))
        if controller.firmware == 7:
            words = [reg.DAC_VALID | controller.board_id << 24 | level] * motors
            return [*words, control]
        words = [dice.choice((0xB0000000, 0xB0000000, 0x80000000, dice.getrandbits(16) << 16)) | level] * motors
        return [controller.board_id << 8 | motors + 2, *words, control]

    def _address(self) -> int:
        dice = self.random
        kind = dice.randrange(3)
        if kind == 0:
            return dice.randrange(16)
        if kind == 1:
            return dice.randrange(1, 12) << 4 | dice.randrange(16)
        return dice.choice(REGIONS) + dice.choice((0, 0, 1, 2, 3, dice.randrange(64), dice.randrange(1024))) & 0xFFFF

    def _value(self, address: int) -> int:
        dice = self.random
        if address in (reg.PROM_COMMAND, reg.QLA_PROM_COMMAND) and dice.random() < 0.9:
            return dice.choice(CODES) << 24 | dice.getrandbits(24)
        known = VALUES.get(address) or (AXIS_VALUES.get(address & 0xF) if address < reg.HUB else None)
        if known and dice.random() < 0.9:
            return dice.choice(known)
        return dice.choice((0, 1, 0xFFFFFFFF, 1 << dice.randrange(32), dice.getrandbits(32), dice.getrandbits(32)))

    def _quadlet_read(self) -> bytes:
        node, tl, generation, flags = self._head()
        return wire.quadlet_read(node, self._address(), tl, generation, flags)

    def _quadlet_write(self) -> bytes:
        node, tl, generation, flags = self._head()
        address = self._address()
        return wire.quadlet_write(node, address, self._value(address), tl, generation, flags)

    def _block_read(self) -> bytes:
        dice, (node, tl, generation, flags) = self.random, self._head()
        length = dice.choice((4, 8, 64, 128, 256, 1440, wire.MAX_DATA, 4 * dice.randrange(512), dice.getrandbits(16)))
        return wire.block_read(node, self._address(), length, tl, generation, flags)

    def _block_write(self) -> bytes:
        dice, (node, tl, generation, flags) = self.random, self._head()
        address = dice.choice(BUFFERS) + dice.choice((0, 0, 1, dice.randrange(1024)))
        count = dice.choice((1, 2, 16, 64, 65, dice.randrange(1, 500)))
        if dice.random() < 0.5:
            quads = np.frombuffer(dice.randbytes(4 * count), np.dtype(">u4"))
        else:  # a waveform, or a command and data for a PROM
            short = dice.choice((0, 0xFF, 0xFFFF))
            entries = [1 << 31 | dice.getrandbits(23) & short << 8 | k & 0xF for k in range(count)]
            quads = np.array(entries, np.dtype(">u4"))
            if address == reg.FPGA_PROM:
                quads[0] = dice.choice(CODES) << 24 | dice.getrandbits(24)
        return wire.block_write(node, address & 0xFFFF, quads.tobytes(), tl, generation, flags)

    # -- spoilt ones ---------------------------------------------------------------------------------------------------

    def _spoil(self, data: bytes) -> bytes:
        dice, spoilt = self.random, bytearray(data)
        for _ in range(dice.choice((1, 1, 1, 2, 4))):
            kind = dice.randrange(10)
            if kind == 0:
                del spoilt[dice.randrange(len(spoilt) + 1) :]
            elif kind == 1:
                spoilt += dice.randbytes(dice.choice((1, 4, 8, dice.randrange(LONGEST))))
            elif kind < 4:
                if spoilt:
                    spoilt[dice.randrange(len(spoilt))] ^= 1 << dice.randrange(8)
            elif len(spoilt) >= 18:
                self._overwrite(spoilt, kind)
        return bytes(spoilt)

    def _overwrite(self, spoilt: bytearray, kind: int) -> None:
        """One field of a header gets another value."""
        dice = self.random
        if kind == 4:
            spoilt[0] = dice.choice((0, 1, 2, 0xFF, dice.getrandbits(8)))
        elif kind == 5:
            spoilt[1] = dice.choice((self.generation + 1 & 0xFF, self.generation - 1 & 0xFF, dice.getrandbits(8)))
        elif kind == 6:
            struct.pack_into(">H", spoilt, 2, 0xFFC0 | dice.randrange(64))
        elif kind == 7:
            spoilt[5] = spoilt[5] & 0xF | dice.randrange(16) << 4
        elif kind == 8:
            struct.pack_into(">H", spoilt, 12, dice.choice((self._address(), dice.getrandbits(16))))
        else:
            length = dice.choice((0, 1, 3, 4, len(spoilt), wire.MAX_DATA + 4, 0xFFFC, 0xFFFF, dice.getrandbits(16)))
            struct.pack_into(">H", spoilt, 14, length)
