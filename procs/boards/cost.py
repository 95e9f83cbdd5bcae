"""Cost of a cycle of the boards process: the measuring half of `trocar bench boards`, in a process of its own.

Started as `python -m trocar.procs.boards.cost SYSTEM DOCUMENT`, with a ring for the state record made beforehand. It
prints `{}` when it is ready; for every input line with a number of seconds it then measures for that time and prints
one line: for every measurement its percentiles in ns of this thread's CPU time a cycle.

A host drives the boards with broadcast query, hub read and broadcast write at 1500 Hz of simulated time, all amplifiers
on, every arm swinging a little. A physics step falls into two of three cycles, so a timed window covers three cycles.
Short blocks of each kind of window alternate, so that a disturbance by other load affects all kinds alike.
"""

from __future__ import annotations

import contextlib
import gc
import json
import math
import socket
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from time import thread_time_ns

import numpy as np

from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.endpoints import Endpoints
from trocar.procs.boards.loop import Publisher
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause

CYCLES = 3  # of a window
WINDOW_NS = 2_000_000  # three periods at 1500 Hz, two physics steps
READ_NS, WRITE_NS = 110_000, 250_000  # after the query
SWING, SWING_SLIDE, SWING_HZ = 0.02, 0.004, 0.5  # rad, m
MAX_OFF = 0.01  # rad or m off the path: less than the swing
SWITCH_ON_WINDOWS = 200  # until the amplifiers are on
BLOCK, WARM_UP = 40, 8  # windows of one kind in a row; the first of them do not count
PERCENTILES = {"p10": 10, "p50": 50, "p99": 99}

Sent = list[tuple[int, bytes]]  # time, ns, and datagram
_BIG_QUAD = np.dtype(">u4")
_AMPS_ON = 0xF << reg.STATUS_AMP_ON_SHIFT


