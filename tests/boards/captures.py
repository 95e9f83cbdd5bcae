"""Captures of the original host library with a board stub, and how replies of ours are compared with the stub's.

Compared, of every request: whether it is answered. Of a reply: length, FireWire header (destination, transaction label,
code, responder, response code, reserved bits), block length, trailer (flags but for the switch port of Rev 9,
generation, spare byte, packet errors). Of registers: as a whole those that say what a board is (hardware, firmware,
Ethernet status, git description, PHY response), and what the requests alone decide. That is, in the status quadlet:
axes, board id, watchdog, DOUT hardware, power and relay as commanded and, in Rev 7, enable requests; encoder counters
and velocity words of motors that never moved; in the motor status what was commanded; time stamps to within half a
millisecond (from the second sample on). In hub memory: number and order of blocks, their sizes, sequence numbers and
mismatch bits.

Only checked to be possible: CRCs (0 or right), times in the trailer, update times (increasing) and the timing quadlet
(not 0). Not compared, because they are the stub's own: inputs, temperatures, converters, pin levels, feedback of
supply, relay and amplifiers. FireWire nodes are renumbered: the stub's hub may be any node, ours is node 0.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tests.fpga import board_side
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg

TIME_STAMP_TICKS = reg.CLOCK_HZ // 2000
_SWITCH_PORT = 0x60  # trailer flags of Rev 9
_STATUS = 0xFFF5_0000  # without supply good, relay feedback
_COUNTER = reg.ENCODER_MASK | reg.ENCODER_OVERFLOW
_COMMANDED = ~(reg.MOTOR_STATUS_AMP_ON | reg.MOTOR_STATUS_AMP_FAULT)
_IDENTITY = (reg.HARDWARE_ID, reg.FIRMWARE, reg.ETHERNET, reg.GIT_DESCRIPTION, reg.PHY_RESPONSE)
_EXACT = ((blocks.POSITION, _COUNTER), (blocks.PERIOD, ~0), (blocks.QUARTER_1, ~0), (blocks.QUARTER_5, ~0),
          (blocks.RUNNING, ~0), (blocks.MOTOR_STATUS, _COMMANDED))  # columns, bits


@dataclass(frozen=True, slots=True)
class Exchange:
    """A request of the host, and the stub's reply or None."""

    line: int  # in the file
    tick: int
    to: str  # address it was sent to
    data: bytes
    reply: bytes | None

    @property
    def request(self) -> board_side.WireRequest:
        """The request, decoded."""
        return board_side.decode_request(self.data)


@dataclass(frozen=True, slots=True)
class Capture:
    """One file: what the boards were, and all exchanges."""

    name: str
    firmware: int
    network: str  # bridge or ethernet
    boards: tuple[int, ...]  # ids by node; Ethernet-only: ascending
    hub: int  # board id
    generation: int
    exchanges: tuple[Exchange, ...]

    @property
    def controllers(self) -> tuple[int, ...]:
        """Board ids as our nodes: the hub first."""
        return (self.hub, *(board for board in self.boards if board != self.hub))

    def node(self, node: int) -> int:
        """Our number of one of the stub's nodes; what is no node stays itself."""
        bridged = self.network == "bridge" and node < len(self.boards)
        return self.controllers.index(self.boards[node]) if bridged else node

    def board(self, to: str) -> int:
        """Id of the board that an address belongs to; -1: all of them, or the only address there is."""
        address = bytes(map(int, to.split(".")))
        own = address[:3] == bytes((127, 0, 0)) and self.firmware >= 9
        return address[3] - 1 if own else -1

    def asked(self, exchange: Exchange, generation: int) -> bytes:
        """The request as it goes to our boards, whose bus has that generation."""
        data = bytearray(exchange.data)
        if data[1] == self.generation:
            data[1] = generation
        node = exchange.request.node
        if self.node(node) != node:
            data[3] = data[3] & 0xC0 | self.node(node)
            crc_at = 14 if exchange.request.tcode == wire.QUADLET_READ else 18
            data[crc_at : crc_at + 4] = wire.crc_bytes(data[2:crc_at])
        return bytes(data)


def read_capture(path: Path) -> Capture:
    """The capture in a file."""
    head, *rows = [json.loads(line) for line in path.read_text().splitlines()]
    exchanges: list[Exchange] = []
    for line, row in enumerate(rows, 2):
        data = bytes.fromhex(row["hex"])
        if row["dir"] == "host->board":
            exchanges.append(Exchange(line, round(row["t"] * reg.CLOCK_HZ), row["dst"], data, None))
        else:
            last = exchanges.pop()
            assert last.reply is None
            exchanges.append(Exchange(last.line, last.tick, last.to, last.data, data))
    status = {x.request.node: x.reply for x in exchanges if x.reply and _asks(x, wire.QUADLET_READ, reg.STATUS)}
    boards = {node: reg.board_of(_response(reply).value) for node, reply in status.items()}
    hub = boards.pop(wire.BROADCAST)
    network = "ethernet" if "Ethernet-only" in head["description"] else "bridge"
    generation = _response(next(x.reply for x in exchanges if x.reply)).trailer.generation
    return Capture(path.stem, int(path.name[3]), network, tuple(boards.values()), hub, generation, tuple(exchanges))


