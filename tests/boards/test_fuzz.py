"""Anything may arrive at the boards: no crash, no reply that is forbidden, no datagram that costs much, memory flat."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import random
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from time import thread_time_ns

import numpy as np
import psutil
import pytest

from tests.boards.fuzzing import MS, SECOND, Rules, Sender, read_quads
from tests.boards.served import Served
from tests.cases import cases
from tests.conftest import ROOT
from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.controllers.models import HARDWARE
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.config import load_system
from trocar.procs.document.system import BusConfig, Controller, SystemConfig
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg

# of CPU time for one datagram: a hundred physics steps to be made up for (25 ms; ten times that on test boards, where
# PWM drives the encoders of all boards edge by edge), and a busy machine
MAX_NS = 500 * MS
MAX_OBJECTS, MAX_BYTES = 500, 8 << 20  # more at the end of a fuzz than in its middle
SEED = 20250704


def _boards(ids: str, firmware: int, fpga: str, **rest: str) -> tuple[Controller, ...]:
    return tuple(Controller(int(i), firmware=firmware, fpga=fpga, **rest) for i in ids.split())


MIXED = (Controller(7, qla="1.5"), Controller(2, "DQLA", 9, "V3", qla="1.5"), Controller(6, firmware=7),
         Controller(11, "dRA1", 8, "V3"), Controller(4, "dRA1", 9, "V3"), Controller(13, firmware=9, fpga="V3"))
MIXED_9 = (Controller(6, firmware=9, fpga="V3", qla="1.5"), Controller(2, "DQLA", 9, "V3", qla="1.5"),
           Controller(7, firmware=9, fpga="V3"), Controller(0, "dRA1", 9, "V3"))
TESTED = (Controller(1), Controller(0, firmware=7), Controller(5, firmware=9, fpga="V3", qla="1.5"))


def _bus(controllers: tuple[Controller, ...], network: str = "bridge", testboard: bool = False) -> BusConfig:
    return BusConfig("IO1", "127.0.0.1", controllers, network, testboard)


BUSES = {  # the demo's robot hangs on boards 6 and 7
    "rev-7": _bus(_boards("7 6 0", 7, "V2")),
    "rev-8": _bus(_boards("9 6 7", 8, "V2")),
    "rev-8-many": _bus(_boards("0 1 2 3 4 5 6 7 8 9", 8, "V3", qla="1.5")),
    "rev-9-bridge": _bus(_boards("6 7 15", 9, "V3")),
    "rev-9-ethernet": _bus(_boards("7 6 1", 9, "V3"), "ethernet"),
    "mixed-bridge": _bus(MIXED),
    "mixed-ethernet": _bus(MIXED_9, "ethernet"),
    "testboard": _bus(TESTED, testboard=True),
}


class Fuzzed:
    """The demo's robot on another bus, the datagrams sent to it, and a check of all that comes back."""

    def __init__(self, name: str, seed: int) -> None:
        self.name, bus = name, BUSES[name]
        self.world = Emulation(system := _system(bus), Plant(system), 0)
        self.rules, self.sender = Rules(bus), Sender(bus, seed)
        self.replies: Counter[str] = Counter()
        self.dearest_ns = 0

    def _write(self, board: Controller, data: Callable[..., bytes], address: int, value: int | bytes) -> None:
        controllers, ethernet = self.rules.bus.controllers, self.rules.bus.network == "ethernet"
        node, to = (board.board_id, board.board_id) if ethernet else (controllers.index(board), GROUP)
        request = data(node, address, value, 1, self.world.buses[0].generation, int(ethernet))
        assert self.world.answer(0, request, self.sender.now_ns, to) is None

    def settle(self) -> int:
        """Whoever is configured comes back, nothing is played, buffers are full of large numbers: objects then."""
        full = np.full(256, 0x7FFF_FFFF, np.dtype(">u4")).tobytes()
        for _ in range(2):
            self.sender.now_ns += 2 * SECOND
            self.world.advance(self.sender.now_ns)
            for board in self.rules.bus.controllers:
                for part in range(0, 1024, 256):
                    self._write(board, wire.block_write, reg.WAVEFORM + part, full)
                self._write(board, wire.quadlet_write, reg.DIGITAL_OUTPUT, 0)
                self._write(board, wire.quadlet_write, reg.DALLAS, 3)
                self._write(board, wire.quadlet_write, reg.axis_register(0, reg.DAC), reg.DAC_VALID | reg.DAC_COLLECT)
        self.sender.generation = self.world.buses[0].generation
        return sys.getallocatedblocks()

    def send(self, count: int) -> None:
        sender, bus = self.sender, self.world.buses[0]
        for number in range(count):
            data, at_ns, to = sender.next()
            where = f"{self.name}, datagram {number} of {count}, at {at_ns} ns to {to}: {data.hex()}"
            begin = thread_time_ns()
            try:
                reply = self.world.answer(0, data, at_ns, to)
            except Exception as error:
                error.add_note(where)
                raise
            used = thread_time_ns() - begin
            assert used <= MAX_NS, f"{used / 1e6:.1f} ms of CPU time; {where}"
            self.dearest_ns = max(self.dearest_ns, used)
            sender.generation = bus.generation
            if reply is None:
                self.replies["none"] += 1
                continue
            wrong = self.rules.forbidden(data, bytes(reply), bus.generation, to)
            assert not wrong, f"{wrong}; {where}; reply {bytes(reply[:64]).hex()}"
            self.replies["dropped" if len(reply) == 8 else f"to tcode {data[5] >> 4}"] += 1


