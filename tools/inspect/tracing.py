"""Tracking of a master by its slave: from the records of a teleoperation, its slave and their io, while they run.

Error: the measured pose of the slave against the goal in force, the last one sent by the teleoperation. Latency: from
the read request for the master's sample to the write of the setpoint made from it. It is composed of stamps; if a stamp
is that of a cycle's begin, the cycle's output counts as published STEP_NS later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

STEP_NS = 150_000
NEVER = np.iinfo(np.int64).max
FIGURES = ("error_mm_rms", "error_mm_max", "error_deg_rms", "error_deg_max", "latency_ms_p50", "latency_ms_p99",
           "followed_s")


@dataclass(frozen=True, slots=True)
class IoTrace:
    """Cycles of io, ns: times of request, answer, and end of write."""

    read: Stamps
    received: Stamps
    written: Stamps


def latencies(masters: Stamps, sent: Stamps, setpoints: Stamps, io: IoTrace) -> Stamps:
    """ns, for every goal that can be evaluated: sent in a cycle that began at `sent`, from a master's record of
    `masters`.

    `setpoints`: begins of the slave's cycles. A goal whose way is not completely in the records is left out.
    """
    source = np.searchsorted(io.written, masters, "right") - 1
    cycle = np.searchsorted(setpoints, sent + STEP_NS)
    known = (source >= 0) & (cycle < len(setpoints))
    source, cycle = source[known], cycle[known]
    end = np.searchsorted(io.received, setpoints[cycle] + STEP_NS)
    known = end < len(io.written)
    found: Stamps = io.written[end[known]] - io.read[source[known]]
    return found


def errors(stamps: Stamps, measured: Array, sent: Stamps, goals: Array) -> tuple[Array, Array]:
    """m and rad by which poses (n, 7) at `stamps` are off the goal (m, 7) in force; those before the first left out."""
    at = np.searchsorted(sent, stamps, "right") - 1
    measured, goals = measured[at >= 0], goals[at[at >= 0]]
    distance = np.linalg.norm(measured[:, :3] - goals[:, :3], axis=1)
    together = np.abs(np.einsum("ij,ij->i", measured[:, 3:], goals[:, 3:]))
    return distance, 2.0 * np.arccos(np.minimum(1.0, together))


def in_force(stamps: Stamps, cycles: Stamps, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Stamps for which the flag of the last cycle before was set; before the first: not."""
    at = np.searchsorted(cycles, stamps, "right") - 1
    return (at >= 0) & flags[at] if len(flags) else np.zeros(len(stamps), dtype=bool)


class Column:
    """Kept columns of a ring's records, piece by piece."""

    def __init__(self, reader: RingReader, fields: tuple[str, ...]) -> None:
        self._reader, self._fields = reader, fields
        self._pieces: list[list[NDArray[Any]]] = [[] for _ in fields]
        reader.newest()
        self._seen = reader.stamp_ns

    def collect(self) -> None:
        """Read records since the last call."""
        rows = self._reader.since(self._seen + 1)
        if len(rows):
            self._seen = int(rows[-1]["stamp_ns"])
            for pieces, field in zip(self._pieces, self._fields, strict=True):
                pieces.append(rows[field].copy())

    def all(self) -> list[NDArray[Any]]:
        """Each field of all records, oldest first."""
        return [np.concatenate(pieces) if pieces else np.zeros(0) for pieces in self._pieces]

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


class Trace:
    """Watches a teleoperation from now on; call `collect` at least once a second. Close it."""

    def __init__(self, system: str, teleop: str, slave: str, io: str) -> None:
        def column(name: str, ring: str, *fields: str) -> Column:
            return Column(directory.reader(system, name, ring), fields)

        self._teleop = column(teleop, "state", "stamp_ns", "following", "sent_ns", "master_stamp_ns", "goal_cp")
        self._slave = column(slave, "state", "stamp_ns", "valid", "measured_cp")
        self._setpoint = column(slave, "setpoint", "stamp_ns")
        self._io = column(io, "state", "read_ns", "recv_ns", "write_ns")
        self._columns = (self._teleop, self._slave, self._setpoint, self._io)

    def collect(self) -> None:
        """Read records since the last call."""
        for column in self._columns:
            column.collect()

    def figures(self) -> dict[str, float]:
        """Following error and latency so far, while the slave followed; NaN: it never followed."""
        stamp, following, sent, masters, goals = self._teleop.all()
        at, valid, measured = self._slave.all()
        new = (following > 0) & (sent == stamp)
        during = (at >= stamp[new].min(initial=NEVER)) & (at <= stamp[new].max(initial=0)) & (valid > 0)
        during &= in_force(at, stamp, following > 0)
        if not np.any(during):
            return dict.fromkeys(FIGURES, float("nan"))
        distance, angle = errors(at[during], measured[during], sent[new], goals[new])
        late = latencies(masters[new][:, 0], sent[new], self._setpoint.all()[0], IoTrace(*self._io.all())) * 1e-6
        return {
            "error_mm_rms": _rms(distance) * 1e3, "error_mm_max": float(distance.max()) * 1e3,
            "error_deg_rms": float(np.degrees(_rms(angle))), "error_deg_max": float(np.degrees(angle.max())),
            "latency_ms_p50": _percentile(late, 50), "latency_ms_p99": _percentile(late, 99),
            "followed_s": float(np.count_nonzero(new)) * float(np.median(np.diff(stamp))) * 1e-9,
        }

    def close(self) -> None:
        """Unmap all."""
        for column in self._columns:
            column.close()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _percentile(values: NDArray[Any], percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")
