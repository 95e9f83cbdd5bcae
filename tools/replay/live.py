"""What was recorded sent to arms of a running system: their setpoints as a stream, or what they were asked for.

Both are commands of the person who types it, and obey the rules of those: nothing goes on after a fault.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import SystemConfig
from procs.recordings.reading import RecordingReader
from shm.client import begin
from shm.system_time import SystemTime
from tools.errors import Problem
from tools.following import Follower, HeldUp, approach, beats
from tools.inspect.watch import Watch, document_of
from tools.printing import Say
from tools.recorded.choosing import Stretch
from tools.remote import Remote
from tools.replay.commands import RecordedCommand, commands_of
from tools.replay.configuration import LOOPBACK

RATE_HZ: Final = 200.0
MAX_GAP_S: Final = 0.1
SHOWN_EVERY: Final = 20
REPLY_S: Final = 5.0
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """What an arm did while it was homed: stamps (n,), setpoints and measured joints (n, j), jaws (n,) or None."""

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


def motion_of(recording: RecordingReader, arm: str, part: Stretch) -> RecordedMotion:
    """An arm's first stretch of being homed in `part`; Problem where there is none."""
    topic = f"{arm}/state"
    if topic not in recording.record_topics:
        raise Problem(f"{recording.path.name} has no {topic}")
    rows = part.of(recording.records(topic)).rows
    needed = {"state", "is_homed", "setpoint_position", "position", "count", "has_jaw", "jaw_setpoint_position"}
    if missing := needed - set(rows.dtype.names or ()):
        raise Problem(f"{topic} lacks {', '.join(sorted(missing))}: {arm} is no arm, or of another version")
    good = (rows["state"] == b"ENABLED") & rows["is_homed"]
    first = int(good.argmax()) if good.any() else len(rows)
    ends = np.flatnonzero(~good[first:])
    rows = rows[first : first + int(ends[0])] if len(ends) else rows[first:]
    if len(rows) < 2:
        raise Problem(f"{arm} is not homed in this part of {recording.path.name}: there are no setpoints to send")
    joints, has_jaw = int(rows["count"][0]), bool(rows["has_jaw"][0])
    jaw = rows["jaw_setpoint_position"].astype(np.float64) if has_jaw else None
    setpoint = rows["setpoint_position"][:, :joints].astype(np.float64)
    if not np.isfinite(setpoint).all() or (jaw is not None and not np.isfinite(jaw).all()):
        raise Problem(f"{arm}: setpoints in {recording.path.name} are not finite")
    return RecordedMotion(arm, rows["stamp_ns"].astype(np.int64), setpoint,
                          rows["position"][:, :joints].astype(np.float64), jaw)


def real_robots(system: SystemConfig, arms: Sequence[str]) -> list[str]:
    """Those of the arms that are neither KINEMATIC nor on emulated boards."""
    found = []
    for name in arms:
        arm = system.arm(name)
        with contextlib.suppress(KeyError):
            io = system.io(arm.io)
            if io.port and not (system.emulation is not None and io.port.startswith(LOOPBACK)):
                found.append(name)
    return found


def refuse_real(system: str, arms: Sequence[str], allowed: bool) -> None:
    """Problem where a real robot would move and nobody has said that it may."""
    try:
        real = real_robots(document_of(system), arms)
    except KeyError as error:
        raise Problem(f"system {system}: {error.args[0]}") from None
    if real and not allowed:
        raise Problem(f"{', '.join(real)}: a real robot would move as it was recorded; --real-robot says that it may")


@dataclass(slots=True)
class ArmReplay:
    """One arm on its way, and how far it was from what was recorded: rad, m."""

    motion: RecordedMotion
    watch: Watch
    remote: Remote
    follower: Follower | None = None
    squares: Array = field(default_factory=lambda: np.zeros(0))
    most: Array = field(default_factory=lambda: np.zeros(0))
    samples: int = 0

    def compare(self, recorded: Array) -> None:
        """What is measured now against what was measured then."""
        off = np.abs(self.watch.joints("position") - recorded)
        if not self.samples:
            self.squares, self.most = np.zeros(len(off)), np.zeros(len(off))
        self.squares += off * off
        self.most = np.maximum(self.most, off)
        self.samples += 1

    def result(self) -> dict[str, Any]:
        """Per joint: against the setpoints sent, and against what was measured when it was recorded."""
        assert self.follower is not None
        tracking = self.follower.tracking
        rms = np.sqrt(self.squares / self.samples) if self.samples else self.squares
        return {"arm": self.motion.arm, "names": list(tracking.names), "samples": tracking.samples,
                "rms": tracking.rms.tolist(), "max": tracking.most.tolist(), "recorded_rms": rms.tolist(),
                "recorded_max": self.most.tolist(), "refused": self.follower.refused,
                "refusal": self.follower.refusal, "clipped_by_arm": self.follower.clipped_by_arm}


