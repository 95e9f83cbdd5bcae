"""The 16-channel multiplexer of a Classic cart: four analog inputs at a time, one channel after the other.

Channels 0 to 5 are the first potentiometers of the six joints, 6 to 11 the second ones, 12 to 15 other voltages. The
interface board has a counter: one pulse advances it by a channel, another resets it to 0, and four lines show the
channel. After each step the inputs need 30 ms to settle; then 60 samples are averaged.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array

CHANNELS: Final = 16
PLUGS: Final = 4
SAMPLES: Final = 60
SETTLE_NS: Final = 30_000_000
INCREMENT, RESET = "increment", "reset"


class Multiplexer:
    """`volts` (plugs, channels) are those of the last complete round; `rounds` counts them.

    `wrong`: (shown, expected) while the counter shows an unexpected channel, else None.
    """

    def __init__(self, samples: int = SAMPLES, settle_ns: int = SETTLE_NS) -> None:
        """The counter's position is unknown: call `begin` first."""
        self._samples, self._settle_ns = samples, settle_ns
        self.volts: Array = np.zeros((PLUGS, CHANNELS))
        self.rounds = 0
        self.wrong: tuple[int, int] | None = None
        self._current: Array = np.zeros((PLUGS, CHANNELS))
        self._sum: Array = np.zeros(PLUGS)
        self._count = 0
        self._expected = 0
        self._ready_ns = 0

    def begin(self, now_ns: int) -> str:
        """Restart from the first channel; returns the pulse the counter needs."""
        self._count, self._expected, self._ready_ns = 0, 0, now_ns + self._settle_ns
        self._sum.fill(0.0)
        return RESET

    def take(self, stamp_ns: int, channel: int, volts: Array) -> str:
        """A sample of the four inputs while the counter shows `channel`; returns the pulse the counter needs, or ""."""
        if stamp_ns < self._ready_ns:
            return ""
        if channel != self._expected:
            self.wrong = (channel, self._expected)
            return self.begin(stamp_ns)
        self._sum += volts
        self._count += 1
        if self._count < self._samples:
            return ""
        return self._next(stamp_ns)

    def skip(self) -> None:
        """Samples were missed: restart the average of this channel."""
        self._count = 0
        self._sum.fill(0.0)

    def _next(self, stamp_ns: int) -> str:
        self._current[:, self._expected] = self._sum / self._samples
        self._count, self._ready_ns = 0, stamp_ns + self._settle_ns
        self._sum.fill(0.0)
        self._expected = (self._expected + 1) % CHANNELS
        if self._expected:
            return INCREMENT
        self.volts[...] = self._current
        self.rounds += 1
        self.wrong = None
        return RESET
