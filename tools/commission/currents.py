"""Stage `currents`: what each amplifier measures without current, and lets flow at zero command, into an IO file.

The current is measured twice, with amplifiers off (A) and on at zero command (B). A is the error of the measurement,
C = B - A that of the command: the offset of bits_to_current becomes smaller by A, that of current_to_bits by C times
its scale. dRA1 controllers calibrate themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.document.system import Actuator, Brake
from trocar.tools.commission import io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.power import SUPPLY_S, UP_S
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats, Window
from trocar.tools.output.errors import Problem

SETTLE_S, LOOK_S = 1.0, 2.0  # 3000 samples: a noise of 5 mA leaves 0.1 mA
MAX_ERROR_A, MAX_NOISE_A = 0.1, 0.005
SLICE_S: Final = 0.1
MAX_MOTION: Final = {"rad": 0.35, "m": 0.05}
"""Of an axis at zero command; beyond, the amplifiers go off at once."""
KEPT: Final = 2.0
"""Standard deviations: samples further from the mean are left out."""


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """One arm after the other; changed files are written at the end, if no problem occurred."""
    outcome = Outcome()
    changes: dict[str, dict[str, dict[io_file.Place, float]]] = {}
    for subject in (*(each for each in bench.subjects if each.arm), *bench.setups):
        if subject.robot.hardware == "dRA1":
            outcome.notes.append(f"{subject.name}: dRA1 controllers need no current offsets")
            continue
        keep = ("The brakes hold. Press no clutch of the setup joints, and no button of their column."
                if subject.is_setup else "Axes without brakes are free and may drift: hold the arm where it is.")
        bench.person.confirm(f"The amplifiers of {subject.whole()} are switched on at zero command. {keep} Hand on the "
                             "emergency stop.", subject.name)
        off, on = _measured(bench, subject)
        if outcome.add(judge(off, on, subject)):
            return outcome
        measured, at_zero = mean_of(off, subject), mean_of(on, subject)
        changes.setdefault(subject.robot.source, {})[subject.name] = offsets(subject, measured, at_zero)
        outcome.figures[subject.name] = {"measured_a": measured.tolist(), "command_a": (at_zero - measured).tolist()}
    return io_file.save_all(bench, outcome, changes, folder, write=write)


def _measured(bench: RunningBench, subject: Subject) -> tuple[Window, Window]:
    """Samples with the motor supply on, amplifiers first off, then on at zero command; everything is off afterwards."""
    try:
        answer, _ = bench.asked(subject.io, "supply_on", (SUPPLY_S,), subject.name, 2.0)
        up = [bench.sample(subject.io, SLICE_S)]
        while not up[-1].flags("powered", subject)[-1] and up[-1].stamp_s[-1] - up[0].stamp_s[0] < UP_S:
            up.append(bench.sample(subject.io, SLICE_S))
        if not answer.is_done or not up[-1].flags("powered", subject)[-1]:
            raise Problem(f"{subject.whole()}: its motor supply does not come up ({answer.text or answer.outcome}); "
                          "repeat stage power")
        bench.sample(subject.io, SETTLE_S)
        off = bench.sample(subject.io, LOOK_S)
        bench.asked(subject.io, "power_off", (), subject.name, 2.0)
        with bench.person.supporting(subject):
            bench.enable(subject)
            parts = [bench.sample(subject.io, SLICE_S)]
            while parts[-1].stamp_s[-1] - parts[0].stamp_s[0] < SETTLE_S + LOOK_S and not moving(parts, subject):
                parts.append(bench.sample(subject.io, SLICE_S))
            return off, Window.joined(parts)
    finally:
        bench.disable(subject)


def moving(parts: Sequence[Window], subject: Subject) -> list[int]:
    """Axes that have moved too far from the first to the last of some samples; no setup joints: they have brakes."""
    if subject.is_setup:
        return []
    motion = parts[-1].axes("position", subject)[-1] - parts[0].axes("position", subject)[0]
    return [axis for axis in range(len(motion)) if not abs(motion[axis]) <= MAX_MOTION[subject.unit(axis)]]


def drives_of(subject: Subject) -> list[Actuator | Brake]:
    """Its actuators, then its brakes."""
    return [*subject.robot.actuators, *subject.robot.brakes]


def mean_of(window: Window, subject: Subject) -> Floats:
    """Mean current of each drive, A, of the last LOOK_S without outliers."""
    values = _currents(window, subject)
    kept = np.abs(values - values.mean(axis=0)) <= KEPT * values.std(axis=0)
    found: Floats = np.where(kept, values, 0.0).sum(axis=0) / kept.sum(axis=0)
    return found


def _currents(window: Window, subject: Subject) -> Floats:
    """Currents of the last LOOK_S (k, drives), A."""
    late = window.stamp_s >= window.stamp_s[-1] - LOOK_S
    return np.asarray(window.drives("current", subject)[late], dtype=np.float64)


def offsets(subject: Subject, measured: Floats, at_zero: Floats) -> dict[io_file.Place, float]:
    """The new offsets of every drive, for its mean currents with amplifiers off and on."""
    count, found = len(subject.robot.actuators), dict[io_file.Place, float]()
    for k, drive in enumerate(drives_of(subject)):
        where = ("actuators", k, "drive") if k < count else ("brakes", k - count, "drive")
        command = float(at_zero[k] - measured[k]) * drive.current_to_bits.scale
        found[*where, "bits_to_current", "offset"] = drive.bits_to_current.offset - float(measured[k])
        found[*where, "current_to_bits", "offset"] = drive.current_to_bits.offset - command
    return found


def judge(off: Window, on: Window, subject: Subject) -> list[Finding]:
    """Problems of these samples."""
    found = []
    if off.drives("amp_on", subject).any() or not off.flags("powered", subject).all():
        found.append(Finding(subject.whole(), "its motor supply was off, or an amplifier on",
                             "supply on, amplifiers off", "stage power first"))
    if not on.drives("amp_on", subject).all():
        found.append(Finding(subject.whole(), "an amplifier went off", "all on", "trocar logs has the cause"))
    asked = np.abs(on.drives("current_request", subject)).max(axis=0, initial=0.0)
    if subject.is_setup and asked.max() > MAX_NOISE_A:
        found.append(Finding(subject.where(int(asked.argmax())), f"{asked.max():.3f} A were requested", "no current",
                             "press no clutch, and set brake_engaged_current to 0 for this stage"))
    for axis in moving([on], subject):
        unit = subject.unit(axis)
        found.append(Finding(subject.where(axis), f"it moved more than {MAX_MOTION[unit]:g} {unit}",
                             "it stays where it is", "hold it away from its limits, and repeat this stage"))
    if found:
        return found
    measured, at_zero = mean_of(off, subject), mean_of(on, subject)
    noise = np.maximum(*(_currents(window, subject).std(axis=0) for window in (off, on)))
    count = len(subject.robot.actuators)
    for k in range(len(drives_of(subject))):
        where = subject.where(k) if k < count else f"{subject.name} brake {k - count}"
        worst = max(abs(measured[k]), abs(at_zero[k] - measured[k]))
        if not worst <= MAX_ERROR_A:
            found.append(Finding(where, f"{worst:.3f} A without a command", f"{MAX_ERROR_A:g} A",
                                 "is it the right robot, are all plugs in? Then the amplifier is broken"))
        elif not noise[k] <= MAX_NOISE_A:
            found.append(Finding(where, f"its current varies by {noise[k]:.4f} A (standard deviation)",
                                 f"{MAX_NOISE_A:g} A", "look for a loose plug"))
    return found
