"""Joints whose goals or efforts are clipped, reported once an episode."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

EPISODE_NS: Final = 500_000_000


class Clipping:
    """The clipped joints that were already reported: once an episode."""

    def __init__(self, size: int) -> None:
        self._reported = np.zeros(size, dtype=np.bool_)
        self._last_ns = -EPISODE_NS

    def is_news(self, outside: NDArray[np.bool_], now_ns: int) -> bool:
        """Whether one of these clipped joints (size,) has just begun to be clipped."""
        if now_ns - self._last_ns >= EPISODE_NS:
            self._reported[...] = False
        self._last_ns = now_ns
        news = bool((outside & ~self._reported).any())
        self._reported |= outside
        return news
