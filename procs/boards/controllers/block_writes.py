"""Real-time block writes: from the groups on the wire to motor command words and control words of all boards.

The firmware determines which part of a group reaches a board's registers:

Rev 7: groups of five; all four command words bear the id of their board, those with the valid bit are written.
Rev 8: groups say in their head whose they are and how long. All command words are written where any of them has a valid
or mask bit, else none.
Both take bits 19:0 of a control word, and write it where it is not 0 or no command word was.
Rev 9: as they come, and whatever is in them, command words and, at the group's end, the control word are written.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.firmware import Firmware
from trocar.procs.boards.controllers.lines import Quads
from trocar.procs.boards.controllers.motors import TOP_SHIFT
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire
from trocar.procs.native import library
from trocar.procs.native.boards_fields import COMMANDS

_BIG_QUAD = np.dtype(">u4")
_WORTH_WRITING = reg.DAC_VALID | reg.DAC_AMP_MASK


@dataclass(frozen=True, slots=True)
class Group:
    """One board's part of a block; `control` is None if the group ends before it."""

    row: int
    words: list[int]
    control: int | None


class WriteDecoder:
    """Decodes groups; a board takes those that carry its id, even if other boards take them too."""

    def __init__(self, firmware: Firmware) -> None:
        """For the boards of `firmware`."""
        self._firmware = firmware
        models = firmware.models
        shape = (firmware.count, firmware.width)
        self._words = np.zeros(shape, dtype=np.uint32)
        self._written = np.zeros(shape, dtype=np.bool_)
        self._control = np.zeros(firmware.count, dtype=np.uint32)
        self._executed = np.zeros(firmware.count, dtype=np.bool_)
        self._row_of = dict(zip(firmware.ids, range(firmware.count), strict=True))
        self._every = tuple(range(firmware.count))
        self._reached_rows: tuple[int, ...] = ()
        self._reached = np.zeros(shape, dtype=np.bool_)  # the axes of these rows
        # The write of a running host: one group for every board, in order.
        sizes = {(model.firmware > 7, model.layout.write_quads) for model in models}
        self._quads = 0
        if sizes == {(True, firmware.width + 2)}:
            self._quads = firmware.count * (firmware.width + 2)
            self._shape = (firmware.count, firmware.width + 2)
            self.boards, self.width, self.columns = firmware.count, firmware.width, firmware.width + 2
            self.motors, self.lines = firmware.motors, firmware.lines
            heads = [model.board_id << 8 | model.layout.write_quads for model in models]
            self.heads = np.array(heads, dtype=_BIG_QUAD).view(np.uint32)  # in storage order
            self._heads = self.heads.tobytes()
            self.block = np.zeros(self._shape, dtype=np.uint32)
            self._flat, self._groups = self.block.reshape(-1), self.block.view(_BIG_QUAD)
            (self._repeat,) = library.chosen(COMMANDS, self)
        # The positions of enables among command words, and data collection, depend on whether a word is written.
        self._particular = any(model.firmware == 8 and model.hardware.name != "QLA1" for model in models)
        self._late = np.array([model.firmware > 8 for model in models])

    def write(self, rows: tuple[int, ...], data: wire.Buffer, at: int, count: int, tick: int) -> None:
        """A block of `count` quadlets at byte `at` of a datagram reaches boards `rows`."""
        quads = np.frombuffer(data, _BIG_QUAD, count, at)
        if 0 < count == self._quads:
            if len(rows) == len(self._every) and self.motors.only_values_count and not self._firmware.collecting:
                self._flat[...] = quads.view(np.uint32)
                if not self._repeat():
                    self._firmware.power.refresh_all(tick)
                    return
            groups = quads.reshape(self._shape)
            if groups[:, 0].tobytes() == self._heads:
                words, control = groups[:, 1:-1].astype(np.uint32), groups[:, -1].astype(np.uint32)
                written = self._worth_writing(words) if self._particular or self._firmware.collecting else None
                if len(rows) != len(self._every):  # without the groups of other boards
                    words[~self._reach(rows)], control[~self._reached[:, 0]] = 0, 0
                    written = self._reached if written is None else written & self._reached
                self._firmware.execute(words, control, rows, tick, written)
                return
        listed = quads.tolist()
        self._begin()
        addressed: set[int] = set()
        for group in (*self._step_through(rows, listed), *self._match(rows, listed)):
            if group.row in addressed:  # a second one for the same board: after the first
                self._execute(addressed, tick)
                addressed = set()
            addressed.add(group.row)
            self._enter(group)
        if addressed:
            self._execute(addressed, tick)

    def repeat(self) -> int:
        """Take a block that differs from the last one in values only. 1: other differences; nothing is done.

        A running host sends such a block every cycle.
        """
        motors, words = self.motors, self._groups[:, 1:-1].astype(np.uint32)
        if self.block[:, 0].tobytes() != self._heads or np.count_nonzero(self.block[:, -1]):
            return 1
        if (words >> np.uint32(TOP_SHIFT)).tobytes() != motors.last_top.tobytes():
            return 1
        np.copyto(motors.command, words & reg.DAC_VALUE_MASK, where=motors.accept)
        self.lines.dac[...] = motors.command
        return 0

    def _worth_writing(self, words: Quads) -> npt.NDArray[np.bool_] | None:
        """Axes that Rev 8 sends their command word, of a block for all boards; None: all of them."""
        boards = ((words & np.uint32(_WORTH_WRITING)) != 0).any(axis=1) | self._late
        return None if boards.all() else np.repeat(boards[:, None], words.shape[1], axis=1)

    def _reach(self, rows: tuple[int, ...]) -> npt.NDArray[np.bool_]:
        """The axes of boards `rows`."""
        if rows != self._reached_rows:
            self._reached_rows = rows
            self._reached.fill(False)
            self._reached[list(rows)] = True
        return self._reached

    def _begin(self) -> None:
        for array in (self._words, self._written, self._control, self._executed):
            array.fill(0)

    def _execute(self, rows: set[int], tick: int) -> None:
        self._firmware.execute(self._words, self._control, sorted(rows), tick, self._written, self._executed)
        self._begin()

    def _enter(self, group: Group) -> None:
        row, count, revision = group.row, len(group.words), self._firmware.models[group.row].firmware
        if revision > 8:
            written, executed = [True] * count, group.control is not None
        else:
            any_worth = any(word & (_WORTH_WRITING if revision == 8 else reg.DAC_VALID) for word in group.words)
            written = [bool(word & reg.DAC_VALID) if revision == 7 else any_worth for word in group.words]
            executed = bool((group.control or 0) & reg.CONTROL_REAL_TIME_BITS) or not any_worth
        self._words[row, :count] = group.words
        self._written[row, :count] = written
        self._control[row] = group.control or 0
        self._executed[row] = executed

    def _step_through(self, rows: tuple[int, ...], words: list[int]) -> Iterator[Group]:
        """Rev 8 on; a length of 0 ends the block."""
        at = 0
        while at < len(words) and words[at] & 0xFF:
            board, length = words[at] >> 8 & 0xF, words[at] & 0xFF
            row = self._row_of.get(board, -1)
            model = self._firmware.models[row]
            if row in rows and model.firmware > 7 and length >= 2:
                end, motors = at + length, model.hardware.motors
                whole = end <= len(words)
                if model.firmware > 8:
                    group = words[at + 1 : min(end - 1, at + 1 + motors)]
                    yield Group(row, group, words[end - 1] if whole else None)
                elif length >= motors + 2 and at + motors + 1 < len(words):  # else it never reaches the control word
                    yield Group(row, words[at + 1 : at + 1 + motors], words[at + motors + 1])
            at += length

    def _match(self, rows: tuple[int, ...], words: list[int]) -> Iterator[Group]:
        """Rev 7."""
        old = [row for row in rows if self._firmware.models[row].firmware == 7]
        size = reg.AXES + 1
        for at in range(0, len(words) - size + 1 if old else 0, size):
            boards = {word >> reg.DAC_BOARD_SHIFT & 0xF for word in words[at : at + reg.AXES]}
            row = self._row_of.get(boards.pop(), -1)
            if not boards and row in old:
                yield Group(row, words[at : at + reg.AXES], words[at + reg.AXES])
