"""Stage `brakes`: the currents that release each brake and keep it released, into an IO file; and that it holds.

A person moves the axis gently, back and forth. The brake's current rises from none until the axis moves, then falls
until it no longer does. The file gets more than each of the two, as every brake needs a little less or more each time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Rock
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window
from trocar.tools.output.errors import Problem

STEPS: Final = 50
"""From no current to the largest."""
HELD_LOOKS, FREE_LOOKS, STILL_LOOKS = 8, 8, 3
"""Looks without current; with the release current before it falls; without motion until a brake counts as engaged."""
SAMPLES, SAMPLE_S = 3, 0.1
"""Of a look: long enough that a hand moves in it, also at a reversal, and shorter than a command of io lasts."""
MOVED: Final = {"rad": 0.005, "m": 0.0005}
RELEASE_MARGIN, HOLD_MARGIN = 1.25, 1.5
ENOUGH: Final = 1.1
"""The largest current has to be this much above the one that releases."""
ENDED: Final = object()
FACTOR: Final = 2.5
"""Of the file's release current, up or down: more is another brake's."""


@dataclass(frozen=True, slots=True)
class BrakeCurrents:
    """Magnitudes, A: which let a brake go, and the smallest at which it stayed so; NaN: it never did."""

    lets_go: float
    holds_off: float
    slips: bool = False  # it moved without current


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """One arm after the other; changed files are written at the end, if no problem occurred."""
    outcome = Outcome()
    changes: dict[str, dict[str, dict[io_file.Place, float]]] = {}
    outcome.notes += [f"{cart.name}: the brakes of its setup arms are not tested here" for cart in bench.carts]
    braked = [each for each in bench.subjects if each.arm and each.robot.brakes]
    if not braked and not bench.carts:
        outcome.notes.append("no arm with brakes: nothing to measure")
    for subject in braked:
        bench.person.confirm(
            f"{subject.whole()}: its amplifiers are switched on, its motors have no current, and its brakes are "
            "released one by one. An axis whose brake is released can fall: one person holds the arm and moves it only "
            "gently, the other has a hand on the emergency stop.", subject.name)
        values, figures = changes.setdefault(subject.robot.source, {}).setdefault(subject.name, {}), {}
        with bench.person.supporting(subject):
            try:
                bench.enable(subject)
                for axis, brake in enumerate(subject.robot.brakes):
                    found = measured(_at(bench, subject, axis), brake.maximum_current)
                    bench.asked(subject.io, "brake_engage", (), subject.name, 2.0)
                    figures[subject.names[axis]] = {"lets_go_a": found.lets_go, "holds_off_a": found.holds_off}
                    if outcome.add(judge(found, subject, axis)):
                        return outcome
                    values |= written(found, subject, axis)
            finally:
                try:
                    bench.asked(subject.io, "brake_engage", (), subject.name, 2.0)
                finally:
                    bench.disable(subject)
        outcome.figures[subject.name] = figures
    return io_file.save_all(bench, outcome, changes, folder, write=write)


def _at(bench: RunningBench, subject: Subject, axis: int) -> Callable[[float], bool]:
    """Whether the axis moves, while a person moves it, with a magnitude of its brake's current."""
    brake = subject.robot.brakes[axis]
    sign = -1.0 if brake.release_current < 0.0 else 1.0
    work = bench.person.doing(Rock(subject, axis), f"Move {subject.title(axis)} gently back and forth, by a few "
                              "degrees or millimetres, all the time. It is held at first.")
    last: list[float] = []

    def moves(current: float) -> bool:
        answer, _ = bench.asked(subject.io, "brake_current", (float(axis), sign * current), subject.name, 2.0)
        if not answer.is_done:
            raise Problem(f"{subject.title(axis)}: io: {answer.text or answer.outcome}")
        parts = []
        for _ in range(SAMPLES):
            if next(work, ENDED) is ENDED:
                raise Problem(f"{subject.title(axis)}: ended by the person, or after too long; its brake holds")
            parts.append(bench.sample(subject.io, SAMPLE_S))
        window = Window.joined(parts)
        if not window.flags("powered", subject).all():
            raise Problem(f"{subject.whole()}: its power went off, its brakes hold; trocar logs has the cause")
        position = window.axes("position", subject)[:, axis]
        way = max([float(np.ptp(position)), *(abs(float(position.mean()) - one) for one in last)])
        last[:] = [float(position.mean())]
        is_free = way > MOVED[subject.unit(axis)]
        bench.person.show(f"{subject.title(axis)}: {current:.3f} A, {'moves' if is_free else 'held'}")
        return is_free

    return moves


