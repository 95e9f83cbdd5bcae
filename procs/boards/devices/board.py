"""The quiet side of one board: accessed at start-up and by hand, never in the cycle.

Accesses to registers and buffers are passed to the devices behind them. No device needs calls as time passes: each
derives earlier events from the tick of an access. Until `outputs.busy_until` the digital outputs change by themselves,
and while `collection.collecting` is true the buffer needs the measured current.
"""

from __future__ import annotations

import struct

from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.devices.collection import Collection
from trocar.procs.boards.devices.dallas import Dallas
from trocar.procs.boards.devices.network import Network
from trocar.procs.boards.devices.outputs import BoardOutputs
from trocar.procs.boards.devices.prom import FpgaProm, QlaProm, SerialOnly
from trocar.procs.fpga import registers as reg

_REGION_SHIFT, _OFFSET_MASK = 12, 0xFFF
_MAIN, _FPGA_PROM, _QLA_PROM, _ETHERNET, _FIREWIRE, _DALLAS, _DATA, _TABLE = 0, 2, 3, 4, 5, 6, 7, 8
GIT_DESCRIPTIONS = {8: 0, 9: 0x8533_01D0, 10: 0}  # of the releases; Rev 9 reports its commit, clean; 10: unknown
_CHANNEL_BITS = 0xF0  # of a QLA PROM address; a QLA does not look at them from Rev 8 on


class Board:
    """Identity, network, PROMs, instrument, digital outputs and data collection of one board."""

    def __init__(self, model: Model) -> None:
        """As after power-up at tick 0; the serial number (dddd-dd) is shown by FPGA and QLA PROM alike."""
        self.model, self.firmware = model, model.firmware
        self.fpga_prom = SerialOnly(model.serial) if model.fpga == 3 else FpgaProm(model.serial)
        self.qla_prom = QlaProm(model.serial)
        self.dallas = Dallas(self.firmware)
        self._now = 0
        self._begin(0)

    def _begin(self, tick: int) -> None:
        model = self.model
        self.show_watchdog = 0
        self.network = Network(model.fpga, model.firmware, model.board_id, model.node)
        self.collection = Collection(model.firmware, tick)
        self.digital = BoardOutputs(max(model.hardware.outputs, 1), longest_holds=model.quirks.longest_pwm_holds,
                                    playing_hides_table=model.quirks.playing_hides_table)
        self._scratch = 0x2000  # Rev 7

    def power_up(self, tick: int) -> None:
        """The FPGA is reconfigured: the memories and an instrument stay."""
        self.dallas.power_up()
        self._begin(self._time(tick))

    def read(self, address: int, tick: int) -> int:
        """Value of a register; 0 for a missing register."""
        return self._quads(address, 1, self._time(tick))[0]

    def read_block(self, address: int, size: int, tick: int) -> bytes:
        """`size` bytes of a buffer or of registers in a row."""
        count = size // 4
        return struct.pack(f">{count}I", *self._quads(address, count, self._time(tick)))

    def write(self, address: int, value: int, tick: int, relayed: bool = True) -> None:
        """Write a register; no effect on a missing or read-only one. `relayed`: it arrived over FireWire."""
        now, region, offset = self._time(tick), address >> _REGION_SHIFT, address & _OFFSET_MASK
        if region == _TABLE:
            self.digital.write_table(offset, [value], now)
        elif region == _QLA_PROM:
            self._write_qla_prom(offset, [value], now)
        elif address == reg.DIGITAL_OUTPUT:
            self.digital.write(value, now)
        elif address == reg.PROM_COMMAND:
            self.fpga_prom.command(value, now)
        elif address == reg.DALLAS:
            self.dallas.write(value, now)
        elif address == reg.GIT_DESCRIPTION:
            self._scratch = value
        else:
            self.network.write(address, value, now, relayed)

    def write_block(self, address: int, data: bytes, tick: int) -> None:
        """Fill a buffer; addresses outside are ignored."""
        now, region, offset = self._time(tick), address >> _REGION_SHIFT, address & _OFFSET_MASK
        quads = list(struct.unpack_from(f">{len(data) // 4}I", data))
        if not quads:
            return
        if region == _TABLE:
            self.digital.write_table(offset, quads, now)
        elif region == _FPGA_PROM:
            self.fpga_prom.write(offset, quads, now)
        elif region == _QLA_PROM:
            self._write_qla_prom(offset, quads, now)

    def _time(self, tick: int) -> int:
        """Time does not go back."""
        self._now = max(self._now, tick)
        return self._now

    def _quads(self, address: int, count: int, now: int) -> list[int]:
        region, offset = address >> _REGION_SHIFT, address & _OFFSET_MASK
        if region == _FPGA_PROM:
            return self.fpga_prom.read(offset, count, now)
        if region == _DALLAS:
            return self.dallas.read(offset, count, now)
        if region == _DATA:
            return self.collection.read(offset, count, now)
        if region == _TABLE:
            return self.digital.read_table(offset, count, now)
        read = {_MAIN: self._register, _QLA_PROM: self._read_qla_prom}.get(region, self._read_network)
        return [read(at, now) for at in range(address, address + count)]

    def _register(self, address: int, now: int) -> int:
        if address == reg.HARDWARE_ID:
            return self.model.hardware.identity
        if address == reg.FIRMWARE:
            return self.firmware
        if address == reg.GIT_DESCRIPTION:
            return self._scratch if self.firmware == 7 else GIT_DESCRIPTIONS[self.firmware]
        if address == reg.DIGITAL_OUTPUT:
            return self.digital.read(now)
        if address == reg.PROM_COMMAND:
            return self.fpga_prom.status(now)
        if address == reg.PROM_RESULT:
            return self.fpga_prom.result(now)
        if address == reg.DALLAS:
            return self.dallas.status(now)
        return self.network.read(address, now)

    def _read_network(self, address: int, now: int) -> int:
        return self.network.read(address, now) if address >> _REGION_SHIFT in (_ETHERNET, _FIREWIRE) else 0

    def _qla_place(self, offset: int) -> int:
        """Place in the QLA PROM's address space without the bits that do not count."""
        return offset & ~_CHANNEL_BITS if self.firmware >= 8 else offset

    def _read_qla_prom(self, address: int, now: int) -> int:
        place = self._qla_place(address & _OFFSET_MASK) | reg.QLA_PROM_COMMAND
        if place == reg.QLA_PROM_STATUS:
            return self.qla_prom.status(now)
        if place == reg.QLA_PROM_RESULT:
            return self.qla_prom.result(now)
        if reg.QLA_PROM_BUFFER <= place < reg.QLA_PROM_BUFFER + 0x100:
            return self.qla_prom.read(place, 1, now)[0]
        return 0

    def _write_qla_prom(self, offset: int, quads: list[int], now: int) -> None:
        place = self._qla_place(offset) | reg.QLA_PROM_COMMAND
        if reg.QLA_PROM_BUFFER <= place < reg.QLA_PROM_BUFFER + 0x100:
            self.qla_prom.write(place, quads, now)
        elif place == reg.QLA_PROM_COMMAND:
            self.qla_prom.command(quads[0], now)
