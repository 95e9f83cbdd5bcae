"""One board's real-time block as readable values: for `trocar bus watch`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trocar.procs.fpga import blocks, registers
from trocar.tools.inspect import register_names
from trocar.tools.inspect.bus_client import BusClient, FoundBoard
from trocar.tools.output.errors import Problem


@dataclass(frozen=True, slots=True)
class AxisSample:
    """One axis, from 1; fields that only motors or only encoders have are None or empty for the others."""

    axis: int
    pot_bits: int | None
    current_bits: int | None
    encoder_counts: int | None
    overflow: bool | None
    velocity_counts_s: float | None
    amplifier: str
    inputs: str


@dataclass(frozen=True, slots=True)
class BoardSample:
    """A board at one moment."""

    board: FoundBoard
    since_s: float  # since the sample before, by any program
    status: int
    watchdog: int  # its register
    digital_input: int
    celsius: list[float | None]
    axes: tuple[AxisSample, ...]

    @property
    def words(self) -> list[str]:
        """The status in words, without the board's id."""
        return register_names.status_words(self.status, self.board.hardware, self.board.firmware)[1:]

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        status = self.status
        return {
            "board": self.board.board, "hardware": self.board.hardware, "firmware": self.board.firmware,
            "since_s": self.since_s, "status": status, "words": self.words,
            "power": bool(status & registers.STATUS_POWER), "relay": bool(status & registers.STATUS_RELAY),
            "watchdog_tripped": bool(status & registers.STATUS_WATCHDOG),
            "watchdog_s": (self.watchdog & 0xFFFF) * registers.WATCHDOG_UNIT_S,
            "digital_input": self.digital_input, "celsius": self.celsius,
            "axes": [{name: getattr(axis, name) for name in AxisSample.__slots__} for axis in self.axes],
        }


def layout(board: FoundBoard) -> blocks.Layout:
    """Layout of a board's real-time block; Problem for unknown controllers."""
    if board.hardware not in blocks.AXES_OF or board.firmware not in blocks.LAYOUTS:
        allowed = f"{', '.join(blocks.AXES_OF)}, firmware {blocks.REVISIONS}"
        raise Problem(f"{board.title} cannot be watched; allowed: {allowed}")
    return blocks.layout_of(board.firmware, *blocks.AXES_OF[board.hardware])


def take(desk: BusClient, board: FoundBoard) -> BoardSample:
    """Sample a board once: a block read and a register read, which only affect its sample timer."""
    shape = layout(board)
    words = desk.block(board.board, registers.REAL_TIME, shape.read_quads)
    return sample_of(board, words, desk.read(board.board, registers.WATCHDOG))


def sample_of(board: FoundBoard, words: list[int], watchdog: int) -> BoardSample:
    """The values in a real-time block and a watchdog register."""
    shape = layout(board)
    columns = blocks.Columns(max(shape.motors, shape.encoders))
    row = np.zeros(columns.count, np.uint32)
    row[shape.columns(columns.width)] = words
    adc, position, status = row[columns.adc].tolist(), row[columns.position].tolist(), int(row[blocks.STATUS])
    timing = (columns.running, columns.period, columns.quarter_5, columns.quarter_1)
    speeds = register_names.velocities([row[kind].tolist() for kind in timing], board.hardware)
    motor, inputs = row[columns.motor_status].tolist(), int(row[blocks.DIGITAL_INPUT])
    digital = board.hardware == "dRA1"
    axes = []
    for k in range(columns.width):
        drives, counts = k < shape.motors, k < shape.encoders
        axes.append(AxisSample(
            k + 1,
            adc[k] >> 16 & (registers.DIGITAL_POT_MASK if digital else 0xFFFF) if drives else None,
            adc[k] & 0xFFFF if drives else None,
            register_names.counts(position[k]) if counts else None,
            bool(position[k] & registers.ENCODER_OVERFLOW) if counts and not digital else None,
            speeds[k] if counts else None,
            register_names.amplifier(status, motor[k], k, board.hardware, board.firmware) if drives else "",
            register_names.limit_inputs(inputs, board.hardware, k)))
    since_s = (int(row[blocks.TIMESTAMP]) + 1) * registers.TICK_S
    return BoardSample(board, since_s, status, watchdog, inputs,
                       register_names.celsius(int(row[blocks.TEMPERATURE]), board.hardware), tuple(axes))