@cache
def _system(bus: BusConfig) -> SystemConfig:
    """The demo on this bus; on a test board without its robot."""
    loaded = load_system(ROOT / "configs" / "systems" / "demo.yaml", boards="emulated", name="fuzz")
    system = loaded.system
    assert system is not None and system.emulation is not None, loaded.errors
    ios, arms = system.ios, system.arms
    if bus.testboard:
        ios = tuple(dataclasses.replace(io, robots=(), digital_inputs=(), instrument_readers=()) for io in ios)
        arms = ()
    emulation = dataclasses.replace(system.emulation, buses=(bus,), instruments=())
    return dataclasses.replace(system, ios=ios, arms=arms, emulation=emulation)


class FuzzHost:
    """A good host that comes after the fuzz."""

    def __init__(self, fuzzed: Fuzzed) -> None:
        self.world, self.bus = fuzzed.world, fuzzed.rules.bus
        self.ethernet = self.bus.network == "ethernet"
        self.boards = sorted(self.bus.controllers, key=lambda c: c.board_id)
        self.now_ns = fuzzed.sender.now_ns + 10 * SECOND  # whoever was being configured is back
        self.world.advance(self.now_ns)

    @property
    def flags(self) -> int:
        return wire.NO_FORWARD if self.ethernet else 0

    def send(self, data: bytes, to: int = GROUP) -> bytes | None:
        self.now_ns += 100_000
        reply = self.world.answer(0, data, self.now_ns, to)
        return None if reply is None else bytes(reply)

    def write(self, address: int, value: int) -> bytes | None:
        """To all boards."""
        return self.send(wire.quadlet_write(wire.BROADCAST, address, value, 1, self.generation, self.flags))

    def read(self, board: Controller, address: int) -> int:
        node = board.board_id if self.ethernet else self.bus.controllers.index(board)
        reply = self.send(wire.quadlet_read(node, address, 2, self.generation, self.flags), board.board_id
                          if self.ethernet else GROUP)
        response = board_side.decode_response(reply or b"")
        assert isinstance(response, board_side.WireResponse), f"board {board.board_id} does not answer"
        return response.value

    @property
    def generation(self) -> int:
        return self.world.buses[0].generation

    def query(self, sequence: int) -> list[np.ndarray]:
        """A broadcast query; hub blocks by ascending board id."""
        sizes = [read_quads(c) + 1 for c in self.boards]
        reply = self.write(reg.QUERY, sequence << 16 | sum(1 << c.board_id for c in self.boards))
        if not self.ethernet:
            assert reply is None
            length = 4 * (sum(sizes) + 1)
            reply = self.send(wire.block_read(0, reg.HUB, length, 3, self.generation))
        response = board_side.decode_response(reply or b"")
        assert isinstance(response, board_side.WireResponse) and len(response.data) == 4 * (sum(sizes) + 1)
        quads = np.frombuffer(response.data, ">u4").astype(np.int64)
        found, at = [], 0
        while at < len(quads) - 1:  # over Ethernet in any order: the board's id tells
            board = next(c for c in self.boards if c.board_id == reg.board_of(int(quads[at + 1 + blocks.STATUS])))
            found.append((board.board_id, quads[at : at + read_quads(board) + 1]))
            at += read_quads(board) + 1
        return [block for _, block in sorted(found, key=lambda item: item[0])]

    def enable_all(self, values: dict[int, int]) -> None:
        """Current commands and enables: one broadcast write, but to each board its own where groups do not mix."""
        groups = {c.board_id: self._group(c, values[c.board_id]) for c in self.boards}
        if len({c.firmware == 7 for c in self.boards}) == 1:
            self._write_block(wire.BROADCAST, b"".join(groups.values()))
        else:
            for node, c in enumerate(self.bus.controllers):
                self._write_block(node, groups[c.board_id])

    def _group(self, board: Controller, value: int) -> bytes:
        motors = HARDWARE[board.hardware].motors
        if board.firmware == 7:
            quads = [reg.DAC_VALID | board.board_id << 24 | value] * motors + [0xF0F]
        else:
            quads = [board.board_id << 8 | motors + 2, *[0xB000_0000 | value] * motors, 0xF0F]
        return struct.pack(f">{len(quads)}I", *quads)

    def _write_block(self, node: int, data: bytes) -> None:
        assert self.send(wire.block_write(node, reg.REAL_TIME, data, 4, self.generation, self.flags)) is None