def _asks(exchange: Exchange, tcode: int, address: int) -> bool:
    return exchange.request.tcode == tcode and exchange.request.address == address


def _response(reply: wire.Buffer) -> board_side.WireResponse:
    response = board_side.decode_response(reply)
    assert isinstance(response, board_side.WireResponse)
    return response


class Comparison:
    """Compares replies with those of a capture, one after the other."""

    def __init__(self, capture: Capture, generation: int) -> None:
        """`generation`: of the bus whose replies are compared."""
        self._capture, self._generation = capture, generation
        self._sampled: set[int] = set()

    def differences(self, exchange: Exchange, reply: wire.Buffer | None) -> list[str]:
        """What differs between the stub's reply and this one; nothing where both are silent or all is well."""
        if reply is None or exchange.reply is None:
            return [] if reply is exchange.reply else ["answered" if exchange.reply is None else "not answered"]
        if len(reply) != len(exchange.reply):
            return [f"{len(reply)} bytes instead of {len(exchange.reply)}"]
        try:
            stub, ours = _response(exchange.reply), _response(bytes(reply))
        except (wire.WireError, AssertionError) as error:
            return [f"no response: {error}"]
        found = [*self._header(exchange, stub, ours), *_trailer(stub.trailer, ours.trailer, self._generation)]
        if len(stub.data) != len(ours.data):
            return [*found, f"{len(ours.data)} bytes of data instead of {len(stub.data)}"]
        found += _crcs(bytes(reply), ours)
        return [*found, *self._data(exchange.request.address, _quads(stub), _quads(ours))]

    def _header(self, exchange: Exchange, stub: board_side.WireResponse, ours: board_side.WireResponse) -> list[str]:
        # With "do not forward", Rev 9 names itself by its board id.
        by_id = self._capture.firmware >= 9 and exchange.request.flags & wire.NO_FORWARD
        node = stub.node if by_id else self._capture.node(stub.node)
        return _unequal([(name, getattr(stub, name), getattr(ours, name)) for name in
                         ("tcode", "tl", "rcode", "bus", "destination", "retry", "priority", "reserved")]
                        + [("responder", node, ours.node)])

    def _data(self, address: int, stub: tuple[int, ...], ours: tuple[int, ...]) -> list[str]:
        if len(stub) == 1:
            mask = 0xFFFF_FFFF if address in _IDENTITY else self._status_mask if address == reg.STATUS else 0
            return _unequal([(f"register 0x{address:02X}", stub[0] & mask, ours[0] & mask)])
        if address == reg.REAL_TIME:
            return self._block(stub, ours)
        layout = blocks.layout_of(self._capture.firmware)
        found: list[str] = []
        times = [0]
        for at in range(0, len(stub) - 1, layout.hub_quads):
            found += _unequal([("block header", stub[at] & ~layout.time_mask, ours[at] & ~layout.time_mask)])
            times.append(ours[at] & layout.time_mask)
            end = at + layout.hub_quads
            found += self._block(stub[at + 1 : end], ours[at + 1 : end])
        if sorted(set(times)) != times:
            found.append(f"update times {times[1:]}")
        return found if ours[-1] else [*found, "no timing quadlet"]

    @property
    def _status_mask(self) -> int:
        return _STATUS | (0xF if self._capture.firmware == 7 else 0)

    def _block(self, stub: tuple[int, ...], ours: tuple[int, ...]) -> list[str]:
        mask = self._status_mask
        found = _unequal([("status", stub[blocks.STATUS] & mask, ours[blocks.STATUS] & mask)])
        for columns, mask in _EXACT:
            pairs = zip(stub[columns], ours[columns], strict=True)
            found += _unequal([(f"quadlet {columns.start} on", a & mask, b & mask) for a, b in pairs])
        board = reg.board_of(stub[blocks.STATUS])
        late = ours[blocks.TIMESTAMP] - stub[blocks.TIMESTAMP]
        if board in self._sampled and abs(late) > TIME_STAMP_TICKS:
            found.append(f"time stamp {late} ticks off")
        self._sampled.add(board)
        return found


def _unequal(fields: Iterable[tuple[str, int, int]]) -> list[str]:
    return [f"{name} 0x{ours:X} instead of 0x{stub:X}" for name, stub, ours in fields if stub != ours]


def _trailer(stub: board_side.Trailer, ours: board_side.Trailer, generation: int) -> list[str]:
    found = _unequal([("trailer flags", stub.flags & ~_SWITCH_PORT, ours.flags & ~_SWITCH_PORT),
                      ("generation", generation, ours.generation), ("spare byte", stub.spare, ours.spare),
                      ("packet errors", stub.packet_errors, ours.packet_errors)])
    return found if 0 < ours.receive_ticks <= ours.total_ticks else [*found, "times in the trailer"]


def _crcs(reply: bytes, ours: board_side.WireResponse) -> list[str]:
    at = 16
    fine = ours.crc in (0, board_side.crc(reply[:at])) and ours.data_crc in (0, board_side.crc(ours.data))
    return [] if fine else ["a CRC that is neither 0 nor right"]


def _quads(response: board_side.WireResponse) -> tuple[int, ...]:
    return struct.unpack(f">{len(response.data) // 4}I", response.data)
