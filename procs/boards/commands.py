"""Real-time block writes: from the groups on the wire to motor command words and control words of all boards."""

from __future__ import annotations

import numpy as np

from procs.boards.firmware import Firmware
from procs.lib import registers as reg
from procs.lib import wire

_BIG_QUAD = np.dtype(">u4")


class Commands:
    """Decodes groups; a board takes those that bear its id, whoever else gets them, too."""

    def __init__(self, firmware: Firmware) -> None:
        """For the boards of `firmware`."""
        self._firmware = firmware
        models = firmware.models
        self._words = np.zeros((firmware.count, firmware.width), dtype=np.uint32)
        self._control = np.zeros(firmware.count, dtype=np.uint32)
        self._row_of = dict(zip(firmware.ids, range(firmware.count), strict=True))
        self._every = tuple(range(firmware.count))
        # The write of a running host: one group for every board, in order.
        sizes = {(model.firmware > 7, model.write_quads) for model in models}
        self._quads = 0
        if sizes == {(True, firmware.width + 2)}:
            self._quads = firmware.count * (firmware.width + 2)
            self._groups = np.zeros((firmware.count, firmware.width + 2), dtype=np.uint32)
            heads = [model.board_id << 8 | model.write_quads for model in models]
            self._heads = np.array(heads, dtype=np.uint32).tobytes()
            self._group_words, self._group_control = self._groups[:, 1:-1], self._groups[:, -1]

    def write(self, rows: tuple[int, ...], data: wire.Buffer, at: int, count: int, tick: int) -> None:
        """A block of `count` quadlets at byte `at` of a datagram reaches boards `rows`."""
        quads = np.frombuffer(data, _BIG_QUAD, count, at)
        if 0 < count == self._quads and len(rows) == len(self._every):
            groups = self._groups
            groups[...] = quads.reshape(groups.shape)
            if groups[:, 0].tobytes() == self._heads:
                self._firmware.execute(self._group_words, self._group_control, self._every, tick)
                return
        self._words[...] = 0
        self._control[...] = 0
        words = quads.tolist()
        new = [row for row in rows if self._firmware.models[row].firmware > 7]
        old = [row for row in rows if self._firmware.models[row].firmware == 7]
        addressed = (self._step_through(new, words) if new else set()) | (self._match(old, words) if old else set())
        if addressed:
            self._firmware.execute(self._words, self._control, sorted(addressed), tick)

    def _step_through(self, rows: list[int], words: list[int]) -> set[int]:
        """Rev 8 on: groups say in their head whose they are and how long."""
        addressed, at = set(), 0
        while at < len(words) and words[at] & 0xFF:
            board, length = words[at] >> 8 & 0xF, words[at] & 0xFF
            row = self._row_of.get(board, -1)
            if row in rows and length >= 2 and at + length <= len(words):
                motors = min(length - 2, self._firmware.models[row].hardware.motors)
                self._words[row, :motors] = words[at + 1 : at + 1 + motors]
                self._control[row] = words[at + length - 1]
                addressed.add(row)
            at += length
        return addressed

    def _match(self, rows: list[int], words: list[int]) -> set[int]:
        """Rev 7: groups of five; all four command words bear the id of their board."""
        addressed, size = set(), reg.AXES + 1
        for at in range(0, len(words) - size + 1, size):
            boards = {word >> reg.DAC_BOARD_SHIFT & 0xF for word in words[at : at + reg.AXES]}
            row = self._row_of.get(boards.pop(), -1)
            if not boards and row in rows:
                self._words[row, : reg.AXES] = words[at : at + reg.AXES]
                self._control[row] = words[at + reg.AXES]
                addressed.add(row)
        return addressed
