"""Stage `axis`: one motor at a time, with a small current that rises slowly until the axis has moved a little.

Brakes must hold against it first; then only the brake of this axis is released. The moving axis, its direction and its
potentiometer reveal wrong signs, wrong scales, swapped plugs, stuck axes and brakes, and failed motors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.shm.commands import became
from trocar.tools.commission.bench import CommandOutcome, RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats, Window

SHARE: Final = 0.4  # of the motor's largest current
SHARE_WITH_BRAKE: Final = 0.5  # an axis with a brake has weight: it must not fall when the brake is released
RISE_S: Final = 1.0
TRAVEL_RAD, TRAVEL_M = 0.035, 0.005
TIMEOUT_S: Final = 12.0
REST_S: Final = 0.4
HOLDS: Final = 0.2  # of the travel: maximum motion against a holding brake
LEAST: Final = 0.4  # of the travel: minimum that counts as motion
SLOPE_WITHIN: Final = 0.3  # potentiometer against encoder, over so short a way
CURRENT_WITHIN: Final = 0.5  # measured against requested, while it changes


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive of an axis: the answer, and the motion of encoders and potentiometers (n,) (rad, m)."""

    answer: CommandOutcome
    moved: Floats
    pots: Floats
    requested_a: float  # at its largest
    measured: float  # A measured for one A requested

    @classmethod
    def of(cls, answer: CommandOutcome, window: Window, subject: Subject, axis: int) -> Drive:
        """From io's records meanwhile."""
        request, current = (window.drives(name, subject)[:, axis] for name in ("current_request", "current"))
        return cls(answer, window.moved("position", subject), window.moved("pot_position", subject),
                   float(np.abs(request).max()), _gain(request, current))


def _gain(request: Floats, current: Floats) -> float:
    """Slope of the measured value over the one requested by the write before; NaN without a request."""
    asked, seen = request[:-1] - request[:-1].mean(), current[1:] - current[1:].mean()
    power = float(asked @ asked)
    return float(asked @ seen) / power if power > 0.0 else float("nan")


def run(bench: RunningBench) -> Outcome:
    """One arm after the other, until the first problem."""
    outcome = Outcome()
    for subject in (each for each in bench.subjects if each.arm):
        bench.person.confirm(
            f"{subject.whole()}: its amplifiers are switched on. Each axis in turn is moved a little ({travel_text()}) "
            f"with at most {100 * SHARE_WITH_BRAKE:g} % of its current; nothing else holds the arm. Move it to "
            "mid-range, support what can fall, keep the workspace clear, hand on the emergency stop.", subject.name)
        with bench.person.supporting(subject):
            bench.enable(subject)
            try:
                figures = outcome.figures.setdefault(subject.name, {})
                for axis in range(len(subject.robot.actuators)):
                    if subject.has_motor(axis) and outcome.add(_one(bench, subject, axis, figures)):
                        return outcome
            finally:
                bench.disable(subject)
    return outcome


def travel_text() -> str:
    """Travel of the axes in words."""
    return f"{np.degrees(TRAVEL_RAD):.0f}° or {TRAVEL_M * 1e3:.0f} mm"


def _one(bench: RunningBench, subject: Subject, axis: int, figures: dict[str, object]) -> list[Finding]:
    found = []
    if subject.has_brake(axis):
        held = _drive(bench, subject, axis, 1.0, release=False)
        found = judge_brake(held, subject, axis)
    if not found:
        up = _drive(bench, subject, axis, 1.0, release=subject.has_brake(axis))
        down = _drive(bench, subject, axis, -1.0, release=subject.has_brake(axis))
        figures[subject.names[axis]] = {"moved": [float(up.moved[axis]), float(down.moved[axis])],
                                        "pot_moved": [float(up.pots[axis]), float(down.pots[axis])],
                                        "current_A": [up.requested_a, down.requested_a]}
        found = judge(up, down, subject, axis)
    if not found and not bench.person.agrees(f"Was it {subject.title(axis)} that moved, and nothing else?"):
        found = [Finding(subject.where(axis), "the operator saw another axis move", f"{subject.names[axis]} alone",
                         "the plugs of motor, encoder and potentiometer of two axes are swapped")]
    return found


def _drive(bench: RunningBench, subject: Subject, axis: int, sign: float, *, release: bool) -> Drive:
    bench.sample(subject.io, REST_S)
    current = sign * share_of(subject, axis) * subject.actuator(axis).maximum_current
    values = (float(axis), current, RISE_S, travel_of(subject, axis), float(release))
    answer, window = bench.asked(subject.io, "drive_axis", values, subject.name, TIMEOUT_S)
    bench.person.show(f"{subject.title(axis)}: {current:+.2f} A: {answer.text}")
    return Drive.of(answer, window, subject, axis)


def travel_of(subject: Subject, axis: int) -> float:
    """Travel of an axis."""
    return TRAVEL_M if subject.slides(axis) else TRAVEL_RAD


def share_of(subject: Subject, axis: int) -> float:
    """Of the motor's largest current."""
    return SHARE_WITH_BRAKE if subject.has_brake(axis) else SHARE


