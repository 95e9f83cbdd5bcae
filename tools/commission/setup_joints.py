"""Stage `setup_joints`: potentiometers of Classic setup joints, from poses whose joints the person has measured.

As in the original, two poses far apart give scale and offset of each potentiometer: scale = (P1 - P2) / (V1 - V2),
offset = P1 - scale · V1. A third one in between, in which each joint is at another share of its way, must agree with
them: a mistyped value, slack and swapped plugs do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.document.cart import Cart
from trocar.procs.kinematics.forward import Kinematics
from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Settle
from trocar.tools.commission.picture import TOP, frames_at, picture
from trocar.tools.commission.setup_judge import (
    FEWEST,
    MeasuredPose,
    SetupSubject,
    judge_poses,
    judge_pots,
    judge_rest,
    lines,
)
from trocar.tools.commission.subject import SETUP_JOINTS, setup_subject
from trocar.tools.commission.window import Floats
from trocar.tools.output.errors import Problem

ROUNDS: Final = 2  # of readings, whole ones at rest
LOOK_S: Final = 0.1
SILENT_S: Final = 8.0  # a round takes 1.1 s
ABOUT_DEG: Final = ((-90.0, 90.0), (-90.0, 90.0), (-90.0, 90.0), (-135.0, 135.0), (-135.0, 135.0))
"""Of joints 2 to 6, for the first and the second pose."""
OTHERS_DEG: Final = {("PSM1", 2): (-135.0, 0.0), ("PSM2", 2): (0.0, 135.0), ("ECM", 3): (90.0, 270.0)}
HEIGHTS_M: Final = (0.15, 0.45)
SHARES: Final = np.linspace(0.38, 0.62, SETUP_JOINTS)
"""Of the way from the first to the second pose: about where the third one has each joint."""
WORDS: Final = ("first", "second", "third")


@dataclass(slots=True)
class _Rest:
    """Mean and spread (setup arms, 2, joints) of voltages at rest."""

    volts: Floats
    spread: Floats


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """Each arm of each cart, until the first problem; arms that have passed before it get their values written."""
    outcome = Outcome()
    for cart in bench.carts:
        io_file.require_place(Path(cart.source), folder, write=write)  # first: it must not cost the person's work
        bench.person.confirm(_dangers(bench, cart), cart.name)
        values: dict[str, dict[io_file.Place, float]] = {}
        try:
            _measure(bench, cart, outcome, values)
        except (Problem, TimeoutError) as problem:
            outcome.add([Finding(cart.name, str(problem), "", "docs/errors.md has causes and remedies")])
        if values:
            io_file.save_all(bench, outcome, {cart.source: values}, folder, write=write, part="arms")
        if outcome.problems:
            outcome.notes.append(f"{cart.name}: new values of {', '.join(values) or 'no arm'}; when you repeat this "
                                 "stage with the new file, leave out the arms that have them")
            break
    if not bench.carts:
        outcome.notes.append("no Classic setup joints")
    return outcome


def _dangers(bench: RunningBench, cart: Cart) -> str:
    lifting = ", ".join(arm.name for arm in cart.arms if arm.lifts)
    return (f"{cart.name} is powered. While its clutch is pressed, a setup arm has no brakes"
            f"{f', and {lifting} can sink' if lifting else ''}: one person holds it with both hands before the other "
            "presses the clutch, with the emergency stop within reach. Use the keyboard only while all clutches are "
            "released. "
            + (f"The buttons motor_up and motor_down move the column of {lifting} at once, at 2 cm/s: hands off it. No "
               "stage has tested what stops this motor: mains switch within reach. " if lifting else "")
            + ("The system is in calibration mode: any program may set the outputs of brakes and column. "
               if bench.document.io(cart.io).calibration_mode else "")
            + "Remove instruments and endoscope.")


def _measure(bench: RunningBench, cart: Cart, outcome: Outcome,
             values: dict[str, dict[io_file.Place, float]]) -> None:
    """Put new values into `values`, by arm, as soon as an arm has passed."""
    kinds, robot = io_file.texts_of(cart.source, "arms", "type"), setup_subject(bench.document, cart)
    try:
        bench.enable(robot)
        for place, row in enumerate(cart.arms):
            arm = SetupSubject(cart, place, FEWEST if kinds.get(row.name) == "ECM" else SETUP_JOINTS)
            if not bench.person.agrees(f"{arm.name}: measure its joints now? (n: leave out)"):
                outcome.notes.append(f"{arm.name}: left out, its potentiometers are those of its file")
                continue
            poses, found = _measured(bench, arm)
            if outcome.add(found or judge_poses(poses, arm) or judge_pots(poses, arm)):
                break
            fitted = lines(poses, arm)
            outcome.figures[arm.name] = {
                "position": [pose.position.tolist() for pose in poses],
                "volts": [pose.volts[place].tolist() for pose in poses], "lines": fitted.tolist(),
                "was": [list(row.primary), list(row.secondary)]}
            values[row.name] = {
                (f"{pots}_{what}", joint): float(fitted[which, joint, part])
                for which, pots in enumerate(("primary", "secondary")) for joint in range(arm.joints)
                for part, what in enumerate(("scales", "offsets"))}
    finally:
        bench.disable(robot)


def _measured(bench: RunningBench, arm: SetupSubject) -> tuple[list[MeasuredPose], list[Finding]]:
    """The three poses; or the problem at which it ended."""
    poses: list[MeasuredPose] = []
    for number, word in enumerate(WORDS):
        goal = about(arm, poses)
        act = Settle(arm.cart.robot, arm.row.name, f"SUJ_clutch_{arm.row.plug}", tuple(goal))
        with bench.showing(arm.name, goal.tolist()):
            _draw(bench, arm, goal)
            for _ in bench.person.doing(act, _request(arm, number, goal)):
                bench.wait(LOOK_S)
                readings = bench.setup_readings(arm.cart)
                bench.person.show(f"{arm.name}: {'clutched' if readings.clutched[arm.place] else 'brakes hold'}, V: "
                                  + " ".join(f"{value:.2f}" for value in readings.volts[arm.place, 0, :arm.joints]))
            before = _at_rest(bench, arm, 2, ROUNDS)  # one is of before, in the next the arm may have come to rest
            if found := judge_rest(before.spread, arm):
                return poses, found
            typed = bench.person.measured(f"{arm.name}, {word} pose: joint 1 in mm, joints 2 to {arm.joints} in "
                                          "degrees, counter-clockwise positive", act)
            after = _at_rest(bench, arm, 1, 1)
        if found := judge_rest(after.volts - before.volts, arm, moved=True):
            return poses, found
        poses.append(MeasuredPose(np.array(typed), 0.5 * (before.volts + after.volts)))
    return poses, []


def about(arm: SetupSubject, poses: Sequence[MeasuredPose]) -> Floats:
    """About where the next pose should be, m and rad."""
    if len(poses) == len(WORDS) - 1:
        first, second = (pose.position for pose in poses)
        found: Floats = first + SHARES[:arm.joints] * (second - first)
        return found
    ends = [HEIGHTS_M, *np.radians([OTHERS_DEG.get((arm.row.name, joint), range_deg)
                                    for joint, range_deg in enumerate(ABOUT_DEG, start=1)])]
    return np.array([row[len(poses)] for row in ends[:arm.joints]])


def _request(arm: SetupSubject, number: int, goal: Floats) -> str:
    where = ", ".join(f"joint {joint + 1} {arm.shown(joint, value)}" for joint, value in enumerate(goal))
    what = ("This pose and the next one should have each joint as far apart as it can be measured.", "",
            "Come from the second pose; each joint must be at another share of its way.")[number]
    lift = (" Its joint 1 is moved by a motor, with the buttons motor_up and motor_down: only with its clutch released "
            "and all hands off the column." if arm.row.lifts else "")
    return (f"Bring setup arm {arm.name} to the {WORDS[number]} pose, about {where}. {what}{lift} Release its clutch: "
            "it must not move until its joints are typed.")


def _draw(bench: RunningBench, arm: SetupSubject, goal: Floats) -> None:
    if arm.row.chain is None or arm.row.world is None:
        return
    kinematics = Kinematics(arm.row.chain)
    q = np.zeros(kinematics.n)
    q[:len(goal)] = goal
    bench.person.report(picture(frames_at(kinematics, q) @ np.array(arm.row.world)[:3, :3].T, TOP))


def _at_rest(bench: RunningBench, arm: SetupSubject, skipped: int, rounds: int) -> _Rest:
    """So many whole rounds of readings with its clutch released, after some; Problem if there are none."""
    rows: list[Floats] = []
    last = -1
    end = bench.time.now_ns() + round(SILENT_S * 1e9)
    while len(rows) < skipped + 1 + rounds:
        readings = bench.setup_readings(arm.cart)
        if readings.clutched[arm.place]:
            rows = []
        elif readings.rounds != last:
            end = bench.time.now_ns() + round(SILENT_S * 1e9)
            rows.append(readings.volts)
        last = readings.rounds
        if bench.time.now_ns() > end:
            raise Problem(f"{arm.name}: no readings of its potentiometers at rest; is its clutch still pressed? "
                          "(trocar logs)")
        bench.wait(0.5 * LOOK_S)
    found = np.array(rows[-rounds:])
    return _Rest(found.mean(axis=0), np.ptp(found, axis=0))

