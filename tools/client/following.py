"""Sending joint setpoints at a steady rate and measuring how well the arm follows them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trocar.shm.commands import ENDINGS, became
from trocar.shm.mailbox.client import MailboxFull, Reply
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import boottime_ns, monotonic_ns, pause
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import FRESH_S, Watch
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note, plain

APPROACH_S = 60.0
MAX_GAP_S = 0.1  # from there on the arm, too, takes further goals for a new stream
SLICE_S = 0.005  # between two looks while we wait
MOVED = 1e-3  # rad, m: a larger displacement means that another program has moved the arm
STANDS_S = 10.0  # longer than the restart of a stalled process
STANDS = f"the system's time has stood still for {STANDS_S:g} s; see trocar status"
ENABLED = b"ENABLED"
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tracking:
    """Measured minus commanded, per joint (the jaw last, if there is one): rad, m."""

    names: tuple[str, ...]
    rms: Array
    most: Array
    samples: int


class Follower:
    """Sends setpoints to one homed arm; compares each measured sample with the row in force at its time."""

    def __init__(self, watch: Watch, remote: Remote, has_jaw: bool, time: SystemTime) -> None:
        """`watch` must have read a record: joints and names are taken from it. `time` is the system's."""
        self._time = time
        self._watch, self.remote, self._has_jaw = watch, remote, has_jaw
        self._joints = watch.count
        names = [str(plain(name)) for name in watch.reader.field("names")[: self._joints].tolist()]
        self.names = tuple(names + ["jaw"]) if has_jaw else tuple(names)
        self._measured = watch.reader.field("position")[: self._joints]
        self._jaw = watch.reader.field("jaw_position")
        self._state, self._homed = watch.reader.field("state"), watch.reader.field("is_homed")
        self._arrived = np.zeros(0)
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
        while watch.reader.next():  # earlier records are not compared
            pass

    def send(self, position: Array, velocity: Array | None, jaw: float | None) -> None:
        """One row, now."""
        n = self._joints
        self._values[:n] = position
        if velocity is not None:
            self._values[n:] = velocity
        self._before[:], self._before_ns = self._now, self._now_ns
        self._now[:n] = position
        self.remote.send("servo_jp", self._values if velocity is not None else self._values[:n])
        if jaw is not None:
            self._now[n:] = jaw
            self.remote.send("jaw/servo_jp", (jaw,))
        self._now_ns = self._time.now_ns()

    def collect(self) -> None:
        """Read measurements and answers since; Problem as in `look`."""
        self.look()
        for reply in self.remote.replies():
            if reply.outcome in ("refused", "failed"):
                self.refused += 1
                self.refusal = self.refusal or reply.text
            elif reply.text.startswith("clipped"):
                self.clipped_by_arm += 1

    def look(self) -> None:
        """Read measurements since; Problem if the arm was not ENABLED or homed meanwhile, or its record is silent.

        An arm that was paused and resumed between two looks has left ENABLED, too.
        """
        reader, name = self._watch.reader, self._watch.name
        fresh = False
        while reader.next():
            if not reader.stamp_ns:  # a torn one
                continue
            fresh = True
            if self._state[()] != ENABLED or not self._homed[()]:
                why = self._watch.last_error()
                went = f"went to {self._watch.state}" if self._state[()] != ENABLED else "is no longer homed"
                raise Problem(f"{name} {went}" + (f": {why}" if why else ""))
            self._compare(reader.stamp_ns)
        if not fresh and self._watch.age_s > FRESH_S:
            raise Problem(f"{name} does not publish its state: {self._watch.problem()}")

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
        """The errors so far; NaN without measurements."""
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(self._squares / self._samples) if self._samples else np.full(len(self.names), np.nan)
        return Tracking(self.names, rms, self._most.copy(), self._samples)

    def approach(self, position: Array, jaw: float | None, others: Sequence[Follower] = ()) -> None:
        """Move slowly to the start of a stream, while the `others` are checked, too.

        Problem if the arm does not get there, HeldUp if we were stalled meanwhile.
        """
        moves = [("move_jp", position)] + ([("jaw/move_jp", np.array([jaw]))] if jaw is not None else [])
        for command, values in moves:
            number = self.remote.send(command, values)
            reply = first_reply(self.remote, number, ENDINGS, APPROACH_S, (self, *others), self._time)
            if reply.outcome != "done":
                raise Problem(f"{self._watch.name}: the move to its start {became(reply.outcome)}: {reply.text}")
        self._watch.look()
        self._arrived = self._asked()

    def must_be_there(self) -> None:
        """Problem if the arm's setpoint is no longer where `approach` has left it."""
        self.look()
        self._watch.look()
        off = np.abs(self._asked() - self._arrived)
        if not (off <= MOVED).all():  # NaN is elsewhere, too
            joint = self.names[int(np.argmax(~(off <= MOVED)))]
            raise Problem(f"{self._watch.name}: another program has moved it from the starting pose ({joint})")

    def _asked(self) -> Array:
        """Its setpoint, the jaw last."""
        asked = self._watch.joints("setpoint_position")
        return np.append(asked, self._watch.number("jaw_setpoint_position")) if self._has_jaw else asked