class AskingHost:
    """The other side of the first bus, which is not timed: it holds the robots by their gains on a path."""

    def __init__(self, document: SystemConfig, world: Emulation) -> None:
        """Prepares all data that is constant from cycle to cycle."""
        if document.emulation is None:
            raise ValueError(f"{document.name}: no emulated boards in this system")
        bus = document.emulation.buses[0]
        self._world = world
        self.ids = sorted(c.board_id for c in bus.controllers)
        self._know_robots(document)
        reply = wire.decode_response(world.answer(0, wire.quadlet_read(wire.BROADCAST, reg.STATUS, 1, 0), 0) or b"")
        self._generation = reply.trailer.generation
        self._layout = layout = blocks.layout_of(bus.controllers[0].firmware)
        length = 4 * blocks.hub_read_quads(layout.firmware, len(self.ids))
        self.reply_bytes = length + wire.BLOCK_OVERHEAD_BYTES
        mask = sum(1 << board for board in self.ids)
        self._queries = [wire.quadlet_write(wire.BROADCAST, reg.QUERY, k << 16 | mask, 1, self._generation)
                         for k in range(256)]
        self._read = wire.block_read(0, reg.HUB, length, 2, self._generation)
        self._enable = reg.DAC_VALID | reg.DAC_AMP_MASK | reg.DAC_AMP_ENABLE
        self._groups = np.zeros((len(self.ids), layout.write_quads), _BIG_QUAD)
        self._groups[:, 0] = [board << 8 | layout.write_quads for board in self.ids]
        self._groups[:, 1 : 1 + reg.AXES] = self._enable | reg.CURRENT_ZERO
        self._sequence = 0

    def _know_robots(self, document: SystemConfig) -> None:
        io = document.ios[0]
        actuators = [a for robot in io.robots for a in robot.actuators]
        gains = [axis for robot in io.robots for pid in io.pids if pid.robot == robot.name for axis in pid.axes]
        self._p, self._d = np.array([a.p_gain for a in gains]), np.array([a.d_gain for a in gains])
        self._amperes = np.array([a.effort_to_current for a in actuators])
        self._most = np.array([a.maximum_current for a in actuators])
        self._scale = np.array([a.current_to_bits.scale for a in actuators])
        self._offset = np.array([a.current_to_bits.offset for a in actuators])
        self._swing = np.array([SWING_SLIDE if a.joint_type == "PRISMATIC" else SWING for a in actuators])
        self._middle = self._world.position.copy()
        self._rows = np.array([self.ids.index(a.board_id) for a in actuators])
        self._columns = np.array([1 + a.axis_id for a in actuators])

    def switch_on(self) -> bytes:
        """Motor power and relay of all boards."""
        value = reg.CONTROL_POWER_ON | reg.CONTROL_RELAY_ON
        return wire.quadlet_write(wire.BROADCAST, reg.STATUS, value, 1, self._generation)

    def cycle(self, at_ns: int) -> Sent:
        """Query, read and write of a cycle that begins at this time."""
        self._sequence = self._sequence + 1 & 0xFF
        return [(at_ns, self._queries[self._sequence]), (at_ns + READ_NS, self._read),
                (at_ns + WRITE_NS, self._write(at_ns))]

    def path(self, at_ns: int) -> Floats:
        """Desired positions of the actuators."""
        path: Floats = self._middle + self._swing * math.sin(2 * math.pi * SWING_HZ * at_ns * 1e-9)
        return path

    def _write(self, at_ns: int) -> bytes:
        effort = self._p * (self.path(at_ns) - self._world.position) - self._d * self._world.velocity
        current = np.clip(effort * self._amperes, -self._most, self._most)
        bits = np.clip(np.rint(current * self._scale + self._offset), 0, 0xFFFF).astype(np.int64)
        self._groups[self._rows, self._columns] = self._enable | bits
        return wire.block_write(wire.BROADCAST, reg.REAL_TIME, self._groups.tobytes(), 3, self._generation)

    def check(self, reply: wire.Buffer, at_ns: int) -> None:
        """ValueError unless this is the newest cycle's hub read, all amplifiers are on and arms on their path."""
        response = wire.decode_response(reply)
        if not isinstance(response, wire.WireResponse) or len(reply) != self.reply_bytes:
            raise ValueError(f"hub read: {len(reply)} bytes; wanted: {self.reply_bytes}")
        quads = np.frombuffer(response.data, _BIG_QUAD)[:-1].reshape(len(self.ids), -1)
        heads, header = quads[:, 0] & self._layout.check_mask, self._layout.header(self._sequence)
        if not (heads == header).all():
            raise ValueError(f"hub read: headers {[hex(h) for h in heads.tolist()]}; wanted: {header:#x}")
        status = quads[:, 1 + blocks.STATUS]
        if not (status & (_AMPS_ON | reg.STATUS_WATCHDOG) == _AMPS_ON).all():
            raise ValueError(f"status {[hex(s) for s in status.tolist()]}: not every amplifier is on")
        off = float(np.abs(self._world.position - self.path(at_ns)).max())
        if not off <= MAX_OFF:
            raise ValueError(f"an actuator is {off:.3f} off its path")


