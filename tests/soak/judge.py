"""Whether the robots did more than what persons asked for: the rules of docs/safety.md, on the boards' own truth.

What a person asked for is written down by whoever plays the person, when it was asked and when it was over. Of all that
was asked of a robot within LAG_NS before a moment the fastest counts: a joint that follows comes a bit later.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.soak.motion import MIN_LEVER_M, Motion, MotionTruth, Truth

Array = NDArray[np.float64]

MORE = 1.2
SLACK_M_S = 0.005
SLACK_RAD_S = SLACK_M_S / MIN_LEVER_M
WRIST_M = 0.01  # a tip that turns on the spot swings its wrist so far behind it; what lags there shows at the tip
LAG_NS = 250_000_000
APART_NS = 300_000_000  # what goes on after pauses shorter than this is one violation


@dataclass(frozen=True, slots=True)
class Ask:
    """Motion of a robot that a person asked for, from `begin_ns` until `end_ns`; nothing was asked: it stands.

    `joints`: how fast each may go, rad/s or m/s. Or `leader`: its tip follows that robot's, `scale` times as fast and
    turning as fast. Or `tip`: so fast and turning so fast, m/s and rad/s.
    `exact`: a limit of its own, without the slack of motion that is asked for.
    """

    robot: str
    mode: str
    begin_ns: int
    end_ns: int
    joints: tuple[float, ...] = ()
    leader: str = ""
    scale: float = 0.0
    tip: tuple[float, ...] = ()
    exact: bool = False


@dataclass(frozen=True, slots=True)
class Command:
    """A command by a person that may power a robot."""

    robot: str
    stamp_ns: int
    words: str


@dataclass(frozen=True, slots=True)
class Loss:
    """From now on what was commanded before counts for nothing: a fault, an emergency stop, a restart of io."""

    robot: str
    stamp_ns: int
    words: str


@dataclass(frozen=True, slots=True)
class Violation:
    """Too fast, or power without a person: m/s (rad/s of an angle), or s since the last command."""

    robot: str
    stamp_ns: int
    mode: str
    value: float
    limit: float
    what: str


def too_fast(motion: Motion, asks: Iterable[Ask], motions: Sequence[Motion] = ()) -> list[Violation]:
    """Where a robot went faster than asked while its amplifiers were on. `motions` are those of robots that lead."""
    stamps = motion.stamp_ns
    joints = np.zeros_like(motion.speed)
    exact = np.zeros(len(stamps), dtype=np.bool_)
    linear, angular = np.zeros(len(stamps)), np.zeros(len(stamps))
    leads = np.zeros(len(stamps), dtype=np.bool_)
    mode = np.full(len(stamps), "hold", dtype=object)
    for ask in asks:
        if ask.robot != motion.robot:
            continue
        during = (stamps >= ask.begin_ns) & (stamps <= ask.end_ns + LAG_NS)
        mode[during] = ask.mode
        if ask.leader:
            leader = next(each for each in motions if each.robot == ask.leader)
            leads |= during
            for allowed, speed in ((linear, ask.scale * leader.linear), (angular, leader.angular)):
                allowed[during] = np.maximum(allowed[during], _recent(leader.stamp_ns, speed, stamps[during]))
        elif ask.tip:
            leads |= during
            linear[during] = np.maximum(linear[during], ask.tip[0])
            angular[during] = np.maximum(angular[during], ask.tip[1])
        else:
            exact[during] = ask.exact
            joints[during] = np.maximum(joints[during], np.array(ask.joints))
    slack = np.where(exact, 0.0, SLACK_M_S)
    by_joint = motion.speed * motion.lever
    most = MORE * joints * motion.lever + slack[:, None]
    over = np.where(leads[:, None], -np.inf, by_joint - most)
    worst = over.argmax(axis=1)
    rows = np.arange(len(stamps))
    found = _grouped(motion, mode, (over.max(axis=1) > 0.0) & motion.powered, by_joint[rows, worst], most[rows, worst],
                     [f"joint {i} at the tip, m/s" for i in worst])
    # whose tip is led: of what its joints were asked for besides, all may add up
    most_linear = MORE * (linear + WRIST_M * angular + (joints * motion.lever).sum(axis=1)) + SLACK_M_S
    most_angular = MORE * (angular + joints[:, :].sum(axis=1)) + SLACK_RAD_S
    for value, limit, what in ((motion.linear, most_linear, "tip, m/s"), (motion.angular, most_angular, "tip, rad/s")):
        found += _grouped(motion, mode, leads & motion.powered & (value > limit), value, limit, [what] * len(stamps))
    return sorted(found, key=lambda violation: violation.stamp_ns)


def _recent(stamps: NDArray[np.int64], values: Array, at: NDArray[np.int64]) -> Array:
    """The largest value of the LAG_NS before each moment; 0 where there is none."""
    first, last = np.searchsorted(stamps, at - LAG_NS), np.searchsorted(stamps, at, side="right")
    return np.array([values[a:b].max(initial=0.0) for a, b in zip(first, last, strict=True)])


def _grouped(motion: Motion, mode: NDArray[np.object_], over: NDArray[np.bool_], value: Array, limit: Array,
             what: Sequence[str]) -> list[Violation]:
    """The worst of each stretch of moments that are over the limit."""
    places = np.flatnonzero(over)
    if not len(places):
        return []
    cuts = np.flatnonzero(np.diff(motion.stamp_ns[places]) > APART_NS) + 1
    found = []
    for stretch in np.split(places, cuts):
        k = stretch[np.argmax(value[stretch] - limit[stretch])]
        found.append(Violation(motion.robot, int(motion.stamp_ns[stretch[0]]), str(mode[k]), float(value[k]),
                               float(limit[k]), f"{what[k]}, {len(stretch)} windows"))
    return found


def powered_by_nobody(robot: MotionTruth, truth: Truth, commands: Iterable[Command], losses: Iterable[Loss]
                      ) -> list[Violation]:
    """Amplifiers that came on without a person's command given after the robot last lost power or had a fault."""
    given = [command for command in commands if command.robot == robot.name]
    stamps, up = truth["stamp_ns"], robot.up(truth)
    lost = [loss.stamp_ns for loss in losses if loss.robot == robot.name]
    began = np.diff(truth["epoch"], prepend=truth["epoch"][:1]) != 0
    lost += [int(stamp) for stamp in stamps[began]]
    lost += [int(stamp) for stamp in stamps[1:][up[:-1] & ~up[1:]]]
    found = []
    for at in np.flatnonzero(robot.switched_on(truth)):
        on_ns = int(stamps[at])
        since = max((ns for ns in lost if ns < on_ns), default=0)
        last = max((command for command in given if command.stamp_ns < on_ns), key=lambda c: c.stamp_ns, default=None)
        if last is None or last.stamp_ns < since:
            ago_s = (on_ns - last.stamp_ns) * 1e-9 if last is not None else float("inf")
            words = last.words if last is not None else "none"
            found.append(Violation(robot.name, on_ns, "unpowered", ago_s, (on_ns - since) * 1e-9,
                                   f"an amplifier came on; s since the last command ({words}), since the loss"))
    return found
