"""Recorded setpoints sent to arms of a running system as a stream.

It is a command of the person who types it, and follows the same rules: nothing continues after a fault.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import SystemConfig
from trocar.procs.recordings.reading import RecordingReader
from trocar.shm.mailbox.client import begin
from trocar.shm.mailbox.origins import Origin
from trocar.shm.time.system_time import SystemTime
from trocar.tools.analysis.choosing import Stretch, spans
from trocar.tools.client.following import MAX_GAP_S, Follower, beats, holding_at_end
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import Watch, document_of
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say
from trocar.tools.replay.configuration import is_real

RATE_HZ: Final = 200.0
SHOWN_EVERY: Final = 20
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """Motion of an arm while it was homed: stamps (n,), setpoints and measured joints (n, j), jaws (n,) or None."""

    arm: str
    stamp_ns: NDArray[np.int64]
    setpoint: Array
    measured: Array
    jaw: Array | None

    def at(self, stamps: Array, values: Array) -> Array:
        """Values at other stamps, in straight lines between those recorded."""
        known = self.stamp_ns.astype(np.float64)
        columns = values.reshape(len(values), -1)
        return np.column_stack([np.interp(stamps, known, column) for column in columns.T])


class NoMotion(Problem):
    """An arm has no motion in the recording that could be sent again."""


def motion_of(recording: RecordingReader, arm: str, part: Stretch) -> RecordedMotion:
    """Its first homed stretch in `part`; NoMotion if there is none, Problem if it cannot be sent."""
    topic = f"{arm}/state"
    if topic not in recording.record_topics or not spans(recording, [topic]):
        raise NoMotion(f"{recording.path.name} has no {topic}")
    rows = recording.records(topic, stamps=part.stamps).rows
    needed = {"state", "is_homed", "setpoint_position", "position", "count", "has_jaw", "jaw_setpoint_position"}
    if missing := needed - set(rows.dtype.names or ()):
        raise Problem(f"{topic} lacks {', '.join(sorted(missing))}: {arm} is no arm, or of another version")
    good = (rows["state"] == b"ENABLED") & rows["is_homed"]
    first = int(good.argmax()) if good.any() else len(rows)
    ends = np.flatnonzero(~good[first:])
    rows = rows[first : first + int(ends[0])] if len(ends) else rows[first:]
    if len(rows) < 2:
        raise NoMotion(f"{arm} is not homed in this part of {recording.path.name}: there are no setpoints to send")
    joints, has_jaw = int(rows["count"][0]), bool(rows["has_jaw"][0])
    jaw = rows["jaw_setpoint_position"].astype(np.float64) if has_jaw else None
    setpoint = rows["setpoint_position"][:, :joints].astype(np.float64)
    if not np.isfinite(setpoint).all() or (jaw is not None and not np.isfinite(jaw).all()):
        raise Problem(f"{arm}: setpoints in {recording.path.name} are not finite")
    return RecordedMotion(arm, rows["stamp_ns"].astype(np.int64), setpoint,
                          rows["position"][:, :joints].astype(np.float64), jaw)


def motions_of(recording: RecordingReader, arms: Sequence[str],
               part: Stretch) -> tuple[list[RecordedMotion], dict[str, str]]:
    """All existing ones, and the reasons why the other arms have none."""
    found, left_out = [], {}
    for arm in arms:
        try:
            found.append(motion_of(recording, arm, part))
        except NoMotion as error:
            left_out[arm] = str(error)
    return found, left_out


def real_robots(system: SystemConfig, arms: Sequence[str]) -> list[str]:
    """Those of the arms that are neither KINEMATIC nor on emulated boards."""
    buses = {io.name for io in system.ios if is_real(system, io)}
    return [name for name in arms if system.arm(name).io in buses]


def refuse_real(system: str, arms: Sequence[str], allowed: bool) -> None:
    """Problem if a real robot would move without permission."""
    try:
        real = real_robots(document_of(system), arms)
    except KeyError as error:
        raise Problem(f"system {system}: {error.args[0]}") from None
    if real and not allowed:
        raise Problem(f"{', '.join(real)}: a real robot would move as it was recorded; --real-robot allows it")


class ArmReplay:
    """One arm in motion, and its deviation from the recording: rad, m."""

    def __init__(self, system: str, motion: RecordedMotion, time: SystemTime, whole: Origin,
                 held: contextlib.ExitStack) -> None:
        """Open it, until the end of `held`. Problem if it is not homed, or another arm than the recorded one."""
        self.motion, name = motion, motion.arm
        self.watch = watch = held.enter_context(Watch(system, name))
        if not watch.look() or watch.state != "ENABLED" or not watch.homed:
            raise Problem(f"{name} is not homed; first: trocar home {name}")
        if watch.count != motion.setpoint.shape[1]:
            raise Problem(f"{name} has {watch.count} joints, recorded are {motion.setpoint.shape[1]}")
        self.remote = held.enter_context(Remote(system, name))
        self.remote.on_behalf(whole)
        self.has_jaw = motion.jaw is not None and watch.flag("has_jaw")
        self.follower = Follower(watch, self.remote, self.has_jaw, time)
        self.squares: Array = np.zeros(watch.count)
        self.most: Array = np.zeros(watch.count)
        self.samples = 0

    def jaw_at(self, stamps: Array) -> Array | None:
        """Its jaw at other stamps (n,); None: it has no jaw to move."""
        return self.motion.at(stamps, self.motion.jaw)[:, 0] if self.has_jaw and self.motion.jaw is not None else None

    def compare(self, recorded: Array) -> None:
        """Current measurements against recorded ones."""
        off = np.abs(self.watch.joints("position") - recorded)
        self.squares += off * off
        self.most = np.maximum(self.most, off)
        self.samples += 1

    def result(self) -> dict[str, Any]:
        """Per joint: against the setpoints sent, and against the recorded measurements."""
        follower = self.follower
        tracking = follower.tracking
        rms = np.sqrt(self.squares / self.samples) if self.samples else self.squares
        return {"arm": self.motion.arm, "names": list(tracking.names), "samples": tracking.samples,
                "rms": tracking.rms.tolist(), "max": tracking.most.tolist(), "recorded_rms": rms.tolist(),
                "recorded_max": self.most.tolist(), "refused": follower.refused,
                "refusal": follower.refusal, "clipped_by_arm": follower.clipped_by_arm}


def all_homed(motions: Sequence[RecordedMotion]) -> tuple[int, int]:
    """From which stamp to which one all arms are homed; Problem: never."""
    start, end = max(int(m.stamp_ns[0]) for m in motions), min(int(m.stamp_ns[-1]) for m in motions)
    if end <= start:
        raise Problem("the arms are homed at different times in it; replay them one by one (--arms)")
    return start, end


@contextlib.contextmanager
def at_the_start(system: str, motions: Sequence[RecordedMotion], start_ns: int, say: Say
                 ) -> Iterator[tuple[list[ArmReplay], SystemTime]]:
    """All arms at their positions of this stamp, moved there slowly, one after the other.

    They hold at any end. Problem if one of them is not homed, faults, or is moved by another program meanwhile.
    """
    with contextlib.ExitStack() as held:
        time, whole = held.enter_context(SystemTime(system)), begin(system)  # all of it is one command
        arms = [ArmReplay(system, motion, time, whole, held) for motion in motions]
        held.enter_context(holding_at_end([(arm.watch, arm.remote) for arm in arms], "the replay"))
        stamp, followers = np.array([start_ns], np.float64), [arm.follower for arm in arms]
        for arm in arms:
            say(f"moving {arm.motion.arm} to its starting pose", None)
            jaw = arm.jaw_at(stamp)
            arm.follower.approach(arm.motion.at(stamp, arm.motion.setpoint)[0], None if jaw is None else float(jaw[0]),
                                  [each for each in followers if each is not arm.follower])
        for follower in followers:
            follower.must_be_there()
        yield arms, time


def stream(system: str, motions: Sequence[RecordedMotion], speed: float, say: Say) -> list[dict[str, Any]]:
    """Move slowly to the start, then send the setpoints at `speed`; Problem if an arm faults or is not homed."""
    start, end = all_homed(motions)
    count = max(2, round((end - start) * 1e-9 / speed * RATE_HZ))
    stamps: Array = start + np.arange(count, dtype=np.float64) * (1e9 * speed / RATE_HZ)
    with at_the_start(system, motions, start, say) as (arms, time):
        rows = [ArmRows(arm, stamps) for arm in arms]
        for k in beats(RATE_HZ, count, [0], MAX_GAP_S, time):
            for row in rows:
                row.send(k)
            if k % SHOWN_EVERY == 0:
                say(f"{k / RATE_HZ * speed:.1f} s", k / count)
        for arm in arms:
            arm.follower.collect()
        return [arm.result() for arm in arms]


class ArmRows:
    """Setpoints and measurements of one arm at the beats of a stream."""

    def __init__(self, arm: ArmReplay, stamps: Array) -> None:
        self._arm, self._then = arm, arm.motion.at(stamps, arm.motion.measured)
        self._goals, self._jaw = arm.motion.at(stamps, arm.motion.setpoint), arm.jaw_at(stamps)
        self._velocity = np.gradient(self._goals, 1.0 / RATE_HZ, axis=0)

    def send(self, k: int) -> None:
        """The next row, when the arm is well."""
        arm = self._arm
        arm.follower.collect()
        if arm.watch.look() and arm.watch.flag("valid"):
            arm.compare(self._then[k])
        arm.follower.send(self._goals[k], self._velocity[k], None if self._jaw is None else float(self._jaw[k]))
