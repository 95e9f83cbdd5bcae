"""The memory chip of an instrument (DS2505) as a board reads it over one wire, behind 0x0D and 0x6000.

The firmware's state machine is a sequence of steps that is evaluated only on an access, insertion or removal: each step
then happens at its own tick. On Rev 8 and 9 the firmware first looks for another kind of interface (DS2480B), which
these boards do not have, and gives up on it after 6.5 ms.

The chip answers from a reset during which it was in place until it is removed; from then on the line stays high.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

from trocar.procs.boards.controllers.lines import NEVER
from trocar.procs.fpga.instrument import (
    CHUNK_BYTES,
    COMPANY,
    COMPANY_AT,
    MEMORY_BYTES,
    MODEL_AT,
    NAME_AT,
    NAME_END,
    VERSION_AT,
)

Step = tuple[str, int, Callable[[], None]]
"""Name of a state, its duration in ticks, the action at its end."""

FAMILY: Final = 0x0B

BUSY: Final = 1 << 13  # Rev 8 on
PROBING: Final = 1 << 15  # a DS2480B is there, or still looked for; Rev 8 on
BIDIRECTIONAL: Final = 1 << 3
RESET_OK, RESET_NO_ANSWER = 1, 3

_RESET_TICKS = 30_001
_RISE_TICKS = 74  # 1.5 µs until the pull-up has the line high: plausible
_WAIT_TICKS = 1_476
_ANSWER_TICKS = 14_751  # maximum wait for an answer
_PULSE_END = 7_127  # the chip's answer is over 145 µs after the line went high
_RECOVER_TICKS = 24_577
_SLOT_TICKS = 8_192  # of a bit but for the last one of a byte
_WRITE_TICKS = 7 * _SLOT_TICKS + 4_425
_READ_TICKS = 7 * _SLOT_TICKS + 5_949
_SAMPLE_TICK = 737  # within a bit
_UART_RESET_TICKS = 97_280  # a byte at 4800 baud
_UART_TICKS = 48_640  # a byte at 9600 baud
_UART_PATIENCE = 76_801

# State numbers by name: Rev 7, and Rev 8 and 9.
_COMMON = {"reset": 1, "rise": 2, "wait": 3, "answer": 4, "recover": 5}
_REV_7 = {**_COMMON, "write": 6, "read": 7, "rom start": 8, "rom": 9, "low": 10, "high": 11, "start": 12, "store": 13}
_REV_8 = {**_COMMON, "rom start": 6, "rom": 7, "low": 8, "high": 9, "write": 10, "read": 11, "probe": 12, "program": 13,
          "check": 14, "start": 16, "store": 17}


def instrument_memory(name: str, model: int, version: int) -> bytes:
    """Memory of an instrument; ValueError for unsuitable data: name 28 ASCII characters, model 24 bits."""
    text = name.encode("ascii", "replace")
    room = NAME_END - NAME_AT
    if text.decode("ascii") != name or b"\0" in text or len(text) > room:
        raise ValueError(f"instrument name {name!r}; allowed: up to {room} ASCII characters")
    if not (0 <= model < 1 << 24 and 0 <= version < 1 << 8):
        raise ValueError(f"instrument model {model}, version {version}; allowed: 24 and 8 bits")
    memory = bytearray(b"\xff" * MEMORY_BYTES)
    memory[COMPANY_AT : COMPANY_AT + len(COMPANY)] = COMPANY
    memory[MODEL_AT : MODEL_AT + 4] = model.to_bytes(4, "big")
    memory[VERSION_AT] = version
    memory[NAME_AT:NAME_END] = text.ljust(room, b"\0")
    return bytes(memory)


class Dallas:
    """The interface of one board, and the instrument in it, if any."""

    def __init__(self, firmware: int) -> None:
        """At rest, no instrument."""
        self._states = _REV_7 if firmware < 8 else _REV_8
        self._probes = firmware >= 8
        self.memory: bytes | None = None  # of the instrument
        self.power_up()

    def power_up(self) -> None:
        """The FPGA is reconfigured: at rest, and an instrument stays in its place."""
        self.enabled = False  # it drives digital output 3
        self._chip = b""  # memory of the answering chip, until `_silent_from`
        self._silent_from = 0
        self._pointer = 0
        self._family, self._rise, self._reset, self._byte, self._probing = 0, 0xFF, 0, 0, False
        self._buffer = [0] * (CHUNK_BYTES // 4)
        self._steps: deque[Step] = deque()  # still to be done
        self._then: Callable[[], None] = _nothing  # at the end of the step being taken
        self._state, self._ends = 0, 0
        self._now = 0  # tick of the step being taken

    # -- registers -----------------------------------------------------------------------------------------------------

    def write(self, value: int, tick: int) -> None:
        """Control register 0x0D: 2 reads a chunk from an address on, 3 the next one; 1 and 0 take and leave the line.

        During a read all writes are ignored.
        """
        self._run(tick)
        if self._state:
            return
        command = value & 3
        if command != 3:
            self.enabled = command != 0
        steps: list[Step] = []
        if command == 2:
            self._rise, self._reset, self._probing = 0xFF, 0, self._probes
            steps = self._read_from(value >> 16 & MEMORY_BYTES - 1)
        elif command == 3:
            steps = self._read_chunk()
        if value & 8 and self._probes:
            steps = self._finish()
        self._steps, self._then, self._ends, self._state = deque(steps), _nothing, tick, -1
        self._run(tick)

    def status(self, tick: int) -> int:
        """Status register 0x0D."""
        self._run(tick)
        value = (self._family << 24 | (self._byte if self._probing else self._rise) << 16 | self._state << 4
                 | BIDIRECTIONAL | self._reset << 1 | self.enabled)
        if self._probes:
            value |= (PROBING if self._probing else 0) | (BUSY if self._state else 0)
        return value

    def read(self, index: int, count: int, tick: int) -> list[int]:
        """Quadlets of the chunk at 0x6000 read so far."""
        self._run(tick)
        return [self._buffer[(index + k) % len(self._buffer)] for k in range(count)]

    # -- the instrument ------------------------------------------------------------------------------------------------

    def insert(self, memory: bytes, tick: int) -> None:
        """Put an instrument in; ValueError for a memory of the wrong size."""
        if len(memory) != MEMORY_BYTES:
            raise ValueError(f"instrument memory of {len(memory)} bytes; allowed: {MEMORY_BYTES}")
        self.remove(tick)
        self.memory = memory

    def remove(self, tick: int) -> None:
        """Take the instrument out, if there is one."""
        self._run(tick)
        self.memory = None
        self._silent_from = min(self._silent_from, tick)

    # -- the state machine ---------------------------------------------------------------------------------------------

    def _run(self, tick: int) -> None:
        """Take all steps that are due by `tick`."""
        while self._state and self._ends <= tick:
            self._now = self._ends
            self._then()
            name, ticks, self._then = self._steps.popleft() if self._steps else ("", 0, _nothing)
            self._state = self._states.get(name, 0)
            self._ends += ticks

    def _read_from(self, address: int) -> list[Step]:
        bits = [step for k in range(8) for step in (  # serial number and CRC follow, but are never read
            ("read", _READ_TICKS, partial(self._take, FAMILY)), ("rom", 1, _nothing if k else self._keep_family))]
        select = [("write", _WRITE_TICKS, _nothing), ("low", 1, _nothing), ("write", _WRITE_TICKS, _nothing),
                  ("high", 1, _nothing), ("write", _WRITE_TICKS, partial(self._point_at, address))]
        return [*(self._probe() if self._probes else ()), ("reset", _RESET_TICKS, _nothing),
                ("rise", _RISE_TICKS, self._look), ("wait", _WAIT_TICKS, self._hear), ("answer", 1, self._answered),
                ("recover", _PULSE_END - _WAIT_TICKS - 1 + _RECOVER_TICKS, _nothing), ("write", _WRITE_TICKS, _nothing),
                ("rom start", 1, _nothing), *bits, *select, *self._read_chunk()]

    def _look(self) -> None:
        self._rise = _RISE_TICKS
        self._chip, self._silent_from = self.memory or b"", self._now if self.memory is None else NEVER

    def _hear(self) -> None:
        if self._silent_from <= self._now:
            self._steps = deque([("answer", _ANSWER_TICKS, self._unanswered)])

    def _unanswered(self) -> None:
        self._reset = RESET_NO_ANSWER

    def _answered(self) -> None:
        self._reset = RESET_OK

    def _keep_family(self) -> None:
        self._family = self._byte

    def _point_at(self, address: int) -> None:
        self._pointer = address

    def _read_chunk(self) -> list[Step]:
        return [("start", 1, _nothing), *(step for k in range(CHUNK_BYTES) for step in (
            ("read", _READ_TICKS, self._read_byte), ("store", 1, partial(self._store, k))))]

    def _read_byte(self) -> None:
        self._take(self._chip[self._pointer] if self._pointer < len(self._chip) else 0xFF)
        self._pointer += 1

    def _store(self, k: int) -> None:
        self._buffer[k // 4] = self._buffer[k // 4] << 8 & 0xFFFF_FFFF | self._byte

    def _take(self, value: int) -> None:
        """A byte has been read bit by bit: those after the chip was gone are ones."""
        began = self._now - _READ_TICKS
        for bit in range(8):
            if began + bit * _SLOT_TICKS + _SAMPLE_TICK >= self._silent_from:
                value |= 1 << bit
        self._byte = value

    def _probe(self) -> list[Step]:
        """Look for a DS2480B: three bytes to it, and no answer."""
        tries = [("program", 1, _nothing), ("write", _UART_TICKS, _nothing), ("check", 1, _nothing)] * 3
        return [("probe", 1, self._answered), ("write", _UART_RESET_TICKS, _nothing), *tries,
                ("read", _UART_PATIENCE, self._end_probe)]

    def _end_probe(self) -> None:
        self._probing, self._reset = False, 0

    def _finish(self) -> list[Step]:
        """End of the transfer: two bytes for a DS2480B, without a receiver."""
        return [("program", 1, _nothing), ("write", _WRITE_TICKS, _nothing), ("check", 1, _nothing)] * 2


def _nothing() -> None:
    pass