class BoardsBench:
    """Boards, robots, host and sockets of one system; measures in turns."""

    def __init__(self, system: str, document: SystemConfig) -> None:
        """Switched on and swinging; `close` it."""
        self.world = world = Emulation(document, Plant(document), 0)
        self.host = AskingHost(document, world)
        self._publisher = Publisher(directory.writer(system, "boards", "state", "boards"), world)
        self._now, self._windows = 0, 0
        buses = document.emulation.buses if document.emulation is not None else ()
        # The boards use the host's time, whatever the sockets report; the cost of reading it from the kernel is
        # unchanged.
        self._server = Endpoints(buses, lambda bus, data, _, to: world.answer(bus, data, self._now, to), monotonic_ns,
                                 False)
        self._client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._client.connect((buses[0].address, wire.UDP_PORT))
        self._client.settimeout(1.0)
        self._buffer = bytearray(2 * wire.MAX_DATA)
        world.answer(0, self.host.switch_on(), 0)
        for _ in range(SWITCH_ON_WINDOWS):
            self.whole(self._next())

    def close(self) -> None:
        """Close the sockets."""
        self._client.close()
        self._server.close()

    def turn(self, seconds: float) -> dict[str, dict[str, int]]:
        """Alternate blocks of all kinds of window for this long; percentiles of all measurements, ns a cycle."""
        times: dict[str, list[int]] = defaultdict(list)
        end = monotonic_ns() + round(seconds * 1e9)
        while not times or monotonic_ns() < end:
            for measure in (self.whole, self.parts, self.sockets, self.paused):
                for number in range(BLOCK):
                    found = measure(self._next())
                    if number >= WARM_UP:
                        for name, ns in found.items():
                            times[name].append(ns)
        self._check()
        return {name: summary(found) for name, found in times.items()}

    def _next(self) -> Sent:
        """The datagrams of the next window."""
        self._windows += 1
        begin = self._windows * WINDOW_NS
        return [each for k in range(CYCLES) for each in self.host.cycle(begin + k * WINDOW_NS // CYCLES)]

    def _check(self) -> None:
        self._windows += 1
        begin = self._windows * WINDOW_NS
        replies = [self.world.answer(0, data, at) for at, data in self.host.cycle(begin)]
        self.host.check(replies[1] or b"", begin)

    # -- kinds of window: kind of measurement, and ns of CPU time in it ------------------------------------------------

    def whole(self, sent: Sent) -> dict[str, int]:
        """Answers and physics, without the sockets."""
        answer = self.world.answer
        begin = thread_time_ns()
        for at, data in sent:
            answer(0, data, at)
        return {"whole": thread_time_ns() - begin}

    def paused(self, sent: Sent) -> dict[str, int]:
        """The same after a pause as long as the window: as in real time, other processes have used the caches."""
        pause(WINDOW_NS * 1e-9)
        return {"paused": self.whole(sent)["whole"]}

    def sockets(self, sent: Sent) -> dict[str, int]:
        """The same with the server's calls of the kernel: wait, receive, send."""
        used = 0
        for number, (at, data) in enumerate(sent):
            self._now = at
            self._client.send(data)
            begin = thread_time_ns()
            self._server.serve(WINDOW_NS)
            used += thread_time_ns() - begin
            if number % CYCLES == 1 and self._client.recv_into(self._buffer) != self.host.reply_bytes:
                raise ValueError("the hub's reply differs over the sockets")
        return {"sockets": used}

    def parts(self, sent: Sent) -> dict[str, int]:
        """Physics, datagrams and state record separately; the cost of reading the clock is subtracted."""
        used = dict.fromkeys(("physics", "query", "read", "write", "record"), 0)
        begin = thread_time_ns()
        clock = thread_time_ns() - begin

        def timed(name: str, what: Callable[..., object], *arguments: object) -> None:
            begin = thread_time_ns()
            what(*arguments)
            used[name] += thread_time_ns() - begin - clock

        for number, (at, data) in enumerate(sent):
            part = ("query", "read", "write")[number % CYCLES]
            stepped = self.world.board_ns
            if part == "query":
                timed("physics", self.world.advance, at)
            if self.world.board_ns != stepped:
                timed("record", self._publisher.publish)
            timed(part, self.world.answer, 0, data, at)
        return {**used, "answering": used["query"] + used["read"] + used["write"]}


def summary(windows: list[int]) -> dict[str, int]:
    """Percentiles of the mean times of a cycle in each window, ns."""
    values = np.percentile(windows, list(PERCENTILES.values())) / CYCLES
    return {**dict(zip(PERCENTILES, np.rint(values).astype(int).tolist(), strict=True)), "n": len(windows)}


def main() -> None:
    """A turn for every line, until the other side closes."""
    if len(sys.argv) != 3:
        sys.exit("started by: trocar bench boards")
    system, file = sys.argv[1:]
    with contextlib.closing(BoardsBench(system, from_json(Path(file).read_bytes()))) as bench:
        gc.collect()
        gc.freeze()
        gc.disable()
        sys.stdout.write("{}\n")
        sys.stdout.flush()
        for line in sys.stdin:
            sys.stdout.write(json.dumps(bench.turn(float(line))) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
