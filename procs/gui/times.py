"""Times of day of a system's stamps. Simulated time may be slower than that, and not always as much. Pure."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Stamps = NDArray[Any]


class Times:
    """Both times at some moments, in order; between them, both pass evenly, outside, equally fast."""

    def __init__(self, stamps: Stamps, local: Stamps) -> None:
        """At least one moment."""
        order = np.argsort(stamps, kind="stable")
        self._stamps, self._local = stamps.astype(np.int64)[order], local.astype(np.int64)[order]

    def local(self, stamps: Stamps) -> NDArray[np.int64]:
        """Times of day of stamps."""
        return _mapped(stamps, self._stamps, self._local)

    def stamp(self, local_ns: int) -> int:
        """The stamp at a time of day; none is below 0."""
        return max(0, int(_mapped(np.array([local_ns]), self._local, self._stamps)[0]))


def _mapped(values: Stamps, known: Stamps, to: Stamps) -> NDArray[np.int64]:
    values = values.astype(np.int64)
    inside = to[0] + np.interp((values - known[0]).astype(float), (known - known[0]).astype(float),
                               (to - to[0]).astype(float)).astype(np.int64)
    outside = np.where(values < known[0], to[0] + values - known[0], to[-1] + values - known[-1])
    found: NDArray[np.int64] = np.where((values < known[0]) | (values > known[-1]), outside, inside)
    return found
