"""Whether the robots did more than what persons asked for: the rules of docs/safety.md, on the boards' own truth.

What a person asked for is written down by whoever plays the person, when it was asked and when it was over. Of all that
was asked of a robot within LAG_NS before a moment the fastest counts: a joint that follows comes a bit later.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.soak.motion import MIN_LEVER_M, Flags, Motion, MotionTruth, SetpointTrace, Truth
from trocar.procs.tables.codes import TRACKING

Array = NDArray[np.float64]

MORE = 1.2
MORE_UNGUARDED, UNGUARDED_NS = 1.5, 80_000_000  # until io holds, 30 ms after the arm's last record
SLACK_M_S = 0.005
SLACK_RAD_S = SLACK_M_S / MIN_LEVER_M
WRIST_M = 0.01  # a tip that turns on the spot swings its wrist so far behind it; what lags there shows at the tip
LAG_NS = 250_000_000
APART_NS = 300_000_000  # what goes on after pauses shorter than this is one violation
SPARE_S = 0.01  # a cycle of the arm and one of io, which read late what was written early
STILL = 2e-3, 2e-4  # rad, m: what a setpoint may creep by after a stop
BLAME_NS = 1_000_000_000  # power that is lost so long after wrong numbers was lost by them


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
class Intervention:
    """Something that was done to a robot: another program's stop or wrong numbers, a lift that begins."""

    robot: str
    stamp_ns: int
    words: str


@dataclass(frozen=True, slots=True)
class LiftEnd:
    """From now on nothing lifts any more, whatever was asked before, after `in_s` at the latest."""

    stamp_ns: int
    in_s: float
    words: str


@dataclass(frozen=True, slots=True)
class Attempt:
    """What a client asked for that has to be refused, because it may not power anything or because another one streams,
    and how that ended; `outcome` "": there was no answer.
    """

    robot: str
    stamp_ns: int
    words: str
    outcome: str


@dataclass(frozen=True, slots=True)
class Violation:
    """Too fast, or power without a person: m/s (rad/s of an angle), or s since the last command."""

    robot: str
    stamp_ns: int
    mode: str
    value: float
    limit: float
    what: str


def too_fast(motion: Motion, asks: Iterable[Ask], motions: Sequence[Motion] = (),
             deaths: Iterable[Intervention] = ()) -> list[Violation]:
    """Where a robot went faster than asked while its amplifiers were on.

    `motions` are those of robots that lead. At `deaths` the arm's process was killed or stopped: until io holds, its
    last efforts act, and nothing keeps a joint below its limit.
    """
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
    unguarded = np.zeros(len(stamps), dtype=np.bool_)
    for death in deaths:
        unguarded |= (stamps >= death.stamp_ns) & (stamps <= death.stamp_ns + UNGUARDED_NS)
    more = np.where(exact & unguarded, MORE_UNGUARDED, MORE)
    most = more[:, None] * joints * motion.lever + slack[:, None]
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


def beyond_bounds(setpoints: SetpointTrace, speed: Array) -> list[Violation]:
    """Joint setpoints that moved faster than `speed` (n,) allows in the time between two records."""
    step = np.abs(np.diff(setpoints.position, axis=0))
    most = speed * (np.diff(setpoints.stamp_ns) * 1e-9 + SPARE_S)[:, None]
    both = setpoints.follows[1:] & setpoints.follows[:-1] & (np.diff(setpoints.run) == 0)
    over = np.where(both[:, None], step - most, -np.inf)
    worst = over.argmax(axis=1)
    rows = np.flatnonzero(over.max(axis=1, initial=-np.inf) > 0.0)
    return [Violation(setpoints.robot, int(setpoints.stamp_ns[k + 1]), "setpoint", float(step[k, worst[k]]),
                      float(most[k, worst[k]]), f"rad or m of joint {worst[k]} between two records of {setpoints.who}")
            for k in rows]