def _check_afterwards(fuzzed: Fuzzed) -> None:
    """Physics is finite; query, read, write and power work as ever."""
    world, host = fuzzed.world, FuzzHost(fuzzed)
    for values in (world.position, world.velocity, world.current):
        assert np.isfinite(values).all() and (np.abs(values) < 100.0).all()
    for board in host.boards:
        assert host.read(board, reg.HARDWARE_ID) == HARDWARE[board.hardware].identity
        assert host.read(board, reg.FIRMWARE) == board.firmware
    host.write(reg.WATCHDOG, 0)
    host.write(reg.STATUS, reg.CONTROL_POWER_OFF | reg.CONTROL_AMPS_OFF)
    host.write(reg.STATUS, reg.CONTROL_POWER_ON)
    host.now_ns += 200 * MS
    world.advance(host.now_ns)
    values = {c.board_id: 0x8000 + c.board_id for c in host.boards}
    host.enable_all(values)
    host.now_ns += 10 * MS
    for sequence in (0x1234, 0x1235):
        for board, block in zip(host.boards, host.query(sequence), strict=True):
            layout = blocks.layout_of(board.firmware)
            head = (sequence & layout.sequence_mask) << layout.sequence_shift
            size = len(block) << 24 if layout.has_size else 0
            assert int(block[0]) & ~layout.time_mask == head | size
            status = int(block[1 + blocks.STATUS])
            assert status & reg.STATUS_WATCHDOG == 0 and status & reg.STATUS_MV_GOOD
            if board.hardware == "QLA1":
                assert status >> reg.STATUS_AMP_ON_SHIFT & 0xF == 0xF
    for board in host.boards:
        if board.hardware != "dRA1":  # that has interlocks of its own, and takes commands only when it is on
            assert host.read(board, reg.axis_register(0, reg.DAC)) & 0xFFFF == values[board.board_id]


