"""Read the memory of instruments on command: at most one request to one board a cycle, after its write.

A board reads 256 bytes by itself in about 0.35 s. It gets a read command, its state is read every 20 ms until it is
done, and then the bytes are fetched. Writes are not acknowledged, and answers may be old, so:

    an answer sooner than possible                       the read command was lost: repeated
    no instrument answers, twice                         ABSENT
    the same bytes in two readings                       accepted; there is no other protection
    3 s without that, or never twice the same            ERROR
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.fpga import instrument, registers
from trocar.procs.fpga.instrument import Instrument, instrument_of
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.record import Field, private
from trocar.procs.io.reports import IoEvent
from trocar.procs.io.robots import IoData
from trocar.shm.mailbox.received import Request
from trocar.shm.topics import IO_INSTRUMENTS

POLL_NS: Final = 20_000_000  # also the shortest time before "no answer" can answer our command
MIN_NS: Final = 250_000_000  # 256 bytes cannot have come sooner
MAX_NS: Final = 3_000_000_000
TIMES: Final = 2  # in a row, before a result is accepted
MAX_WAITING: Final = 16

READING, READ, ABSENT, ERROR = "READING", "READ", "ABSENT", "ERROR"


@dataclass(slots=True)
class MemoryReading:
    """One reading in progress."""

    begun_ns: int
    due_ns: int  # time of the next request to the board
    reported_ns: int = 0  # time of the read command; 0: still to be sent
    ready: bool = False  # the board is done: fetch the bytes
    status: int = 0  # of its register
    silent: int = 0
    record: bytes = b""  # bytes of the last reading
    askers: list[Request] = field(default_factory=list)


class InstrumentReaders:
    """The readers of one io in the order of the document; `record` is their published form."""

    def __init__(self, data: IoData, field: Field | None) -> None:
        """Nothing is read yet. `field` gives the arrays of the record by name; None: not published."""
        readers, self._port, self._reports = data.robots.io.instrument_readers, data.port, data.reports
        self.names = tuple(reader.name for reader in readers)
        self._boards = [reader.board_id for reader in readers]
        field = field or private(IO_INSTRUMENTS, {"readers": len(readers)})
        self.record = {row.name: field(row.name) for row in IO_INSTRUMENTS.fields}
        for array in self.record.values():
            array[...] = array.dtype.type()
        self.record["reader"][...] = [name.encode() for name in self.names]
        self.running: dict[int, MemoryReading] = {}
        self._reports.changed.add(IO_INSTRUMENTS.name)

    def begin(self, reader: int, asker: Request, now_ns: int) -> str:
        """Read an instrument; several requests share a reading. Returns the reason for a refusal, or ""."""
        reading = self.running.get(reader)
        if reading is None:
            sharing = [other for other in self.running if self._boards[other] == self._boards[reader]]
            if sharing:
                return f"its board is busy reading for {self.names[sharing[0]]}"
            reading = self.running[reader] = MemoryReading(now_ns, now_ns)
            self._show(reader, READING, None, now_ns)
        elif len(reading.askers) >= MAX_WAITING:
            return "a read is already pending"
        reading.askers.append(asker)
        asker.accept()
        return ""

    def step(self, good: bool, now_ns: int) -> None:
        """After the write of a cycle: one request to at most one board, and none while samples are bad."""
        for reader, reading in self.running.items():
            if now_ns - reading.begun_ns > MAX_NS:
                self._end(reader, ERROR, "it could not be read in 3 s: no two readings agree, or the board does "
                          "not answer", None, now_ns)
                return
            if good and now_ns >= reading.due_ns:
                reading.due_ns = now_ns + POLL_NS
                try:
                    self._speak(reader, reading, now_ns)
                except PortError:
                    reading.reported_ns = 0  # command again next time
                return

    def _speak(self, reader: int, reading: MemoryReading, now_ns: int) -> None:
        board = self._boards[reader]
        if not reading.reported_ns:
            control = instrument.READ | instrument.RECORD_AT << instrument.ADDRESS_SHIFT
            self._port.write_quadlet(board, registers.DALLAS, control)
            reading.reported_ns = now_ns
            return
        if reading.ready:
            self._fetch(reader, reading, now_ns)
            return
        answer = self._port.peek(board, registers.DALLAS)
        if answer is None or int(answer[0]) & instrument.BUSY:
            return
        reading.due_ns, reading.status = now_ns, int(answer[0])
        result = reading.status >> instrument.RESET_SHIFT & 3
        reading.silent = reading.silent + 1 if result == instrument.SILENT else 0
        reading.ready = result == instrument.ANSWERED and now_ns - reading.reported_ns >= MIN_NS
        if not reading.ready:
            reading.reported_ns = 0
        if reading.silent >= TIMES:
            self._end(reader, ABSENT, "no instrument answers", None, now_ns)

    def _fetch(self, reader: int, reading: MemoryReading, now_ns: int) -> None:
        board = self._boards[reader]
        quads = self._port.peek(board, registers.DALLAS_MEMORY, instrument.CHUNK_BYTES // 4)
        if quads is None:  # the bytes stay there until the next try
            return
        before, reading.record = reading.record, quads.astype(">u4").tobytes()
        reading.reported_ns, reading.ready, reading.due_ns = 0, False, now_ns
        if reading.record == before:
            self._believe(reader, before, now_ns)

    def _believe(self, reader: int, record: bytes, now_ns: int) -> None:
        try:
            found = instrument_of(record)
        except ValueError as error:
            self._end(reader, ERROR, str(error), None, now_ns)
        else:
            self._end(reader, READ, found.tool, found, now_ns)

    def _end(self, reader: int, status: str, text: str, found: Instrument | None, now_ns: int) -> None:
        reading = self.running.pop(reader)
        release = instrument.RELEASE_CONVERTER if reading.status & instrument.CONVERTER else instrument.RELEASE
        with contextlib.suppress(PortError):
            self._port.write_quadlet(self._boards[reader], registers.DALLAS, release)
        self._show(reader, status, found, now_ns)
        self._reports.events.append(IoEvent("tool_type", text, status, self.names[reader]))
        for asker in reading.askers:
            if found is None:
                asker.fail(text)
            else:
                asker.done(text)

    def _show(self, reader: int, status: str, found: Instrument | None, now_ns: int) -> None:
        record = self.record
        record["status"][reader], record["since_ns"][reader] = status.encode(), now_ns
        record["tool"][reader] = found.tool.encode() if found else b""
        record["name"][reader] = found.name.encode() if found else b""
        record["model"][reader], record["version"][reader] = (found.model, found.version) if found else (0, 0)
        self._reports.changed.add(IO_INSTRUMENTS.name)
