"""Records as they are read of a recording: what a topic is, arrays of its records, and pieces of them put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.recordings.layout import ENCAPSULATION

MAX_RATE_HZ: Final = 1e6


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """A topic of a recording: PSM1/state, or PSM1/measured_js. `dtype`: of records, None of views."""

    name: str
    type_name: str
    instance: str = ""
    ring: str = ""
    kind: str = ""
    dtype: np.dtype[np.void] | None = None
    schema: str = ""
    channels: dict[int, int] = field(default_factory=dict)
    """Channels, and the epochs of the writer that they stand for."""
    size: int = 0
    """Bytes of a record in its message; behind them only what fills it up to a whole number of words is missing."""
    info: dict[str, Any] = field(default_factory=dict)
    """Of the ring: `robots`, `dims`, names of inputs; as its header has it."""

    @property
    def rate_hz(self) -> float:
        """How often records were to come; 0: on events."""
        rate = self.info.get("rate_hz", 0)
        return float(rate) if isinstance(rate, (int, float)) and 0 < rate < MAX_RATE_HZ else 0.0


@dataclass(frozen=True, slots=True)
class Records:
    """Records of a topic in their order: `rows` (n,) has a field for each of the ring's, with sequence and stamp_ns.

    `local_ns` (n,): time of day; `epoch` (n,): which process wrote it.
    """

    rows: NDArray[Any]
    local_ns: NDArray[np.int64]
    epoch: NDArray[np.int64]

    @property
    def missing(self) -> int:
        """Records between the first and the last that are not there."""
        numbers = self.rows["sequence"]
        return int(numbers[-1]) - int(numbers[0]) + 1 - len(numbers) if len(numbers) else 0


def joined(pieces: Sequence[Records], dtype: np.dtype[np.void]) -> Records:
    """Pieces of one topic as a whole, in the order of their numbers, each once: some rings are kept twice."""
    rows = np.concatenate([piece.rows for piece in pieces]) if pieces else np.zeros(0, dtype)
    local = np.concatenate([np.zeros(0, np.int64), *(piece.local_ns for piece in pieces)])
    epoch = np.concatenate([np.zeros(0, np.int64), *(piece.epoch for piece in pieces)])
    numbers = rows["sequence"]
    if (numbers[1:] > numbers[:-1]).all():
        return Records(rows, local, epoch)
    order = np.argsort(numbers, kind="stable")
    order = order[np.concatenate(([True], np.diff(numbers[order]) != 0))]
    return Records(rows[order], local[order], epoch[order])


class Piece:
    """What a chunk has of a topic, while it is gone through."""

    def __init__(self, topic: RecordedTopic, dtype: np.dtype[np.void]) -> None:
        self.topic, self._dtype = topic, dtype
        self._rows, self._local, self._epochs = bytearray(), list[int](), list[int]()
        self._fill = bytes(dtype.itemsize - topic.size)

    def add(self, channel: int, log_ns: int, data: memoryview) -> bool:
        """One message; False where it is no record."""
        head, size = len(ENCAPSULATION), len(data) - len(ENCAPSULATION)
        if not self.topic.size <= size <= self._dtype.itemsize or bytes(data[:head]) != ENCAPSULATION:
            return False
        self._rows += data[head:]
        self._rows += self._fill[size - self.topic.size :]
        self._local.append(log_ns)
        self._epochs.append(self.topic.channels[channel])
        return True

    def records(self, stamps: tuple[int, int]) -> Records:
        """Those with a stamp from the first to before the second one; they hold no more memory than they need."""
        rows = np.frombuffer(self._rows, self._dtype)
        chosen = (rows["stamp_ns"] >= stamps[0]) & (rows["stamp_ns"] < stamps[1])
        return Records(rows[chosen], np.array(self._local, np.int64)[chosen], np.array(self._epochs, np.int64)[chosen])
