"""Stage `depth`: the offset of a Classic PSM's insertion potentiometer, from the wrist held at the remote centre.

The wrist's first axis is at the remote centre at a known insertion, that of the kinematic file less the length of an
8 mm instrument's shaft. The person brings it there by hand, at the mark of a slotted or absent cannula, several times.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.document.arms import ArmConfig
from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.calibrate import held
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Put
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats

INSERTION: Final = 2
SHAFT_M: Final = 0.4162
"""From the discs of an 8 mm Classic instrument to its wrist's first axis."""
TIMES: Final = 3
AWAY_M: Final = 0.03
"""Between two times, the instrument goes deeper by this."""
SPREAD_M, MAX_CHANGE_M = 0.001, 0.02
WAY_WITHIN: Final = 0.1
"""Potentiometer against encoder on the way in between."""


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """One PSM after the other; changed files are written at the end, if no problem occurred."""
    psms = [each for each in bench.subjects if each.kind == "PSM"]
    outcome = Outcome(notes=[] if psms else ["no PSM: nothing to measure"])
    changes: dict[str, dict[str, dict[io_file.Place, float]]] = {}
    for subject in psms:
        if subject.robot.potentiometers != "ANALOG":
            outcome.notes.append(f"{subject.name}: its insertion comes from its table, as in the original")
            continue
        if not bench.person.agrees(f"{subject.name}: is an 8 mm Classic instrument inserted, with its cannula off or "
                                   "slotted, so that the wrist can be seen at the remote centre? (n: leave out)"):
            outcome.notes.append(f"{subject.name}: left out, its insertion offset is that of its file")
            continue
        depth = depth_of(bench.document.arm(subject.arm))
        at, away = _measured(bench, subject, depth)
        if outcome.add(judge(at, away, depth, subject)):
            return outcome
        pot = subject.actuator(INSERTION).potentiometer
        assert pot is not None
        line, change = pot.voltage_to_position, depth - float(at[:, 0].mean())
        changes.setdefault(subject.robot.source, {})[subject.name] = io_file.line_of(INSERTION, line.scale,
                                                                                     line.offset + change)
        outcome.figures[subject.name] = {"depth": depth, "measured": at[:, 0].tolist(), "change": change}
    return io_file.save_all(bench, outcome, changes, folder, write=write)


def depth_of(arm: ArmConfig) -> float:
    """The insertion (m) at which the wrist's first axis is at the remote centre."""
    link = arm.chain.links[INSERTION]
    return -(link.d + link.offset) - SHAFT_M


def _measured(bench: RunningBench, subject: Subject, depth: float) -> tuple[Floats, Floats]:
    """Potentiometer and encoder (TIMES, 2) at the remote centre, and deeper, m."""
    found: tuple[list[list[float]], list[list[float]]] = ([], [])
    for _ in range(TIMES):
        for insertion, text, into in (
                (depth, f"Bring the first axis of the wrist of {subject.name} exactly to the remote centre, and hold "
                 "it still.", found[0]),
                (depth + AWAY_M, f"Insert the instrument {AWAY_M * 1e2:g} cm deeper, and hold it still.", found[1])):
            goal = [0.0] * len(subject.robot.actuators)
            goal[INSERTION] = insertion
            with bench.showing(subject.arm, goal[:INSERTION + 1]):
                window = held(bench, subject, Put(subject, tuple(goal)), text)
            into.append([float(window.axes(field, subject)[:, INSERTION].mean())
                         for field in ("pot_position", "position")])
    return np.array(found[0]), np.array(found[1])


def judge(at: Floats, away: Floats, depth: float, subject: Subject) -> list[Finding]:
    """Potentiometer and encoder (k, 2) at the remote centre and deeper, m."""
    where = subject.where(INSERTION)
    ways = away - at
    if not (ways[:, 1] > 0.5 * AWAY_M).all():
        return [Finding(where, f"went {ways[:, 1].min() * 1e3:.1f} mm deeper", f"{AWAY_M * 1e3:g} mm",
                        "insert the instrument further in between; else its encoder is dead or its sign wrong")]
    worst = float(ways[np.argmax(np.abs(ways[:, 0] / ways[:, 1] - 1.0)), 0])
    if not (np.abs(ways[:, 0] / ways[:, 1] - 1.0) <= WAY_WITHIN).all():
        return [Finding(where, f"its potentiometer went {worst * 1e3:.1f} mm on the way",
                        f"{ways[:, 1].mean() * 1e3:.1f} mm within {100 * WAY_WITHIN:g} %",
                        "it is dead, loose or has the wrong scale: stage calibrate first")]
    spread, change = float(np.ptp(at[:, 0])), float(depth - at[:, 0].mean())
    if not spread <= SPREAD_M:
        return [Finding(where, f"the places differ by {spread * 1e3:.2f} mm", f"{SPREAD_M * 1e3:g} mm",
                        "look along the axis of the wrist, and repeat this stage")]
    if not abs(change) <= MAX_CHANGE_M:
        return [Finding(where, f"its offset would change by {change * 1e3:+.1f} mm", f"{MAX_CHANGE_M * 1e3:g} mm",
                        "is it an 8 mm Classic instrument? S and Si ones are longer")]
    return []