@pytest.fixture
def no_collector() -> Iterator[None]:
    """As in the real process: what is not freed by itself stays."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def _fuzz(name: str, count: int, seed: int) -> Fuzzed:
    fuzzed, used = Fuzzed(name, seed), []
    for _ in range(4):
        fuzzed.send(count // 4)
        used.append((fuzzed.settle(), psutil.Process().memory_info().rss))
    objects, memory = zip(*used, strict=True)
    assert objects[-1] - objects[1] < MAX_OBJECTS + count // 500, f"objects after each quarter: {objects}"
    assert memory[-1] - memory[1] < MAX_BYTES, f"bytes after each quarter: {memory}"
    assert min(fuzzed.replies[kind] for kind in ("to tcode 4", "to tcode 5")) > count // 100, fuzzed.replies
    assert fuzzed.replies["dropped"], fuzzed.replies
    _check_afterwards(fuzzed)
    return fuzzed


@pytest.mark.slow
@pytest.mark.usefixtures("no_collector")
@pytest.mark.parametrize("name", BUSES)
def test_thousands_of_datagrams_do_no_harm(name: str) -> None:
    _fuzz(name, 1_500, SEED)


@pytest.mark.soak
@pytest.mark.usefixtures("no_collector")
@pytest.mark.parametrize("name", BUSES)
def test_a_million_datagrams_do_no_harm(name: str) -> None:
    fuzzed = _fuzz(name, 1_000_000, SEED + 1)
    print(f"{name}: {dict(fuzzed.replies)}, dearest {fuzzed.dearest_ns / 1e6:.1f} ms")


def test_sockets_bear_any_datagram() -> None:
    dice, sizes = random.Random(SEED), (0, 1, 8, 17, 18, 22, 4096, 4097, 65_507)
    with contextlib.closing(Served()) as served:
        for size in (*sizes, *[dice.randrange(3000) for _ in range(200)]):
            served.host.send(dice.randbytes(size))
            served.endpoints.serve(SECOND)
        assert served.ask(1, reg.HARDWARE_ID) == reg.QLA1
        served.host.setblocking(False)
        with pytest.raises(BlockingIOError):
            served.host.recv(1)


# -- the judge ---------------------------------------------------------------------------------------------------------

RULES = {name: Rules(bus) for name, bus in BUSES.items()}
READ = wire.quadlet_read(1, reg.FIRMWARE, 5, 3)
BLOCK = wire.block_read(1, reg.REAL_TIME, 128, 5, 3)
GOOD = board_side.quadlet_response(1, 5, 8, board_side.Trailer(generation=3))


def _judged(data: bytes, reply: bytes, name: str = "rev-8", to: int = GROUP) -> str:
    return RULES[name].forbidden(data, reply, 3, to)


def test_replies_that_may_be_pass_the_judge() -> None:
    assert _judged(READ, GOOD) == ""
    assert _judged(BLOCK, board_side.block_response(1, 5, bytes(128), board_side.Trailer(generation=3))) == ""
    assert _judged(wire.quadlet_read(1, 0, 5, 2), board_side.encode_trailer(board_side.Trailer(wire.DROPPED, 3))) == ""
    query = wire.quadlet_write(wire.BROADCAST, reg.QUERY, 1 << 16 | 0xC2, 5, 3, wire.NO_FORWARD)
    blocks_of_three = board_side.block_response(7, 5, bytes(4 * 100), board_side.Trailer(0x10, 3))
    assert _judged(query, blocks_of_three, "rev-9-ethernet") == ""


@cases(("data", "reply", "why"), [
    (READ[:17], GOOD, "less than a request"),
    (wire.quadlet_write(1, 0, 0, 5, 3), GOOD, "a reply to a write"),
    (wire.quadlet_write(wire.BROADCAST, reg.QUERY, 1 << 16 | 0x2C0, 5, 3),
     board_side.block_response(0, 5, bytes(400), board_side.Trailer(generation=3)), "a reply to a write"),
    (READ[:2] + b"\x00" + READ[3:], GOOD, "another bus"),
    (wire.quadlet_read(1, 7, 6, 3), GOOD, "label"),
    (wire.quadlet_read(2, 7, 5, 3), GOOD, "source node"),
    (wire.quadlet_read(3, 7, 5, 3), board_side.quadlet_response(3, 5, 8, board_side.Trailer(generation=3)),
     "source node"),
    (wire.quadlet_read(1, 7, 5, 3, wire.NO_FORWARD), GOOD, "source node"),
    (READ, GOOD + b"\0", "29 bytes"),
    (READ, GOOD[:-8] + board_side.encode_trailer(board_side.Trailer(generation=4)), "trailer"),
    (READ, GOOD[:-8] + board_side.encode_trailer(board_side.Trailer(0x10, 3)), "trailer"),
    (READ, GOOD[:8] + b"\1" + GOOD[9:], "bits that are 0"),
    (READ, board_side.quadlet_response(1, 5, 9, board_side.Trailer(generation=3)), "register 7 reads"),
    (READ, board_side.encode_trailer(board_side.Trailer(wire.DROPPED, 3)), "dropped"),
    (wire.quadlet_read(1, 7, 5, 2), GOOD, "dropped"),
    (READ, board_side.block_response(1, 5, bytes(4), board_side.Trailer(generation=3)), "tcode"),
    (BLOCK[:18], board_side.block_response(1, 5, bytes(4), board_side.Trailer(generation=3)), "unrequested"),
    (BLOCK, board_side.block_response(1, 5, bytes(132), board_side.Trailer(generation=3)), "132 data bytes"),
    (wire.block_read(1, 0, 2028, 5, 3), board_side.block_response(1, 5, bytes(2028), board_side.Trailer(generation=3)),
     "2028"),
])
def test_forbidden_replies_are_told(data: bytes, reply: bytes, why: str) -> None:
    assert why in _judged(data, reply)


def test_unsolicited_responses_answer_queries_of_the_hub_only() -> None:
    reply = board_side.block_response(7, 5, bytes(4 * 100), board_side.Trailer(0x10, 3))
    for mask, flags in ((0x42, wire.NO_FORWARD), (0x82, wire.NO_FORWARD)):
        query = wire.quadlet_write(wire.BROADCAST, reg.QUERY, 1 << 16 | mask, 5, 3, flags)
        assert _judged(query, reply, "rev-9-ethernet")
    other = wire.quadlet_write(wire.BROADCAST, reg.DIGITAL_OUTPUT, 1 << 16 | 0xC2, 5, 3, wire.NO_FORWARD)
    assert "a reply to a write" in _judged(other, reply, "rev-9-ethernet")
    late = wire.quadlet_read(wire.BROADCAST, reg.FIRMWARE, 5, 3, wire.NO_FORWARD)
    firmware_9 = board_side.quadlet_response(7, 5, 9, board_side.Trailer(0x10, 3))
    assert _judged(late, firmware_9, "rev-9-ethernet", 7) == ""
    assert "source node" in _judged(late, firmware_9, "rev-9-ethernet", 6)
