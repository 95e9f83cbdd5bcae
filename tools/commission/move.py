"""Stage `move`: each joint a little way at a tenth of its speed; it follows, arrives, and stays within its limits."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from typing import Final, TypeVar

import numpy as np

from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.arm import Arm
from trocar.tools.client.shared import SharedWays
from trocar.tools.commission import home
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats, Window
from trocar.tools.inspect.watch import Watch, arm_document
from trocar.tools.output.errors import Clipped, Problem, Refused, Short

T = TypeVar("T")

RATIO: Final = 0.1  # of the usual speed
WAY_RAD, WAY_M = 0.1, 0.01
ARRIVES_RAD, ARRIVES_M = 0.02, 0.002
TRACKING: Final = 0.3  # of the error that trips
BEYOND_RAD, BEYOND_M = 0.05, 0.005  # past a limit, in the command
SETTLE_S, TIMEOUT_S, LOOK_S = 0.5, 120.0, 0.1
PATIENCE_S: Final = 1.0  # with a value that is not valid


def run(bench: RunningBench) -> Outcome:
    """One arm after the other."""
    outcome = Outcome()
    for subject in (each for each in bench.subjects if each.arm):
        bench.person.confirm(
            f"{subject.whole()} is homed, moves each joint by up to {np.degrees(WAY_RAD):.0f}° or {WAY_M * 1e3:.0f} mm "
            f"and back at {100 * RATIO:g} % of its speed, and one joint to its nearest limit. Hand on the emergency "
            "stop.", subject.name)
        try:
            if outcome.add(home.homed(bench, subject)) or outcome.add(_watched(bench, subject, outcome)):
                break
        finally:
            bench.disable(subject)
    return outcome


def _watched(bench: RunningBench, subject: Subject, outcome: Outcome) -> list[Finding]:
    """Move; a failure includes the arm's message."""
    with Watch(bench.system, subject.arm) as watch, warnings.catch_warnings():
        warnings.simplefilter("ignore", Short)  # arrival is checked here
        try:
            return _moved(bench, subject, outcome)
        except (Problem, TimeoutError) as problem:
            why = watch.last_error()
            return [Finding(subject.whole(), f"{problem}{f' ({why})' if why else ''}", "it moves",
                            "docs/errors.md has cause and remedy; fix it, then repeat this stage")]


def _moved(bench: RunningBench, subject: Subject, outcome: Outcome) -> list[Finding]:
    arm = Arm(SharedWays(bench.system), subject.arm)
    ratio = arm.trajectory_j_get_ratio() or 1.0
    try:
        arm.trajectory_j_set_ratio(RATIO)
        start = steady(arm.setpoint_jp)
        low, high, slides = limits(bench, subject, len(start))
        figures = outcome.figures.setdefault(subject.name, {})
        worst = np.zeros(len(subject.robot.actuators))
        names = steady(lambda: (arm.joint_names(), 0))
        for joint, name in enumerate(names[: len(start)]):
            goal = start.copy()
            way = WAY_M if slides[joint] else WAY_RAD
            up = start[joint] + way <= high[joint]
            goal[joint] = float(np.clip(start[joint] + (way if up else -way), low[joint], high[joint]))
            for target in (goal, start):
                found, window = _went(bench, subject, arm, target, (name, names))
                worst = np.maximum(worst, np.abs(window.axes("position_error", subject)).max(axis=0))
                if found:
                    return found
        figures["tracking_error"] = worst.tolist()
        return _to_limit(bench, subject, arm, start, names, (low, high, slides))
    finally:
        end(arm, ratio)


def end(arm: Arm, ratio: float) -> None:
    """End a stage's motion, also one under way (Ctrl-C), and only then restore the ratio of speed: it acts at once."""
    with contextlib.suppress(Problem, TimeoutError):
        arm.hold()
        arm.trajectory_j_set_ratio(ratio)
    arm.close()


def limits(bench: RunningBench, subject: Subject, count: int) -> tuple[Floats, Floats, list[bool]]:
    """Lower and upper limits of `count` joints and which of them slide, from the files; discs have their encoders'."""
    document = arm_document(bench.system, subject.arm)
    tool = document.tool.links if document.tool is not None else ()
    links = [link for link in (*document.chain.links, *tool) if not link.passive][:count]
    rows = [(link.lower, link.upper, link.joint_type == "prismatic") for link in links]
    rows += [(*subject.range_of(axis), subject.slides(axis)) for axis in range(len(rows), count)]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), [row[2] for row in rows]


