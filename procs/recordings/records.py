"""Records read from a recording: topics, arrays of records, and joining of pieces."""

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
    """A topic of a recording: PSM1/state, or PSM1/measured_js. `dtype`: of records; None for views."""

    name: str
    type_name: str
    instance: str = ""
    ring: str = ""
    kind: str = ""
    dtype: np.dtype[np.void] | None = None
    schema: str = ""
    channels: dict[int, int] = field(default_factory=dict)
    """Epoch of the writer for each channel."""
    size: int = 0
    """Bytes of a record in its message, which lacks only the padding at the end."""
    info: dict[str, Any] = field(default_factory=dict)
    """Information from the ring's header: `robots`, `dims`, names of inputs."""

    @property
    def rate_hz(self) -> float:
        """Nominal rate of records; 0: on events."""
        rate = self.info.get("rate_hz", 0)
        return float(rate) if isinstance(rate, (int, float)) and 0 < rate < MAX_RATE_HZ else 0.0


@dataclass(frozen=True, slots=True)
class Records:
    """Records of a topic in order: `rows` (n,) has the fields of the ring, with sequence and stamp_ns.

    `local_ns` (n,): time of day; `epoch` (n,): the writer's epoch.
    """

    rows: NDArray[Any]
    local_ns: NDArray[np.int64]
    epoch: NDArray[np.int64]

    @property
    def missing(self) -> int:
        """Number of missing records between the first and the last."""
        numbers = self.rows["sequence"]
        return int(numbers[-1]) - int(numbers[0]) + 1 - len(numbers) if len(numbers) else 0


def joined(pieces: Sequence[Records], dtype: np.dtype[np.void]) -> Records:
    """Join pieces of one topic, in the order of sequence numbers, without duplicates: some rings are recorded twice."""
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
    """Collects the records of one topic in a chunk."""

    def __init__(self, topic: RecordedTopic, dtype: np.dtype[np.void]) -> None:
        self.topic, self._dtype = topic, dtype
        self._rows, self._local, self._epochs = bytearray(), list[int](), list[int]()
        self._fill = bytes(dtype.itemsize - topic.size)

    def add(self, channel: int, log_ns: int, data: memoryview) -> bool:
        """Add a message; False if it is not a record of the topic."""
        head, size = len(ENCAPSULATION), len(data) - len(ENCAPSULATION)
        if not self.topic.size <= size <= self._dtype.itemsize or bytes(data[:head]) != ENCAPSULATION:
            return False
        self._rows += data[head:]
        self._rows += self._fill[size - self.topic.size :]
        self._local.append(log_ns)
        self._epochs.append(self.topic.channels[channel])
        return True

    def records(self, stamps: tuple[int, int]) -> Records:
        """Records with stamps from the first to before the second of `stamps`, as compact copies."""
        rows = np.frombuffer(self._rows, self._dtype)
        chosen = (rows["stamp_ns"] >= stamps[0]) & (rows["stamp_ns"] < stamps[1])
        return Records(rows[chosen], np.array(self._local, np.int64)[chosen], np.array(self._epochs, np.int64)[chosen])
