"""Stage `calibrate`: scales and offsets of analog potentiometers, and of grippers, from motions by hand.

As in the original's scripts: a scale is the slope of the encoder, moved by hand, over the voltage; an offset makes the
potentiometer read 0 in the zero position, in which the person holds the axis. A gripper is 0 where its second spring
begins and 60° fully open, as far as tools open. The values are written to a new IO file, or with --write to the IO file
itself, with the old content kept beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.kinematics.inverse.arms import carrying
from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Put, Squeeze
from trocar.tools.commission.picture import SIDES, frames_at, picture
from trocar.tools.commission.read import carried
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats, Window

OPEN_RAD: Final = float(np.radians(60.0))
SHARE: Final = 0.4  # of its range: motion of an axis by hand
MAX_WAY_RAD, MAX_WAY_M = 1.0, 0.1
RESIDUAL: Final = 0.03  # of that motion: maximum residual of a straight line
SCALE_WITHIN: Final = 0.25  # a new scale against the old one
MIN_V: Final = 0.2  # between closed and open
HOLD_S: Final = 2.0
LOOK_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class FittedLine:
    """position = scale · V + offset, and its residual (rms)."""

    scale: float
    offset: float
    residual: float


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """Calibrate each robot in turn; changed files are written at the end, if no problem occurred."""
    outcome = Outcome()
    changes: dict[str, dict[str, dict[io_file.Place, float]]] = {}
    for subject in bench.subjects:
        if subject.robot.potentiometers != "ANALOG":
            outcome.notes.append(f"{subject.name}: its potentiometers are {subject.robot.potentiometers}, nothing to "
                                 "calibrate")
            continue
        lines = _robot(bench, subject, outcome) if subject.arm else _gripper(bench, subject, outcome)
        if outcome.problems:
            return outcome
        if lines:
            changes.setdefault(subject.robot.source, {})[subject.name] = {
                place: value for axis, line in lines.items()
                for place, value in io_file.line_of(axis, line.scale, line.offset).items()}
            outcome.figures[subject.name] = {
                subject.names[axis]: {"scale": line.scale, "offset": line.offset, "was": list(_old(subject, axis))}
                for axis, line in lines.items()}
    return io_file.save_all(bench, outcome, changes, folder, write=write)


def _old(subject: Subject, axis: int) -> tuple[float, float]:
    pot = subject.actuator(axis).potentiometer
    assert pot is not None
    return pot.voltage_to_position.scale, pot.voltage_to_position.offset


def _robot(bench: RunningBench, subject: Subject, outcome: Outcome) -> dict[int, FittedLine]:
    """Scales from moving each axis by hand, offsets from the zero position."""
    axes = [axis for axis in range(len(subject.robot.actuators))
            if subject.has_pot(axis) and not subject.has_brake(axis)]
    if len(axes) < len(subject.robot.actuators):
        outcome.notes.append(f"{subject.name}: only axes {', '.join(map(str, axes)) or 'none'} can be moved by hand "
                             "and have a potentiometer for their position")
    lines: dict[int, FittedLine] = {}
    for axis in axes:
        by = way_of(subject, axis)
        line = fitted(carried(bench, subject, axis, by), subject, axis)
        if outcome.add(judge(line, subject, axis, by)):
            return {}
        lines[axis] = line
    arm = bench.document.arm(subject.arm)
    kinematics = carrying(arm, arm.tool.name if arm.tool is not None else arm.endoscope)
    zero = np.zeros(kinematics.n)
    bench.person.report(f"The zero position of {subject.name} looks like this:\n"
                        + picture(frames_at(kinematics, zero), SIDES))
    with bench.showing(subject.arm, zero.tolist()):
        chosen = bench.person.chosen(f"Hold {subject.name} in its zero position (all joints 0). Which axes are there "
                                     "now?", axes)
        if not chosen:
            return {axis: FittedLine(line.scale, _old(subject, axis)[1], 0.0) for axis, line in lines.items()}
        volts = _volts(bench, subject, Put(subject, (0.0,) * len(subject.robot.actuators)),
                      f"Hold {subject.name} in its zero position, still.")
    return {axis: FittedLine(line.scale,
                             -line.scale * float(volts[axis]) if axis in chosen else _old(subject, axis)[1], 0.0)
            for axis, line in lines.items()}


def _volts(bench: RunningBench, subject: Subject, act: Put | Squeeze, text: str) -> Floats:
    """Mean voltages (n,) while the person holds the robot."""
    mean: Floats = held(bench, subject, act, text).axes("pot_voltage", subject).mean(axis=0)
    return mean


def held(bench: RunningBench, subject: Subject, act: Put | Squeeze, text: str) -> Window:
    """Samples of the last HOLD_S before the person, who holds the robot, presses Enter."""
    parts: list[Window] = []
    for _ in bench.person.doing(act, text):
        parts.append(bench.sample(subject.io, LOOK_S))
    return Window.joined(parts[-round(HOLD_S / LOOK_S):])


def way_of(subject: Subject, axis: int) -> float:
    """The distance (rad, m) by which the person moves an axis for its calibration."""
    low, high = subject.range_of(axis)
    return min(MAX_WAY_M if subject.slides(axis) else MAX_WAY_RAD, SHARE * (high - low) or MAX_WAY_RAD)


def fitted(window: Window, subject: Subject, axis: int) -> FittedLine:
    """The straight line of an axis's position, measured by its encoder, over the voltage of its potentiometer."""
    position = window.axes("position", subject)
    matrix = subject.robot.joint_to_actuator_position
    seen = position @ np.linalg.inv(np.array(matrix)).T if matrix is not None else position
    volts = window.axes("pot_voltage", subject)[:, axis]
    if np.ptp(volts) == 0.0:
        return FittedLine(0.0, 0.0, float("nan"))
    scale, offset = (float(value) for value in np.polyfit(volts, seen[:, axis], 1))
    return FittedLine(scale, offset, float(np.sqrt(np.mean((scale * volts + offset - seen[:, axis]) ** 2))))


