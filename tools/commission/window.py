"""Some time of an io's record: the fields that stages look at, a row a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.tools.commission.subject import Subject

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

FIELDS = ("valid", "bad_reads", "position", "position_error", "pot_position", "pot_voltage", "pot_bits", "current",
          "current_request", "temperature", "amp_on", "powered", "relay", "power_fault", "watchdog", "input",
          "limits_enforced", "tracking_check", "pot_check")


class Window:
    """Samples in order; `stamp_s` (k,) are their times."""

    def __init__(self, stamp_s: Floats, fields: Mapping[str, NDArray[Any]]) -> None:
        """`fields`: those of FIELDS, each (k, …)."""
        self.stamp_s, self.fields = stamp_s, fields

    @classmethod
    def of_rows(cls, rows: NDArray[Any]) -> Window:
        """From records of a ring."""
        return cls(rows["stamp_ns"] * 1e-9, {name: np.array(rows[name]) for name in FIELDS})

    @classmethod
    def joined(cls, parts: Sequence[Window]) -> Window:
        """One after the other."""
        fields = {name: np.concatenate([part.fields[name] for part in parts]) for name in FIELDS}
        return cls(np.concatenate([part.stamp_s for part in parts]), fields)

    def __len__(self) -> int:
        return len(self.stamp_s)

    def axes(self, field: str, subject: Subject) -> Floats:
        """A field of actuators (k, n)."""
        return np.asarray(self.fields[field][:, subject.axes], dtype=np.float64)

    def drives(self, field: str, subject: Subject) -> NDArray[Any]:
        """A field of actuators and brakes (k, n + b)."""
        found: NDArray[Any] = self.fields[field][:, list(subject.drives)]
        return found

    def flags(self, field: str, subject: Subject) -> Flags:
        """A field of robots (k,)."""
        return np.asarray(self.fields[field][:, subject.row], dtype=bool)

    def ever_on(self, subject: Subject) -> Flags:
        """Whether the amplifier of each actuator (n,) was on at any time."""
        found: Flags = np.any(self.fields["amp_on"][:, subject.axes], axis=0)
        return found

    def moved(self, field: str, subject: Subject) -> Floats:
        """Motion of every actuator from the first to the last samples (n,)."""
        values, some = self.axes(field, subject), max(1, min(20, len(self) // 4))
        change: Floats = values[-some:].mean(axis=0) - values[:some].mean(axis=0)
        return change
