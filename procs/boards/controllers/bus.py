"""Datagrams in, datagrams out: which board of a bus an Ethernet packet reaches, which one answers, and which packets
are dropped.

As a bridge (any firmware and FPGA) only the board with node 0 is plugged into the network, the hub; it relays to the
others over FireWire. Ethernet-only (Rev 9 on FPGA V3) every board is plugged in, with an address of its own; packets
for all boards arrive by multicast, and the hub, nearest to the host, answers a broadcast query alone.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from trocar.procs.boards.controllers.block_writes import WriteDecoder
from trocar.procs.boards.controllers.firmware import Firmware
from trocar.procs.boards.controllers.hub import HubMemory
from trocar.procs.boards.controllers.lines import NEVER, Lines
from trocar.procs.boards.controllers.models import models_of, width_of
from trocar.procs.boards.devices.network import DESTINATION_ERROR
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

RECEIVE_TICKS, ANSWER_TICKS = 0x00C8, 0x0D54
REBOOT_TICKS = reg.CLOCK_HZ  # a board is absent for 1 s while its FPGA is reconfigured
GROUP = -1  # addressed to all boards: broadcast or multicast
REPORT_TICKS = 1600  # Ethernet-only: about 32 µs a board until all blocks have been exchanged

_Head = tuple[int, int, int, int]  # control flags, generation, first quadlet, address
_HEAD = struct.Struct(">BBIII")
_QUAD = struct.Struct(">I")
_REPLY = struct.Struct(">IIIII")
_TRAILER = struct.Struct(">BBBBHH")
_DATA_AT = 22  # payload of a block write


class EmulatedBus:
    """The controllers of one bus; the first one listed is the hub."""

    def __init__(self, controllers: tuple[Controller, ...], lines: Lines | None = None, *,
                 network: str = "bridge", testboard: bool = False) -> None:
        """Boards as after power-up at tick 0; `lines` (rows by ascending board id) connect them to the world,
        and `testboard` to the loop-back board of the original test programs.

        ValueError for controllers there never were, and for Ethernet-only ones that need FireWire.
        """
        models = models_of(controllers)
        if network == "ethernet" and (bad := [m for m in models if m.firmware < 9 or m.fpga != 3]):
            raise ValueError(f"board {bad[0].board_id}: firmware {bad[0].firmware} on FPGA V{bad[0].fpga}; "
                             "Ethernet-only buses need firmware 9 on FPGA V3")
        lines = lines or Lines.of(len(models), width_of(models))
        self.firmware = firmware = Firmware(models, lines, testboard=testboard)
        self.power, self.encoders, self.lines = firmware.power, firmware.encoders, lines
        self.boards, self.count, self.ids = firmware.boards, firmware.count, firmware.ids
        self.over_ethernet = network == "ethernet"
        self.generation = 1
        self.now = 0  # tick of the newest datagram or step
        self.packets = 0
        self.errors = 0
        self.hub_memory = HubMemory(firmware, self.over_ethernet)
        self._commands = WriteDecoder(firmware)
        self._nodes = sorted(range(self.count), key=lambda row: models[row].node)  # rows by place on the cable
        self._hub = self._nodes[0]
        self._revision = [model.firmware for model in models]
        self._gone = [False] * self.count  # without power: not on the bus
        self._silent_until = [0] * self.count  # on the bus, but its FPGA is being configured
        self._next_return = NEVER
        self._node_of = [0] * self.count
        self._row_of: dict[int, int] = {}
        self._row_of_id = {board: row for row, board in enumerate(self.ids)}
        self._every = tuple(range(self.count))
        self._number_nodes()

    def _number_nodes(self) -> None:
        """Nodes are counted along the cable, over the boards that have power."""
        on_bus = [row for row in self._nodes if not self._gone[row]]
        self._row_of = {} if self.over_ethernet else dict(enumerate(on_bus))
        for node, row in enumerate(on_bus):
            self._node_of[row] = 0 if self.over_ethernet else node
            self.boards[row].network.phy.bus_reset(self._node_of[row])
        self._see_who_is_there()

    def _see_who_is_there(self) -> None:
        there = [row for row in self._every if not self._gone[row] and not self._silent_until[row]]
        self._there = tuple(there) if len(there) < self.count else self._every
        self.hub_memory.absent = frozenset(self._every).difference(there)
        self._next_return = min((tick for tick in self._silent_until if tick), default=NEVER)

    # -- bus events ----------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """A FireWire bus reset: a new generation, and nodes renumbered."""
        self.generation = (self.generation + 1) & 0xFF
        self._number_nodes()

    def take_away(self, row: int, gone: bool) -> None:
        """A board loses its power, or returns as after power-up; the others are renumbered."""
        self._gone[row] = gone
        self._silent_until[row] = 0
        if gone:
            self.power.cut(row, self.now)
        else:
            self.firmware.power_up(row, self.now)
        self.reset()

    def step(self, tick: int) -> None:
        """A physics step ends at `tick`."""
        self.now = max(self.now, tick)
        self.firmware.step(self.now)
        self._let_return()

    def _let_return(self) -> None:
        if self._next_return <= self.now:
            for row in self._every:
                if 0 < self._silent_until[row] <= self.now:
                    self._silent_until[row] = 0
                    self.firmware.power_up(row, self.now)
            self.reset()

    def board_at(self, address: bytes) -> int | None:
        """Id of the board that has this IP address (four bytes); None: no board has it."""
        ip = int.from_bytes(address, "little")  # the register has the last octet on top
        return next((board.model.board_id for board in self.boards if board.network.ip == ip), None)

    # -- datagrams -----------------------------------------------------------------------------------------------------

    def answer(self, data: wire.Buffer, tick: int, to: int = GROUP) -> wire.Buffer | None:
        """Execute a datagram that arrived at `tick`; the reply, or None. A reply is valid until the next call.

        `to` is the board id whose address it was sent to; GROUP for broadcast, multicast and a bridge's own address.
        """
        size = len(data)
        if size < 18:
            self.errors += 1
            return None
        flags, generation, q0, _, address = _HEAD.unpack_from(data)
        self.now = tick = max(self.now, tick)
        if self._next_return <= tick:
            self._let_return()
        if q0 >> 22 != wire.BUS:
            self.errors += 1
            for row in self._plugged_in(to):
                self.boards[row].network.errors |= DESTINATION_ERROR
            return None
        self.packets += 1
        self.power.until(tick)
        if not self.over_ethernet:
            if self._hub not in self._there:
                return None
            return self._receive(self._hub, data, (flags, generation, q0, address & 0xFFFF), tick)
        head = (flags, generation, q0, address & 0xFFFF)
        if to == GROUP and q0 >> 16 & 0x3F == wire.BROADCAST and q0 >> 4 & 0xF not in wire.READS:
            return self._write(self._there, q0 >> 4 & 0xF, data, head, GROUP, tick)
        reply = None
        for row in self._plugged_in(to):
            if row in self._there:
                reply = self._receive(row, data, head, tick) or reply
        return reply

    def _plugged_in(self, to: int) -> tuple[int, ...]:
        """Rows of the boards that receive an Ethernet packet sent `to` a board or all."""
        if not self.over_ethernet:
            return (self._hub,)
        if to == GROUP:
            return self._there
        return (self._row_of_id[to],) if to in self._row_of_id else ()

    def _receive(self, row: int, data: wire.Buffer, head: _Head, tick: int) -> wire.Buffer | None:
        """A datagram reaches the board in `row` by Ethernet."""
        flags, generation, q0, _ = head
        node, tcode, stays = q0 >> 16 & 0x3F, q0 >> 4 & 0xF, bool(flags & wire.NO_FORWARD)
        is_read, late = tcode in wire.READS, self._revision[row] > 8
        if generation != self.generation and node != wire.BROADCAST and not (late and stays):
            return _TRAILER.pack(*self._trailer(row, flags if late else 0, wire.DROPPED)) if is_read else None
        rows = self._addressed(row, node, is_read, stays)
        if is_read:
            return self._read(rows[0], tcode, data, head, tick) if rows else None
        return self._write(rows, tcode, data, head, row, tick)

    def _addressed(self, row: int, node: int, is_read: bool, stays: bool) -> tuple[int, ...]:
        """Rows of the boards that are meant by a datagram for `node` that reached the board in `row`."""
        late, relays = self._revision[row] > 8, not stays and not self.over_ethernet
        if node == wire.BROADCAST:
            if is_read:  # from Rev 9 on the hub alone answers it, where it is not to be relayed
                return (row,) if not late or (stays and row == self._hub) else ()
            return self._there if relays else (row,)
        own = self.ids[row] if late and stays else self._node_of[row]
        target = row if node == own else self._row_of.get(node) if relays else None
        return () if target is None or target not in self._there else (target,)

    def _trailer(self, row: int, flags: int, state: int = 0) -> tuple[int, ...]:
        """Echo of the control flags (Rev 9), the state of the network where the board in `row` is heard, of the bus."""
        sender = self.boards[row if self.over_ethernet else self._hub]
        network_error = wire.ETHERNET_ERROR if sender.network.errors else 0
        return ((flags & wire.NO_FORWARD) << 4 | state | network_error, self.generation, 0, self.errors & 0xFF,
                RECEIVE_TICKS, ANSWER_TICKS)

    # -- reads ---------------------------------------------------------------------------------------------------------

    def _read(self, row: int, tcode: int, data: wire.Buffer, head: _Head, tick: int) -> wire.Buffer | None:
        flags, _, q0, address = head
        source = self.ids[row] if self._revision[row] > 8 and flags & wire.NO_FORWARD else self._node_of[row]
        trailer = self._trailer(row, flags if self._revision[self._hub] > 8 else 0)
        if tcode == wire.QUADLET_READ:
            reply = _reply_to(q0, wire.QUADLET_RESPONSE, source, self._quadlet(row, address, tick))
            return _REPLY.pack(*reply) + _TRAILER.pack(*trailer)
        length = (_QUAD.unpack_from(data, 14)[0] >> 16 if len(data) >= 22 else 0) & ~3
        if not 0 < length <= wire.MAX_DATA:
            return None
        reply = _reply_to(q0, wire.BLOCK_RESPONSE, source, length << 16)
        memory = self.hub_memory
        if address == reg.HUB and length == (memory.quads + 1) * 4:
            return memory.answer(reply, trailer, tick)
        if reg.HUB <= address < reg.QUERY:
            block = memory.read(address - reg.HUB, length // 4, tick)
        else:
            block = self.firmware.read_block(row, address, length, tick)
        return b"".join((_REPLY.pack(*reply), block, bytes(4), _TRAILER.pack(*trailer)))

    def _quadlet(self, row: int, address: int, tick: int) -> int:
        if reg.HUB <= address < reg.QUERY:
            return int.from_bytes(self.hub_memory.read(address - reg.HUB, 1, tick), "big")
        if address >> 2 == reg.QUERY >> 2:
            return self.hub_memory.read_register(row, address & 3)
        return self.firmware.read(row, address, tick)

    # -- writes --------------------------------------------------------------------------------------------------------

    def _write(self, rows: tuple[int, ...], tcode: int, data: wire.Buffer, head: _Head, receiver: int,
               tick: int) -> wire.Buffer | None:
        address, size = head[3], len(data)
        if tcode == wire.BLOCK_WRITE and size >= _DATA_AT + 4:
            length = min(_QUAD.unpack_from(data, 14)[0] >> 16, size - _DATA_AT) & ~3
            if address == reg.REAL_TIME:
                self._commands.write(rows, data, _DATA_AT, length // 4, tick)
                if self.firmware.motors.rebooting:
                    self._reboot(self.firmware.motors.rebooting, tick)
                    self.firmware.motors.rebooting.clear()
            else:
                for row in rows:
                    self.firmware.write_block(row, address, bytes(data[_DATA_AT : _DATA_AT + length]), tick)
        elif tcode == wire.QUADLET_WRITE and size >= 22:
            value = _QUAD.unpack_from(data, 14)[0]
            if address == reg.QUERY:
                return self._query(rows, value, head, tick)
            self._write_quadlet(rows, address, value, receiver, tick)
        else:
            self.errors += 1
        return None

    def _write_quadlet(self, rows: tuple[int, ...], address: int, value: int, receiver: int, tick: int) -> None:
        resets = [self.boards[row].network.phy.bus_resets for row in rows]
        for row in rows:
            if address == reg.STATUS and value & reg.CONTROL_REBOOT == reg.CONTROL_REBOOT:
                self._reboot((row,), tick)
            else:
                self.firmware.write(row, address, value, tick, receiver not in (row, GROUP))
        if address == reg.PHY_REQUEST and resets != [self.boards[row].network.phy.bus_resets for row in rows]:
            self.reset()

    def _reboot(self, rows: Iterable[int], tick: int) -> None:
        """FPGAs are reconfigured: their boards are absent meanwhile."""
        for row in rows:
            self.power.cut(row, tick)
            self._silent_until[row] = tick + REBOOT_TICKS
        self._see_who_is_there()

    def _query(self, rows: tuple[int, ...], value: int, head: _Head, tick: int) -> wire.Buffer | None:
        """A broadcast query; over Ethernet the hub answers it once all blocks are there."""
        flags, _, q0, _ = head
        memory, hub = self.hub_memory, self._hub
        if not self.over_ethernet:
            if len(rows) == len(self._there):
                self.power.refresh_all(tick)
                memory.query(value, hub, tick)
            return None
        if not flags & wire.NO_FORWARD:
            return None
        for row in rows:
            if value >> self.ids[row] & 1:
                self.power.refresh(row, tick)
        if hub not in rows or not memory.query(value, hub, tick) or not value >> self.ids[hub] & 1:
            return None
        reply = _reply_to(q0, wire.BLOCK_RESPONSE, self.ids[hub], (memory.quads + 1) << 18)
        return memory.answer(reply, self._trailer(hub, flags), tick + REPORT_TICKS * self.count)


def _reply_to(q0: int, tcode: int, source: int, last: int) -> tuple[int, ...]:
    """The head of a reply: `last` is a quadlet read, or the length of a block in its upper half."""
    return wire.HOST_ID << 16 | q0 & 0xFC00 | tcode << 4, (0xFFC0 | source) << 16, 0, last, 0