def judge(line: FittedLine, subject: Subject, axis: int, by: float) -> list[Finding]:
    """Problems of a line that is not plausible."""
    where, unit, old = subject.where(axis), subject.unit(axis), _old(subject, axis)[0]
    if math.isnan(line.residual):
        return [Finding(where, "the voltage of its potentiometer did not change", "it follows the motion",
                        "it is dead or its cable is loose: check plug and cable")]
    if not line.residual <= RESIDUAL * by:
        return [Finding(where, f"its potentiometer is {line.residual:.4f} {unit} off a straight line",
                        f"{RESIDUAL * by:.4f} {unit}", "is it worn, loose or dead? Calibrating cannot help it")]
    if old and not abs(line.scale / old - 1.0) <= SCALE_WITHIN:
        return [Finding(where, f"scale {line.scale:+.5g} {unit}/V, in the file {old:+.5g}",
                        f"the file's within {100 * SCALE_WITHIN:g} %",
                        "the encoder's scale or sign is wrong, or these are another arm's files: stage read first")]
    return []


def _gripper(bench: RunningBench, subject: Subject, outcome: Outcome) -> dict[int, FittedLine]:
    """The line of a gripper: 0 closed, 60° open."""
    closed = _volts(bench, subject, Squeeze(subject, True),
                   f"Close {subject.name} lightly, until you feel its second spring and no further, and hold it.")
    opened = _volts(bench, subject, Squeeze(subject, False), f"Let {subject.name} open as far as it goes.")
    line, found = gripper_line(float(closed[0]), float(opened[0])), []
    if line is None:
        found = [Finding(subject.where(0), f"{closed[0]:.3f} V closed, {opened[0]:.3f} V open",
                         f"{MIN_V:g} V between", "its potentiometer is dead or its cable loose")]
    return {} if outcome.add(found) or line is None else {0: line}


def gripper_line(closed_v: float, open_v: float) -> FittedLine | None:
    """The line through the voltages of the closed and the open gripper; None if they are nearly equal."""
    if not abs(open_v - closed_v) >= MIN_V:
        return None
    scale = OPEN_RAD / (open_v - closed_v)
    return FittedLine(scale, -scale * closed_v, 0.0)