def measured(moves: Callable[[float], bool], maximum: float) -> BrakeCurrents:
    """The currents of a brake, up to `maximum`, A."""
    if any([moves(0.0) for _ in range(HELD_LOOKS)][1:]):  # the first may still be the motion before
        return BrakeCurrents(float("nan"), float("nan"), slips=True)
    rising = np.linspace(0.0, maximum, STEPS + 1)[1:]
    lets_go = next((float(current) for current in rising if moves(current)), float("nan"))
    release = min(maximum, RELEASE_MARGIN * lets_go)
    if np.isnan(lets_go) or not all([moves(release) for _ in range(FREE_LOOKS)][1:]):
        return BrakeCurrents(lets_go, float("nan"))
    still, holds_off = 0, release
    for current in rising[rising < release][::-1]:
        if moves(current):
            still, holds_off = 0, float(current)
        elif (still := still + 1) >= STILL_LOOKS:
            break
    slips = any([moves(0.0) for _ in range(HELD_LOOKS)][1:])  # by now the person certainly moves it
    return BrakeCurrents(lets_go, holds_off, slips)


def written(found: BrakeCurrents, subject: Subject, axis: int) -> dict[io_file.Place, float]:
    """The values of the IO file for a brake, with its signs."""
    brake = subject.robot.brakes[axis]
    sign = -1.0 if brake.release_current < 0.0 else 1.0
    release = min(brake.maximum_current, RELEASE_MARGIN * found.lets_go)
    return {("brakes", axis, "release_current"): sign * release,
            ("brakes", axis, "released_current"): sign * min(release, HOLD_MARGIN * found.holds_off)}


def judge(found: BrakeCurrents, subject: Subject, axis: int) -> list[Finding]:
    """Problems of a brake."""
    where, brake = f"{subject.name} brake {axis} ({subject.names[axis]})", subject.robot.brakes[axis]
    most, was = brake.maximum_current, abs(brake.release_current)
    if found.slips:
        return [Finding(where, "its axis can be moved without current", "it holds",
                        "stop here: the arm may fall. Repair the brake, or is it the brake of another axis?")]
    if np.isnan(found.lets_go):
        return [Finding(where, f"its axis did not move with up to {most:g} A", "it is released",
                        "push a little harder; else its plug, the brake of another axis, or its supply (36 V)")]
    if not ENOUGH * found.lets_go <= most:
        return [Finding(where, f"it lets go at {found.lets_go:.3f} A", f"{most / ENOUGH:.3f} A, of {most:g} A at most",
                        "the brake is worn or dirty, or its supply too low (36 V)")]
    if not was / FACTOR <= found.lets_go <= was * FACTOR:
        return [Finding(where, f"it lets go at {found.lets_go:.3f} A, release_current in the file is {was:g} A",
                        f"within a factor of {FACTOR:g}", "are these the files of this arm, or plugs swapped?")]
    if not found.holds_off <= found.lets_go:  # also NaN
        return [Finding(where, "it does not stay released while the current falls", "from its release current on",
                        "move the axis all the time, and repeat this stage; else its contact is loose")]
    stays = abs(brake.released_current)
    if not HOLD_MARGIN * found.holds_off <= FACTOR * stays:
        return [Finding(where, f"it engages at {found.holds_off:.3f} A, released_current in the file is {stays:g} A",
                        f"up to {FACTOR * stays / HOLD_MARGIN:.3f} A, or the brake becomes hot",
                        "move the axis all the time, and repeat this stage")]
    return []
