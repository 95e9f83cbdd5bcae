"""Sending joint setpoints at a steady rate and measuring how well the arm follows them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shm.clock import boottime_ns, monotonic_ns, pause
from shm.system_time import SystemTime
from tools.errors import Problem
from tools.inspect.watch import FRESH_S, Watch
from tools.printing import plain
from tools.remote import Remote

APPROACH_S = 60.0
STANDS_S = 10.0  # longer than it takes to start again who held it up
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tracking:
    """Measured minus commanded, per joint (the jaw last, where there is one): rad, m."""

    names: tuple[str, ...]
    rms: Array
    most: Array
    samples: int


class Follower:
    """Sends setpoints to one homed arm; compares each measured sample with the row in force at its time."""

    def __init__(self, watch: Watch, remote: Remote, has_jaw: bool, time: SystemTime) -> None:
        """`watch` must have read a record: joints and names are taken from it. `time` is the system's."""
        self._time = time
        self._watch, self._remote, self._has_jaw = watch, remote, has_jaw
        self._joints = watch.count
        names = [str(plain(name)) for name in watch.reader.field("names")[: self._joints].tolist()]
        self.names = tuple(names + ["jaw"]) if has_jaw else tuple(names)
        self._measured = watch.reader.field("position")[: self._joints]
        self._jaw = watch.reader.field("jaw_position")
        self._valid = watch.reader.field("valid")
        width = len(self.names)
        self._now, self._before = np.zeros(width), np.zeros(width)  # rows in force: the last one, the one before
        self._now_ns = self._before_ns = 0
        self._error, self._squares, self._most = np.zeros(width), np.zeros(width), np.zeros(width)
        self._samples = 0
        self._values = np.zeros(2 * self._joints)
        self.refused = 0
        self.refusal = ""
        self.clipped_by_arm = 0
        while watch.reader.next():  # what lies behind us is not compared
            pass

    def send(self, position: Array, velocity: Array | None, jaw: float | None) -> None:
        """One row, now."""
        n = self._joints
        self._values[:n] = position
        if velocity is not None:
            self._values[n:] = velocity
        self._before[:], self._before_ns = self._now, self._now_ns
        self._now[:n] = position
        self._remote.post("servo_jp", self._values if velocity is not None else self._values[:n])
        if jaw is not None:
            self._now[n:] = jaw
            self._remote.post("jaw/servo_jp", (jaw,))
        self._now_ns = self._time.now_ns()

    def collect(self) -> None:
        """Take in what was measured since; Problem when the arm has left ENABLED, or shows nothing any more."""
        reader = self._watch.reader
        fresh = False
        while reader.next():
            fresh = True
            self._compare(reader.stamp_ns)
        for reply in self._remote.replies():
            if reply.outcome in ("refused", "failed"):
                self.refused += 1
                self.refusal = self.refusal or reply.text
            elif reply.text.startswith("clipped"):
                self.clipped_by_arm += 1
        if fresh and reader.stamp_ns and self._watch.state != "ENABLED":  # no stamp: the last one was torn
            why = self._watch.last_error()
            raise Problem(f"{self._watch.name} went to {self._watch.state}" + (f": {why}" if why else ""))
        if not fresh and self._watch.age_s > FRESH_S:
            raise Problem(f"{self._watch.name} does not show what it does: {self._watch.problem()}")

    def _compare(self, stamp_ns: int) -> None:
        if stamp_ns >= self._now_ns:
            row, since_ns = self._now, self._now_ns
        else:
            row, since_ns = self._before, self._before_ns
        if not since_ns or stamp_ns < since_ns or not self._valid[()]:
            return
        n = self._joints
        self._error[:n] = self._measured
        if self._has_jaw:
            self._error[n] = self._jaw[()]
        self._error -= row
        np.abs(self._error, out=self._error)
        np.maximum(self._most, self._error, out=self._most)
        self._error *= self._error
        self._squares += self._error
        self._samples += 1

    @property
    def tracking(self) -> Tracking:
        """The errors so far; NaN when nothing was measured."""
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(self._squares / self._samples) if self._samples else np.full(len(self.names), np.nan)
        return Tracking(self.names, rms, self._most.copy(), self._samples)

    def hold(self) -> None:
        """Stay where the arm is asked to be now: the velocities of the last row end."""
        self._remote.post("hold")


def approach(remote: Remote, position: Array, jaw: float | None) -> None:
    """Move to where a stream begins, as slowly as moves are; Problem where the arm does not get there."""
    moves = [("move_jp", position)] + ([("jaw/move_jp", np.array([jaw]))] if jaw is not None else [])
    for command, values in moves:
        reply = remote.settled(command, values, timeout=APPROACH_S)
        if reply.outcome != "done":
            raise Problem(f"{remote.instance}: the move to where it begins was {reply.outcome}: {reply.text}")


class HeldUp(Problem):
    """This program was held up for so long that it must not go on as if no time had passed."""


def beats(rate_hz: float, count: int | None, skipped: list[int], longest_s: float = math.inf,
          time: SystemTime | None = None) -> Iterator[int]:
    """Numbers of the periods as they begin, up to `count`, on absolute deadlines; late ones add to `skipped[0]`.

    HeldUp where one begins more than `longest_s` later than it should after the last one. They are those of the
    system's `time`, None: real time; Problem where that stands still.
    """
    simulated = time is not None and time.simulated
    now_ns, gap_ns = (time.now_ns, time.now_ns) if time is not None and simulated else (monotonic_ns, boottime_ns)
    period_ns = 1e9 / rate_hz
    start = now_ns() + round(period_ns)
    number, begun_ns = 0, gap_ns()
    while count is None or number < count:
        deadline = start + round(number * period_ns)
        left = deadline - now_ns()
        if left > 0 and time is not None and simulated:
            time.pause_until(deadline, STANDS_S)
            if time.now_ns() < deadline:
                raise Problem(f"the system's time has stood still for {STANDS_S:g} s; see trocar status")
        elif left > 0:
            pause(left * 1e-9)
        last_ns, begun_ns = begun_ns, gap_ns()
        held_s = (begun_ns - last_ns - period_ns) * 1e-9
        if held_s > longest_s:
            raise HeldUp(f"held up for {held_s:.1f} s")
        late = int((now_ns() - deadline) // period_ns)
        if count is not None:
            late = min(late, count - number)
        number += late
        skipped[0] += late
        if count is None or number < count:
            yield number
        number += 1