def steady(read: Callable[[], tuple[T, int]]) -> T:
    """A value that may not be valid for a moment, as after a bad sample; TimeoutError when it stays so."""
    end = monotonic_ns() + round(PATIENCE_S * 1e9)
    while True:
        try:
            return read()[0]
        except TimeoutError:
            if monotonic_ns() >= end:
                raise
            pause(0.01)


def _went(bench: RunningBench, subject: Subject, arm: Arm, goal: Floats,
          called: tuple[str, list[str]]) -> tuple[list[Finding], Window]:
    """Go to a pose and check the motion; `called`: the name of the moving joint, and all of them."""
    name, names = called
    parts = [bench.sample(subject.io, LOOK_S)]
    try:
        handle = arm.move_jp(goal)
        while handle.is_busy():
            parts.append(bench.sample(subject.io, LOOK_S))
            if parts[-1].stamp_s[-1] - parts[0].stamp_s[0] > TIMEOUT_S:
                raise Refused(f"{name} did not arrive within {TIMEOUT_S:g} s")
    except Refused as refusal:
        return [Finding(subject.whole(), f"moving {name}: {refusal}", "it arrives",
                        "docs/errors.md has cause and remedy")], Window.joined(parts)
    bench.sample(subject.io, SETTLE_S)
    window = Window.joined(parts)
    measured = steady(arm.measured_jp)
    return judge_tracking(window, subject) + judge_arrival(subject, goal, measured, names), window


def judge_tracking(window: Window, subject: Subject) -> list[Finding]:
    """Tracking errors of the actuators during the motion."""
    errors = np.abs(window.axes("position_error", subject)).max(axis=0)
    return [Finding(subject.where(axis), f"tracking error {errors[axis]:.4f} {subject.unit(axis)} in a slow move",
                    f"{TRACKING * tolerance:.4f} {subject.unit(axis)}",
                    "is there friction, or are gains or scales (effort_to_current) wrong? trocar pid show")
            for axis, tolerance in enumerate(subject.tolerance)
            if tolerance > 0.0 and not errors[axis] <= TRACKING * tolerance]


def judge_arrival(subject: Subject, goal: Floats, measured: Floats, names: list[str]) -> list[Finding]:
    """Whether every joint is at its goal."""
    found = []
    for joint, name in enumerate(names[: len(goal)]):
        slides = joint < len(subject.robot.actuators) and subject.slides(joint)
        near, unit = (ARRIVES_M, "m") if slides else (ARRIVES_RAD, "rad")
        near += subject.deadband[joint] if joint < len(subject.deadband) else 0.0
        if not abs(measured[joint] - goal[joint]) <= near:
            found.append(Finding(f"{subject.name} {name}", f"{measured[joint]:.4f} {unit} instead of "
                                 f"{goal[joint]:.4f}", f"{near:g} {unit} off at most",
                                 "is there an obstacle? Else its gains are too low: trocar pid show"))
    return found


def _to_limit(bench: RunningBench, subject: Subject, arm: Arm, start: Floats, names: list[str],
              known: tuple[Floats, Floats, list[bool]]) -> list[Finding]:
    """Command a goal beyond a limit of the joint nearest to one: it must stay at the limit."""
    low, high, slides = known
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.minimum(high - start, start - low) / (high - low)
    room[~np.isfinite(room)] = np.inf
    joint = int(np.argmin(room))
    up = bool(high[joint] - start[joint] <= start[joint] - low[joint])
    limit, beyond = (high if up else low)[joint], BEYOND_M if slides[joint] else BEYOND_RAD
    goal = start.copy()
    goal[joint] = limit + (beyond if up else -beyond)
    with contextlib.suppress(Refused), warnings.catch_warnings():  # to refuse it is as good, to clip it is meant
        warnings.simplefilter("ignore", Clipped)
        handle = arm.move_jp(goal)
        while handle.is_busy():
            bench.sample(subject.io, LOOK_S)
    measured = steady(arm.measured_jp)
    past = (measured[joint] - limit) * (1.0 if up else -1.0)
    found = judge_limit(f"{subject.name} {names[joint]}", past, limit, slides[joint])
    arm.move_jp(start).wait(TIMEOUT_S)
    return found


def judge_limit(where: str, past: float, limit: float, slides: bool) -> list[Finding]:
    """`past`: distance of a joint beyond its limit."""
    near, unit = (ARRIVES_M, "m") if slides else (ARRIVES_RAD, "rad")
    if past <= near:
        return []
    return [Finding(where, f"{past:.4f} {unit} beyond its limit", f"{limit:.4f} {unit}",
                    "report this, and do not use this arm")]