@contextlib.contextmanager
def holding_at_end(arms: Sequence[tuple[Watch, Remote]], what: str) -> Iterator[None]:
    """At any end of `what` all arms get a hold, each independent of the others. HeldUp is reported."""
    with contextlib.ExitStack() as ends:
        for watch, remote in arms:
            ends.callback(_hold, watch, remote)
        try:
            yield
        except HeldUp as held:
            raise Problem(f"this program {held}: {what} has ended and the arm holds") from None


def _hold(watch: Watch, remote: Remote) -> None:
    """Stay at the present setpoint: moves under way, and velocities of the last row, end.

    An arm that does not show HOMED has left our motion, and what a person does with it since is not to be paused.
    """
    try:
        if not watch.look() or watch.text("sub_state") == "HOMED":
            remote.send("hold")
    except (SegmentError, MailboxFull) as error:
        note(f"{remote.instance} could not be commanded to hold: {error}")


def waited(until: Callable[[], bool], arms: Sequence[Follower], time: SystemTime) -> None:
    """Wait for a condition, in short slices in which all `arms` are checked; the condition is checked first.

    Problem if one of them is not ENABLED any more, or the system's time is stopped; HeldUp if we were stalled.
    """
    looked_ns, at_ns = boottime_ns(), time.now_ns()
    moved_ns = looked_ns
    while not until():
        pause(SLICE_S)
        before_ns, looked_ns = looked_ns, boottime_ns()
        if looked_ns - before_ns > MAX_GAP_S * 1e9:
            raise HeldUp(f"stalled for {(looked_ns - before_ns) * 1e-9:.1f} s")
        for arm in arms:
            arm.look()
        if time.now_ns() != at_ns:
            at_ns, moved_ns = time.now_ns(), looked_ns
        elif looked_ns - moved_ns > STANDS_S * 1e9:
            raise Problem(STANDS)


def first_reply(remote: Remote, number: int, wanted: Sequence[str], seconds: float, arms: Sequence[Follower],
                time: SystemTime) -> Reply:
    """The first `wanted` answer to a command, with a wait as in `waited`; Problem after this time of the system."""
    found: list[Reply] = []
    end_ns = time.now_ns() + round(seconds * 1e9)

    def came() -> bool:
        found.extend(reply for reply in remote.replies_to(number) if reply.outcome in wanted)
        return bool(found) or time.now_ns() >= end_ns

    waited(came, arms, time)
    if not found:
        raise Problem(f"{remote.instance}: its command has not ended after {seconds:g} s")
    return found[0]


class HeldUp(Problem):
    """This program was stalled for so long that it must not continue as if no time had passed."""


def beats(rate_hz: float, count: int | None, skipped: list[int], longest_s: float = math.inf,
          time: SystemTime | None = None) -> Iterator[int]:
    """Numbers of the periods as they begin, up to `count`, on absolute deadlines; late ones add to `skipped[0]`.

    HeldUp if one begins more than `longest_s` too late after the last one. They are periods of the system's `time`,
    None: real time; Problem if that is stopped.
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
                raise Problem(STANDS)
        elif left > 0:
            pause(left * 1e-9)
        last_ns, begun_ns = begun_ns, gap_ns()
        held_s = (begun_ns - last_ns - period_ns) * 1e-9
        if held_s > longest_s:
            raise HeldUp(f"stalled for {held_s:.1f} s")
        late = int((now_ns() - deadline) // period_ns)
        if count is not None:
            late = min(late, count - number)
        number += late
        skipped[0] += late
        if count is None or number < count:
            yield number
        number += 1
