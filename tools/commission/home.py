"""Stage `home`: every arm goes to its home position, its encoders set from its potentiometers."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.tables.bring_up import HOMED
from trocar.tools.client.bring_up import bring_all
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window
from trocar.tools.output.errors import Problem

LOOK_S: Final = 1.0
MASTER: Final = "MTM"


def run(bench: RunningBench) -> Outcome:
    """One arm after the other."""
    outcome = Outcome()
    for subject in (each for each in bench.subjects if each.arm):
        motion = ("drives its roll to the lower stop, then moves all joints to zero" if subject.kind == MASTER else
                  "stays where it is, or moves all joints to zero if its arm file has homing_zero_position")
        bench.person.confirm(f"{subject.whole()} is powered and {motion}. Hands off the arm, workspace clear, no "
                             "instrument, hand on the emergency stop.", subject.name)
        try:
            begin_ns = bench.time.now_ns()
            found = homed(bench, subject)
            outcome.figures[subject.name] = {"homed_s": (bench.time.now_ns() - begin_ns) * 1e-9}
            if not found:
                window = bench.sample(subject.io, LOOK_S)
                outcome.figures[subject.name]["pot_error"] = _apart(window, subject).tolist()
                found = judge(window, subject)
        finally:
            bench.disable(subject)
        if outcome.add(found):
            break
    return outcome


def homed(bench: RunningBench, subject: Subject) -> list[Finding]:
    """Home an arm; returns the problem if it does not get there."""
    try:
        bring_all(bench.system, [subject.arm], HOMED)
    except Problem as problem:
        return [Finding(subject.whole(), str(problem), "homed", "docs/errors.md has cause and remedy; fix it, then "
                        "repeat this stage")]
    return []


def _apart(window: Window, subject: Subject) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Potentiometers less encoders (n,)."""
    apart: np.ndarray[tuple[int], np.dtype[np.float64]] = (
        window.axes("pot_position", subject) - window.axes("position", subject)).mean(axis=0)
    return apart


def judge(window: Window, subject: Subject) -> list[Finding]:
    """At home sensors agree, and checks and limits are on."""
    found, apart = [], _apart(window, subject)
    for axis, row in enumerate(subject.robot.tolerances):
        if subject.has_pot(axis) and row.distance > 0.0 and not abs(apart[axis]) <= row.distance:
            found.append(Finding(subject.where(axis), f"its potentiometer is {apart[axis]:+.4f} {subject.unit(axis)} "
                                 "off its encoder at home", f"{row.distance:g} {subject.unit(axis)}",
                                 "calibrate its potentiometer (stage calibrate)"))
    checks = [("limits_enforced", "position limits")]
    if subject.kind != MASTER:  # a hand moves it off its setpoint
        checks.append(("tracking_check", "the check of tracking errors"))
    for field, what in checks:
        if not window.flags(field, subject)[-1]:
            found.append(Finding(subject.whole(), f"{what}: off", "on", "report this: a homed arm has them on"))
    return found