def stream(system: str, motions: Sequence[RecordedMotion], speed: float, say: Say) -> list[dict[str, Any]]:
    """Move slowly to where it began, then send the setpoints at `speed`; Problem when an arm faults or is not homed."""
    start, end = (int(pick(at)) for pick, at in ((max, [m.stamp_ns[0] for m in motions]),
                                                 (min, [m.stamp_ns[-1] for m in motions])))
    if end <= start:
        raise Problem("the arms are homed at different times in it; replay them one by one (--arms)")
    count = max(2, round((end - start) * 1e-9 / speed * RATE_HZ))
    stamps: Array = start + np.arange(count, dtype=np.float64) * (1e9 * speed / RATE_HZ)
    with contextlib.ExitStack() as held:
        time = held.enter_context(SystemTime(system))
        arms = [ArmReplay(motion, held.enter_context(Watch(system, motion.arm)),
                          held.enter_context(Remote(system, motion.arm))) for motion in motions]
        whole = begin(system)  # the moves to the first setpoints and the streams are one command
        goals = {arm.motion.arm: arm.motion.at(stamps, arm.motion.setpoint) for arm in arms}
        then = {arm.motion.arm: arm.motion.at(stamps, arm.motion.measured) for arm in arms}
        jaws = {arm.motion.arm: arm.motion.at(stamps, arm.motion.jaw)[:, 0] for arm in arms
                if arm.motion.jaw is not None and _ready(arm)}
        for arm in arms:
            _ready(arm)
            arm.remote.on_behalf(whole)
            jaw = jaws.get(arm.motion.arm)
            approach(arm.remote, goals[arm.motion.arm][0], None if jaw is None else float(jaw[0]))
        for arm in arms:
            arm.follower = Follower(arm.watch, arm.remote, arm.motion.arm in jaws, time)
        _follow(arms, goals, jaws, then, count, speed, time, say)
        return [arm.result() for arm in arms]


def _ready(arm: ArmReplay) -> bool:
    """Whether it has a jaw to move; Problem where it is not homed, or another arm than the one recorded."""
    watch, name = arm.watch, arm.motion.arm
    if not watch.look() or watch.state != "ENABLED" or not watch.homed:
        raise Problem(f"{name} is not homed; first: trocar home {name}")
    if watch.count != arm.motion.setpoint.shape[1]:
        raise Problem(f"{name} has {watch.count} joints, recorded are {arm.motion.setpoint.shape[1]}")
    return watch.flag("has_jaw")


def _follow(arms: Sequence[ArmReplay], goals: dict[str, Array], jaws: dict[str, Array], then: dict[str, Array],
            count: int, speed: float, time: SystemTime, say: Say) -> None:
    velocity = {name: np.gradient(values, 1.0 / RATE_HZ, axis=0) for name, values in goals.items()}
    followers = [(arm, arm.motion.arm, arm.follower) for arm in arms if arm.follower is not None]
    try:
        for k in beats(RATE_HZ, count, [0], MAX_GAP_S, time):
            for arm, name, follower in followers:
                follower.collect()
                if arm.watch.look() and arm.watch.flag("valid"):
                    arm.compare(then[name][k])
                follower.send(goals[name][k], velocity[name][k], float(jaws[name][k]) if name in jaws else None)
            if k % SHOWN_EVERY == 0:
                say(f"{k / RATE_HZ * speed:.1f} s", k / count)
        for _, _, follower in followers:
            follower.collect()
    except HeldUp as error:
        raise Problem(f"this program was {error}: the replay has ended and the arms hold") from None
    finally:
        for _, _, follower in followers:
            follower.hold()


def moves_of(recording: RecordingReader, arms: Sequence[str], part: Stretch) -> list[RecordedCommand]:
    """What persons asked arms for in `part`, but for streams and changes of state; Problem: nothing."""
    found = [each for each in commands_of(recording) if each.instance in arms and not each.streams
             and each.name != "state_command" and each.outcome != "refused"
             and part.begin_ns <= each.instant_ns < part.end_ns]
    if not found:
        raise Problem(f"nobody asked {', '.join(arms)} for a motion in this part of {recording.path.name}")
    return found


def send_again(system: str, commands: Sequence[RecordedCommand], starts: Sequence[RecordedMotion], speed: float,
               say: Say) -> list[dict[str, Any]]:
    """Ask for the same, with the times between them; what became of each. Problem when an arm faults or refuses."""
    results: list[dict[str, Any]] = []
    with contextlib.ExitStack() as held:
        time, whole = held.enter_context(SystemTime(system)), begin(system)
        arms = {motion.arm: ArmReplay(motion, held.enter_context(Watch(system, motion.arm)),
                                      held.enter_context(Remote(system, motion.arm))) for motion in starts}
        for arm in arms.values():
            _ready(arm)
            arm.remote.on_behalf(whole)
            approach(arm.remote, arm.motion.setpoint[0], None)
        start_ns, first_ns = time.now_ns(), min(int(motion.stamp_ns[0]) for motion in starts)
        for done, command in enumerate(commands):
            say(f"{command.instance} {command.name}", done / len(commands))
            time.pause_until(start_ns + round((command.instant_ns - first_ns) / speed))
            for name, arm in arms.items():
                if arm.watch.look() and arm.watch.state != "ENABLED":
                    raise Problem(f"{name} went to {arm.watch.state}: {arm.watch.last_error() or 'it did not say why'}")
            reply = arms[command.instance].remote.ask(command.name, command.values, command.text, REPLY_S)
            results.append({"arm": command.instance, "command": command.name, "values": list(command.values),
                            "text": command.text, "outcome": reply.outcome, "reply": reply.text})
    return results