def continued(setpoints: SetpointTrace, stops: Iterable[Intervention], asks: Sequence[Ask]) -> list[Violation]:
    """SetpointTrace that move, and efforts that begin, between another program's stop and what is asked for next."""
    still = np.where(setpoints.is_prismatic, STILL[1], STILL[0])
    found = []
    for stop in stops:
        if stop.robot != setpoints.robot:
            continue
        end_ns = min((ask.begin_ns for ask in asks if ask.robot == stop.robot and ask.begin_ns > stop.stamp_ns),
                     default=int(setpoints.stamp_ns[-1]) + 1 if len(setpoints.stamp_ns) else 0)
        first, last = np.searchsorted(setpoints.stamp_ns, (stop.stamp_ns + LAG_NS, end_ns))
        rows = slice(first, max(first, last))
        for run in np.unique(setpoints.run[rows]):
            there = np.flatnonzero((setpoints.run[rows] == run) & setpoints.follows[rows]) + first
            if not len(there):
                continue
            way = np.abs(setpoints.position[there] - setpoints.position[there[0]])
            moved = np.flatnonzero((way > still).any(axis=1))
            if len(moved):
                k, joint = moved[0], int((way / still).max(axis=0).argmax())
                found.append(Violation(
                    stop.robot, int(setpoints.stamp_ns[there[k]]), "stopped", float(way[:, joint].max()),
                    float(still[joint]), f"rad or m of joint {joint} by {setpoints.who}'s record after {stop.words}"))
        limp = np.flatnonzero(setpoints.in_effort[rows]) + first
        if len(limp):
            found.append(Violation(stop.robot, int(setpoints.stamp_ns[limp[0]]), "stopped", len(limp), 0.0,
                                   f"records in effort mode after {stop.words}"))
    return found


def lost_by_numbers(robot: MotionTruth, truth: Truth, io: Truth, numbers: Iterable[Intervention],
                    others: Sequence[Intervention]) -> list[Violation]:
    """Power that went, or a tracking error that tripped, after a client's wrong numbers.

    `others`: all that was done to the system besides, or asked of the robot. Power that goes after that is not blamed
    on the numbers; a tracking error is.
    """
    up, stamps, place = robot.up(truth), truth["stamp_ns"], robot.place
    fell = stamps[1:][up[:-1] & ~up[1:]]
    tracking = io["fault"][:, place] == TRACKING.number
    tripped = io["stamp_ns"][1:][tracking[1:] & ~tracking[:-1]]
    found = []
    for mark in numbers:
        if mark.robot != robot.name:
            continue
        for stamp_ns, what, is_sure in (*((ns, "a tracking error", True) for ns in tripped),
                                        *((ns, "power was lost", False) for ns in fell)):
            since_ns = int(stamp_ns) - mark.stamp_ns
            if not 0 < since_ns <= BLAME_NS or (not is_sure and any(
                    mark.stamp_ns - BLAME_NS < each.stamp_ns <= stamp_ns for each in others)):
                continue
            found.append(Violation(robot.name, int(stamp_ns), "numbers", since_ns * 1e-9, 0.0, f"s after {mark.words}: "
                                   f"{what}"))
            break
    return found


def lifts_on(stamp_ns: NDArray[np.int64], lifting: Flags, begins: Iterable[Intervention], ends: Iterable[LiftEnd]
             ) -> list[Violation]:
    """A lift whose amplifier is still on, or on again, after what lifted it has ended; until somebody lifts again."""
    starts = sorted(mark.stamp_ns for mark in begins)
    found = []
    for end in ends:
        from_ns = end.stamp_ns + round(end.in_s * 1e9)
        until_ns = min((ns for ns in starts if ns > end.stamp_ns), default=int(stamp_ns.max(initial=0)) + 1)
        wrong = np.flatnonzero((stamp_ns > from_ns) & (stamp_ns < until_ns) & lifting)
        if len(wrong):
            found.append(Violation("lift", int(stamp_ns[wrong[0]]), "lifting",
                                   float(stamp_ns[wrong[-1]] - end.stamp_ns) * 1e-9, end.in_s, f"s after {end.words}"))
    return found


def obtained(attempts: Iterable[Attempt]) -> list[Violation]:
    """What was not refused though it has to be."""
    return [Violation(each.robot, each.stamp_ns, "not refused", 1.0, 0.0, f"{each.words} was {each.outcome}")
            for each in attempts if each.outcome in ("accepted", "done", "failed")]


def unprotected(robot: MotionTruth, truth: Truth, io: Truth, attempts: Iterable[Attempt], commands: Iterable[Command]
                ) -> list[Violation]:
    """Amplifiers that came on, and tracking checks that went, within a second of such an attempt."""
    on_ns = truth["stamp_ns"][robot.switched_on(truth)]
    checked, driven = io["tracking_check"][:, robot.place], io["pid_enabled"][:, robot.place]
    off_ns = io["stamp_ns"][1:][checked[:-1] & ~checked[1:] & driven[:-1] & driven[1:]]
    given = [command.stamp_ns for command in commands if command.robot == robot.name]
    found = []
    for each in attempts:
        for what, stamps in (("an amplifier came on", on_ns), ("its tracking check went", off_ns)):
            for ns in stamps[(stamps > each.stamp_ns) & (stamps <= each.stamp_ns + BLAME_NS)]:
                if not any(ns - 10 * BLAME_NS < stamp_ns < ns for stamp_ns in given):
                    found.append(Violation(robot.name, int(ns), "powerless", (int(ns) - each.stamp_ns) * 1e-9, 0.0,
                                           f"s after {each.words}: {what}"))
    return found
