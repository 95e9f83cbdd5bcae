"""Stage `tables`: the table of an Si arm's digital potentiometers, made by hand from stop to stop.

The brakes are released and the motors stay off, as only calibration mode allows: it is on while an arm has no table.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from trocar.procs.config.read.source import read_source
from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.lookup_table import DIGITS, MISSING, RANGE_WITHIN, RANGES, Floats, ReadingsByHand
from trocar.tools.commission.person import Sweep
from trocar.tools.commission.subject import Subject
from trocar.tools.output.errors import Problem

LOOK_S: Final = 0.01
TRIES: Final = 3


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """One arm after the other, until the first problem; with `write`, the table is put beside the IO file."""
    digital = [each for each in bench.subjects if each.arm and each.robot.potentiometers == "DIGITAL"]
    outcome = Outcome(notes=[] if digital else ["no arm with digital potentiometers: none needs a table"])
    for subject in digital:
        if subject.robot.lookup:
            outcome.notes.append(f"{subject.name}: it has its table; rename that file to make it again")
            continue
        name = _name(subject)  # first: a wrong one must not cost the work of the person
        rows, tries, found = _rows(bench, subject)
        if outcome.add(found):
            return outcome
        outcome.figures[subject.name] = {
            "readings": [int((row != MISSING).sum()) for row in rows], "tries": tries}
        source = Path(subject.robot.source)
        content = {"lookup": [[float(f"{value:.{DIGITS}g}") for value in row] for row in rows],
                   "serial": subject.robot.serial}
        io_file.save_new(bench, outcome, (source.parent if write else folder) / name, content,
                         f"the table of {subject.name}", source)
    return outcome


def _rows(bench: RunningBench, subject: Subject) -> tuple[list[Floats], int, list[Finding]]:
    """The rows of the table, after how many tries, and the axes that have none. Only those are moved again."""
    seen, left = ReadingsByHand(len(subject.robot.actuators)), list(range(len(subject.robot.actuators)))
    for tries in range(1, TRIES + 1):
        bench.person.confirm(
            f"The brakes of {subject.whole()} are released; its motors stay off, and nothing holds it. Remove "
            "instrument and adapter, hold the arm, keep the workspace clear, hand on the emergency stop.", subject.name)
        with bench.person.supporting(subject):
            _move(bench, subject, seen, left)
        rows = [seen.row(axis, subject.kind) for axis in range(len(subject.robot.actuators))]
        left = [axis for axis, (_, why) in enumerate(rows) if why]
        found = [Finding(subject.where(axis), rows[axis][1], _allowed(subject, axis), "move it slowly from stop to "
                         "stop, and repeat this stage") for axis in left]
        problems = "; ".join(f"{subject.title(axis)}: {rows[axis][1]}" for axis in left)
        if not left or tries == TRIES or not bench.person.agrees(
                f"{problems}. The brakes hold. Repeat with {'this axis' if len(left) == 1 else 'these axes'} only?"):
            break
        for axis in left:
            seen.forget(axis)
    return [row for row, _ in rows], tries, found


def _allowed(subject: Subject, axis: int) -> str:
    low, high = RANGES[subject.kind][axis]
    return f"all readings from stop to stop, {high - low:.4g} {subject.unit(axis)} within {100 * RANGE_WITHIN:g} %"


def _move(bench: RunningBench, subject: Subject, seen: ReadingsByHand, axes: Sequence[int]) -> None:
    """Note what the encoders show at each reading while the person moves these axes; everything is off afterwards."""
    every = len(axes) == len(subject.names)
    which = f"every axis of {subject.name}" if every else ", ".join(map(subject.title, axes))
    expected = np.array([high - low for low, high in RANGES[subject.kind]])
    try:
        bench.enable(subject)
        answer, _ = bench.asked(subject.io, "brake_release", (), subject.name, 2.0)
        if not answer.is_done:
            raise Problem(f"{subject.whole()}: io: {answer.text}")
        for _ in bench.person.doing(Sweep(subject), f"Move {which} slowly from stop to stop, back and forth, "
                                    "until each shows 95 to 105 % and no more than before."):
            window = bench.sample(subject.io, LOOK_S)
            if not window.flags("powered", subject).all():
                raise Problem(f"{subject.whole()}: its power went off, its brakes hold; trocar logs has the cause")
            seen.add(np.asarray(window.fields["pot_bits"][:, subject.axes], dtype=np.intp),
                     window.axes("position", subject), axes)
            shares = 100.0 * seen.range() / expected
            bench.person.show(f"{subject.name}: " + ", ".join(f"{share:.0f} %" for share in shares))
    finally:
        bench.asked(subject.io, "brake_engage", (), subject.name, 2.0)
        bench.disable(subject)


def _name(subject: Subject) -> str:
    """The name that the IO file gives the table; Problem if the system would not accept it."""
    read, problems = read_source(Path(subject.robot.source))
    if read is None:
        raise Problem(f"{subject.robot.source} can no longer be read: {problems[0]}")
    data: dict[str, Any] = read.data
    (robot,) = (each for each in data["robots"] if each["name"] == subject.name)
    name = Path(robot["potentiometers"]["lookup_table_file"]).name
    if not subject.robot.serial or subject.robot.serial not in name or not name.endswith(".json"):
        raise Problem(f"{subject.robot.source}: lookup_table_file {name} of {subject.name} has to contain its serial "
                      f"number {subject.robot.serial!r} and to end with .json; change it first")
    return name