def judge_brake(held: Drive, subject: Subject, axis: int) -> list[Finding]:
    """A brake that holds against a current."""
    if not held.answer.is_done:
        return [_stopped(held, subject, axis)]
    travel, unit = travel_of(subject, axis), subject.unit(axis)
    if abs(held.moved[axis]) <= HOLDS * travel:
        return []
    return [Finding(subject.where(axis), f"its brake slips: {held.moved[axis]:+.4f} {unit} with {held.requested_a:.2f} "
                    "A", f"{HOLDS * travel:.4f} {unit} at most", "stop here: the arm may fall. Repair the brake, or "
                    "is it the brake of another axis?")]


def judge(up: Drive, down: Drive, subject: Subject, axis: int) -> list[Finding]:
    """An axis driven both ways."""
    for drive in (up, down):
        if not drive.answer.is_done:
            return [_stopped(drive, subject, axis)]
    where, unit, travel = subject.where(axis), subject.unit(axis), travel_of(subject, axis)
    for drive in (up, down):
        if math.isnan(drive.measured):
            return [Finding(where, f"moved by {drive.moved[axis]:+.4f} {unit} and needed no current for it",
                            "at rest until its motor has current",
                            "something else moves it, e.g. its weight: support it and repeat")]
        if not abs(drive.measured - 1.0) <= CURRENT_WITHIN:
            return [Finding(where, f"{drive.measured:.2f} A measured for each A requested", "1 A within "
                            f"{100 * CURRENT_WITHIN:g} %", "motor or its plug is open, or the current calibration is "
                            "wrong")]
    moves = [abs(float(drive.moved[axis])) >= LEAST * travel for drive in (up, down)]
    with_a = f"with {up.requested_a:.2f} A"
    if not any(moves):
        return [_still(up, down, subject, axis)]
    if not all(moves):
        way = "the positive" if moves[0] else "the negative"
        return [Finding(where, f"moves in {way} direction only", "both ways",
                        "is it at a stop, or against its own weight? Move it to mid-range and repeat this stage")]
    if up.moved[axis] < 0.0 < down.moved[axis]:
        return [Finding(where, f"moves by {up.moved[axis]:+.4f} {unit} {with_a}", "the positive direction",
                        "the sign of current_to_bits or of bits_to_position is wrong, or a plug is reversed")]
    if (up.moved[axis] > 0.0) == (down.moved[axis] > 0.0):
        return [Finding(where, f"moves by {up.moved[axis]:+.4f} and {down.moved[axis]:+.4f} {unit} for currents both "
                        "ways", "there and back", "something else moves it, e.g. its weight: support it and repeat")]
    return _against_pot(up, down, subject, axis) if subject.has_pot(axis) else []


def _still(up: Drive, down: Drive, subject: Subject, axis: int) -> Finding:
    """It does not move: another does in its place, or none."""
    travels = np.array([travel_of(subject, k) for k in range(len(up.moved))])
    shares = np.maximum(np.abs(up.moved), np.abs(down.moved)) / travels
    other = int(np.argmax(shares))
    where, unit, travel = subject.where(axis), subject.unit(axis), travel_of(subject, axis)
    if other != axis and shares[other] >= 1.0:
        return Finding(where, f"stands still, {subject.title(other)} moves in its place", "it moves itself",
                       f"the motor or encoder plugs of axes {axis} and {other} are swapped")
    cause = "its brake does not release, or it is stuck" if subject.has_brake(axis) else "is it stuck or at a stop?"
    return Finding(where, f"moves by {up.moved[axis]:+.4f} and {down.moved[axis]:+.4f} {unit} with "
                   f"{up.requested_a:.2f} A", f"{travel:g} {unit}", f"{cause} Else its motor or encoder is unplugged")


def _against_pot(up: Drive, down: Drive, subject: Subject, axis: int) -> list[Finding]:
    """Comparison of its motion with its potentiometer's."""
    where, unit = subject.where(axis), subject.unit(axis)
    way, pot = float(up.moved[axis] - down.moved[axis]), float(up.pots[axis] - down.pots[axis])
    slope = pot / way
    if abs(slope - 1.0) <= SLOPE_WITHIN:
        return []
    seen = f"encoder moves {way:.4f} {unit}, potentiometer {pot:+.4f}"
    if slope < 0.0:
        return [Finding(where, seen, "the same way", "the sign of voltage_to_position is wrong, or motor and encoder "
                        "are both reversed")]
    if slope < LEAST:
        return [Finding(where, seen, "as far", "the potentiometer is dead, loose, or that of another axis")]
    return [Finding(where, seen, f"as far within {100 * SLOPE_WITHIN:g} %",
                    "one of the scales bits_to_position and voltage_to_position is wrong")]


def _stopped(drive: Drive, subject: Subject, axis: int) -> Finding:
    return Finding(subject.where(axis), f"driving it {became(drive.answer.outcome)}: {drive.answer.text}", "done",
                   "the logs say why; fix it and repeat this stage")
