"""A bus of controllers just good enough to test the host's side: registers, blocks, hub memory and faults on demand."""

from __future__ import annotations

import os
import select
import socket
import threading
import time
from dataclasses import dataclass, field

from tests.fpga import board_side
from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.named_port import named
from trocar.procs.io.bus.protocols import BROADCAST_QUERY
from trocar.procs.io.bus.udp import UdpTransport

_COUNTER = iter(range(1, 1 << 16))


def own_address() -> str:
    """An address in 127/8 that no other process or test uses."""
    value = os.getpid() * 40503 + next(_COUNTER) * 7
    return f"127.{100 + value % 100}.{value // 100 % 256}.{1 + value // 25600 % 250}"


@dataclass
class StubBoard:
    board: int
    node: int
    hardware: int = registers.QLA1
    firmware: int = 8
    ethernet: int = 0xA01C0000
    registers: dict[int, int] = field(default_factory=dict)
    sampled_ns: int = 0
    other_host_ns: int = 1 << 62  # how long ago another host sampled, at most
    writes: list[tuple[int, int]] = field(default_factory=list)
    commands: list[board_side.WriteGroup] = field(default_factory=list)

    def read(self, address: int) -> int:
        known = {
            registers.STATUS: 0x40300000 | self.board << 24,
            registers.HARDWARE_ID: self.hardware,
            registers.FIRMWARE: self.firmware,
            registers.ETHERNET: self.ethernet,
            registers.PHY_RESPONSE: 0x13F,
        }
        return self.registers.get(address, known.get(address, 0))

    def sample(self, serial: int) -> board_side.ReadBlock:
        now = time.monotonic_ns()
        ticks = min(min(now - self.sampled_ns, self.other_host_ns) * 49152 // 1_000_000, 0xFFFFFFFF)
        self.sampled_ns = now
        four = tuple(serial << 8 | self.board << 4 | axis for axis in range(4))
        motor = four if self.firmware > 7 else ()
        return board_side.ReadBlock(ticks, self.read(0), 0xFF, 0x3C3E, four, four, four, four, four, four, motor)


class StubBus:
    """A thread that answers for all boards. `fault(request, replies)` may change what is sent."""

    def __init__(self, boards, *, generation=3, hub=0, address="", bind="", port=0):
        self.boards = boards
        self._mask = 0xFFFF
        self.generation = generation
        self.hub = boards[hub]
        self.address = address or own_address()
        first = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        first.bind((bind or self.address, port))
        self.port = first.getsockname()[1]
        self.sockets = [first]
        if self.hub.firmware == 9 and self.hub.board:
            head, _, last = self.address.rpartition(".")
            self.sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self.sockets[1].bind((f"{head}.{int(last) + self.hub.board}", self.port))
        self.heard: list[bytes] = []
        self.fault = lambda request, replies: replies
        self.serial = 0
        self.errors: list[Exception] = []
        self._memory: dict[int, bytes] = {}
        self._before = {}
        self.early_reads = 0  # so many more come before the hub has the blocks of their query
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        for each in self.sockets:
            each.close()
        assert not self.errors, self.errors

    @property
    def trailer(self):
        return board_side.Trailer(generation=self.generation)

    def _serve(self):
        while not self._stop.is_set():
            for each in select.select(self.sockets, (), (), 0.02)[0]:
                datagram, sender = each.recvfrom(4096)
                self.heard.append(datagram)
                try:
                    request = board_side.decode_request(datagram)
                    assert board_side.crc_ok(request)
                    for reply in self.fault(request, self.answer(request)):
                        each.sendto(reply, sender)
                except Exception as error:
                    self.errors.append(error)

    def answer(self, request):
        reading = request.tcode in (wire.QUADLET_READ, wire.BLOCK_READ)
        if request.node != wire.BROADCAST and request.generation != self.generation:
            dropped = board_side.Trailer(wire.DROPPED, self.generation)
            return [board_side.encode_response(board_side.Dropped(dropped))] if reading else []
        if request.node == wire.BROADCAST:
            addressed = [self.hub] if reading else self.boards
        else:
            addressed = [board for board in self.boards if board.node == request.node]
        if not reading:
            self._write(request, addressed)
            return []
        if not addressed:
            return []
        board = addressed[0]
        if request.tcode == wire.QUADLET_READ:
            value = board.read(request.address & 0xFFFF)
            return [board_side.quadlet_response(board.node, request.tl, value, self.trailer)]
        data = self._hub_memory() if request.address == registers.HUB else self._sample(board)
        assert len(data) == request.length
        return [board_side.block_response(board.node, request.tl, data, self.trailer)]

    def _write(self, request, addressed):
        if request.tcode == wire.BLOCK_WRITE:
            for group in board_side.decode_write(request.data, self.boards[0].firmware):
                for board in addressed:
                    if board.board == group.board:
                        board.commands.append(group)
            return
        for board in addressed:
            board.writes.append((request.address, request.value))
        if request.address == registers.QUERY:
            self.serial += 1
            self._before = dict(self._memory)
            self._mask = request.value & 0xFFFF
            for board in self.boards:
                if request.value >> board.board & 1:
                    self._memory[board.board] = self._hub_block(board, request.value >> 16)

    def _sample(self, board):
        self.serial += 1
        return board_side.encode_read_block(board.sample(self.serial), board.firmware)

    def _hub_block(self, board, sequence):
        layout = blocks.LAYOUTS[board.firmware]
        header = layout.header(sequence) | 150 + 500 * board.board & layout.time_mask
        sample = board_side.encode_read_block(board.sample(self.serial), board.firmware)
        return header.to_bytes(4, "big") + sample

    def _hub_memory(self):
        is_early = self.early_reads > 0 and bool(self._before)
        self.early_reads -= is_early
        memory = self._before if is_early else self._memory
        asked = (memory[board] for board in sorted(memory) if self._mask >> board & 1)
        return b"".join(asked) + b"\x17\xf4\x1f\x08"


def eventually_reads(port, tries=50):
    """A bad cycle or two may come first: a late reply, a bus reset to follow."""
    return any(port.read_all() for _ in range(tries))


def bus_of(count, firmware=8, **options):
    """Boards 0…count-1 on nodes in reverse order, so that no test takes a node for a board id."""
    return StubBus([StubBoard(b, count - 1 - b, firmware=firmware) for b in range(count)], **options)


def udp_port_to(name, boards, now_ns, protocol=BROADCAST_QUERY, *, udp_port=wire.UDP_PORT, asked_at="", **options):
    """The port `name`, whose hub listens at `udp_port` instead of 1394."""
    parts = named(name)
    transport = UdpTransport(parts.where, bridge=parts.bridge, udp_port=udp_port, asked_at=asked_at)
    return BusPort(transport, boards, now_ns, PortOptions(protocol, bridge=parts.bridge, **options))


def port_to(bus, protocol=BROADCAST_QUERY, **options):
    options.setdefault("exclusive", False)
    options.setdefault("deadline_ms", 100)  # of a busy machine; the rules are the same
    ids = [board.board for board in bus.boards]
    now_ns = options.pop("now_ns", time.monotonic_ns)
    return udp_port_to(f"udp:{bus.address}", ids, now_ns, protocol, udp_port=bus.port, **options)
