"""Boards on a desk: a host that writes and reads one bus, on a clock that moves only when told."""

from __future__ import annotations

import numpy as np

from tests.fpga import board_side
from trocar.procs.boards.controllers import bus as wired
from trocar.procs.document.system import Controller, Quirks
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

MS = reg.CLOCK_HZ // 1000
VALID, MASK, ENABLE, COLLECT = reg.DAC_VALID, reg.DAC_AMP_MASK, reg.DAC_AMP_ENABLE, reg.DAC_COLLECT
ON = MASK | ENABLE
_FAITHFUL = Quirks()


def board(firmware: int = 8, hardware: str = "QLA1", board_id: int = 3, *, qla: str = "1.4",
          quirks: Quirks = _FAITHFUL, serial: str = "") -> Controller:
    """A controller of the usual FPGA."""
    fpga = "V2" if hardware == "QLA1" and firmware < 9 else "V3"
    return Controller(board_id, hardware, firmware, fpga, robot_serial=serial, qla=qla, quirks=quirks)


class Desk:
    """A bridge with these boards; nodes in the order given, watchdogs off unless told otherwise."""

    def __init__(self, *controllers: Controller, watchdog: int | None = 0) -> None:
        self.bus = wired.EmulatedBus(controllers or (board(),))
        self.power, self.lines = self.bus.power, self.bus.lines
        self.tick = 0
        for node in range(len(controllers) or 1):
            if watchdog is not None:
                self.write(reg.WATCHDOG, watchdog, node)

    def write(self, address: int, value: int, node: int = 0) -> None:
        self.bus.answer(wire.quadlet_write(node, address, value, 1, self.bus.generation), self.tick)

    def block(self, *quads: int, node: int = wire.BROADCAST) -> None:
        """A real-time block write."""
        data = np.array(quads, dtype=">u4").tobytes()
        self.bus.answer(wire.block_write(node, 0, data, 1, self.bus.generation), self.tick)

    def group(self, *quads: int, board_id: int = 3) -> None:
        """One group of Rev 8 or 9, its head put before it."""
        self.block(board_id << 8 | len(quads) + 1, *quads)

    def read(self, address: int = reg.STATUS, node: int = 0) -> int:
        reply = board_side.decode_response(
            self.bus.answer(wire.quadlet_read(node, address, 1, self.bus.generation), self.tick) or b"")
        assert isinstance(reply, board_side.WireResponse)
        return reply.value

    def real_time(self, node: int = 0) -> list[int]:
        """Quadlets of the real-time block of a board."""
        size = 4 * self.bus.firmware.models[0].layout.read_quads
        reply = board_side.decode_response(
            self.bus.answer(wire.block_read(node, 0, size, 1, self.bus.generation), self.tick) or b"")
        assert isinstance(reply, board_side.WireResponse)
        return [int(quad) for quad in np.frombuffer(reply.data, ">u4")]

    def axis(self, axis: int, offset: int, node: int = 0) -> int:
        return self.read(reg.axis_register(axis, offset), node)

    def motor(self, axis: int = 0) -> int:
        return self.axis(axis, reg.MOTOR_STATUS)

    def dac(self, axis: int, word: int) -> None:
        self.write(reg.axis_register(axis, reg.DAC), word)

    def requests(self) -> list[bool]:
        """Enables as requested."""
        return [bool(flag) for flag in self.power.enabled[0]]

    def on(self) -> list[bool]:
        """Amplifiers that are on."""
        self.bus.step(self.tick)
        return [bool(flag) for flag in self.power.on[0]]

    def hold(self, ms: int) -> None:
        """Physics steps with currents as they are."""
        for _ in range(ms):
            self.bus.step(self.tick)
            self.bus.firmware.motors.check_currents(self.tick)
            self.tick += MS
