"""Stage `read`: without power; samples, sensors and switches are plausible, and every axis is moved by hand."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.document.cart import channel_inputs
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Carry, Press
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window

REST_S: Final = 2.0
REHEARSAL_LOOKS: Final = 4
LOOK_S: Final = 0.05
MIN_VALID: Final = 0.99  # share of good samples
RATE_WITHIN: Final = 0.1
VOLTS_EDGE: Final = 0.02  # of the converter's range, at either end: closer values mean a loose wire
FULL_BITS: Final = 65535
MAX_NOISE_V: Final = 0.05
BEYOND_RANGE: Final = 0.15  # of the range of an axis, how far outside its limits a potentiometer may see it
IDLE_A: Final = 0.1  # measured without power: more means an offset that needs calibration
CELSIUS = (5.0, 50.0)
HAND_RAD, HAND_M = 0.15, 0.02  # motion of an axis by hand
SLOPE_WITHIN: Final = 0.15  # potentiometer against encoder
LEAST = 0.3  # of the requested motion: less is no motion


def run(bench: RunningBench) -> Outcome:
    """See the module."""
    outcome = Outcome()
    for name in _ios(bench):
        window, found = _at_rest(bench, name)
        outcome.add(found)
        outcome.figures[name] = {"rate_hz": rate_of(window), "good": float(window.fields["valid"].mean())}
        for subject in (each for each in (*bench.subjects, *bench.setups) if each.io == name):
            outcome.add(judge_rest(window, subject))
            outcome.figures[subject.name] = {
                "pot_V": window.axes("pot_voltage", subject).mean(axis=0).tolist(),
                "pot_noise_V": window.axes("pot_voltage", subject).std(axis=0).tolist(),
                "current_A": window.drives("current", subject).mean(axis=0).tolist(),
                "celsius": window.drives("temperature", subject)[-1].tolist()}
    if outcome.problems:
        return outcome
    for subject in bench.subjects:
        if subject.arm:
            _by_hand(bench, subject, outcome)
    _buttons(bench, outcome)
    return outcome


def _ios(bench: RunningBench) -> list[str]:
    return list(dict.fromkeys(subject.io for subject in (*bench.subjects, *bench.setups)))


def _at_rest(bench: RunningBench, name: str) -> tuple[Window, list[Finding]]:
    """A while without power, and the problems of its samples. Emulated boards share the machine with us, and may be
    stalled with it: one good look of several is enough there.
    """
    for _ in range(REHEARSAL_LOOKS if bench.document.emulation is not None else 1):
        window = bench.sample(name, REST_S)
        found = judge_samples(name, window, bench.document.io(name).period_s)
        if not found:
            break
    return window, found


def rate_of(window: Window) -> float:
    """Samples a second."""
    return (len(window) - 1) / max(1e-9, float(window.stamp_s[-1] - window.stamp_s[0]))


def judge_samples(io: str, window: Window, period_s: float) -> list[Finding]:
    """Whether an io receives its boards' data, and in time."""
    found, good, rate = [], float(window.fields["valid"].mean()), rate_of(window)
    if not good >= MIN_VALID:
        found.append(Finding(io, f"{100 * good:.1f} % of its samples are good", f"{100 * MIN_VALID:g} % at least",
                             "check cables, hub and network; the logs name the board"))
    if not abs(rate * period_s - 1.0) <= RATE_WITHIN:
        found.append(Finding(io, f"{rate:.0f} samples a second", f"{1 / period_s:.0f} within {100 * RATE_WITHIN:g} %",
                             "the computer is too slow or too busy: trocar bench io, docs/real-time.md"))
    return found


def judge_rest(window: Window, subject: Subject) -> list[Finding]:
    """Sensors of a robot at rest without power."""
    found = []
    on = window.ever_on(subject)
    for axis in range(len(subject.robot.actuators)):
        where = subject.where(axis)
        if on[axis]:
            found.append(Finding(where, "its amplifier is on", "off, as power was not requested",
                                 "switch the controller's supply off; its amplifier or its cable is broken"))
        if not subject.is_setup:  # their potentiometers are behind a multiplexer
            found += _pot(window, subject, axis)
        found += _current(window, subject, axis)
    found += _temperature(window, subject)
    return found


def _pot(window: Window, subject: Subject, axis: int) -> list[Finding]:
    actuator, where = subject.actuator(axis), subject.where(axis)
    position = window.axes("pot_position", subject)[:, axis]
    if subject.robot.lookup:
        if np.isfinite(position).all():
            return []
        return [Finding(where, "its potentiometer gives readings that are not in its table", "those of the table",
                        "is this arm's own table in use? If so, its sensor or cable is broken")]
    if actuator.potentiometer is None or not subject.has_pot(axis):  # a master's roll turns further than its own
        return []
    volts, scale = window.axes("pot_voltage", subject)[:, axis], actuator.potentiometer.bits_to_voltage
    ends = sorted((scale.offset, scale.offset + FULL_BITS * scale.scale))
    edge = VOLTS_EDGE * (ends[1] - ends[0])
    low, high, mean, noise = ends[0] + edge, ends[1] - edge, float(volts.mean()), float(volts.std())
    if not low <= mean <= high:
        return [Finding(where, f"potentiometer {mean:.3f} V", f"{low:.2f} to {high:.2f} V",
                        "its cable is loose or it is dead: check plug and cable")]
    if not noise <= MAX_NOISE_V:
        return [Finding(where, f"potentiometer noise {noise:.3f} V", f"{MAX_NOISE_V:g} V at most",
                        "a bad contact or a broken shield: check plug and cable")]
    lower, upper = subject.range_of(axis)
    room = BEYOND_RANGE * (upper - lower)
    if lower < upper and not lower - room <= position.mean() <= upper + room:
        unit = subject.unit(axis)
        return [Finding(where, f"potentiometer says {position.mean():.4g} {unit}",
                        f"{lower - room:.4g} to {upper + room:.4g} {unit}",
                        "are the files this arm's? if so, its potentiometer is not calibrated (stage calibrate)")]
    return []


def _current(window: Window, subject: Subject, axis: int) -> list[Finding]:
    mean = float(window.drives("current", subject)[:, axis].mean())
    if subject.actuator(axis).maximum_current == 0.0 or abs(mean) <= IDLE_A:
        return []
    return [Finding(subject.where(axis), f"{mean:.3f} A are measured without power", f"{IDLE_A:g} A at most",
                    "calibrate the current offsets of this controller (bits_to_current, current_to_bits)")]


def _temperature(window: Window, subject: Subject) -> list[Finding]:
    if subject.robot.hardware == "dRA1":  # it has no sensors
        return []
    celsius = window.drives("temperature", subject)[-1][: len(subject.robot.actuators)]
    bad = ~((celsius >= CELSIUS[0]) & (celsius <= CELSIUS[1]))
    if not bad.any():
        return []
    axis = int(np.argmax(bad))
    return [Finding(subject.where(axis), f"amplifier at {celsius[axis]:.1f} °C",
                    f"{CELSIUS[0]:g} to {CELSIUS[1]:g} °C at rest", "let it cool down, check its fan and its sensor")]


def _by_hand(bench: RunningBench, subject: Subject, outcome: Outcome) -> None:
    """Every axis that can be moved by hand, one after the other."""
    for axis in range(len(subject.robot.actuators)):
        if subject.actuator(axis).encoder is None:
            continue
        if subject.has_brake(axis):
            outcome.notes.append(f"{subject.title(axis)}: its brake holds it, stage axis moves it")
            continue
        by = HAND_M if subject.slides(axis) else HAND_RAD
        window = carried(bench, subject, axis, by)
        if outcome.add(judge_hand(window, subject, axis, by)):
            continue
        sign = _first_way(window, subject, axis)
        if not bench.person.agrees(f"{subject.title(axis)} went {sign} first. Is that the way you moved it?"):
            outcome.problems.append(Finding(
                subject.where(axis), f"went {sign} for its encoder and the other way for the operator", "the same way",
                "the signs of bits_to_position and voltage_to_position are those of another arm, or plugs are swapped"))


def carried(bench: RunningBench, subject: Subject, axis: int, by: float) -> Window:
    """Sensor data while a person moves an axis back and forth; ends when it has moved far enough."""
    far = f"{by * 1e3:.0f} mm" if subject.slides(axis) else f"{np.degrees(by):.0f}°"
    text = (f"Move {subject.title(axis)} by hand, first in its positive direction, by {far} or more, "
            "and keep the others still.")
    parts = [bench.sample(subject.io, LOOK_S)]
    for _ in bench.person.doing(Carry(subject, axis, by), text):
        parts.append(bench.sample(subject.io, LOOK_S))
        seen = Window.joined(parts)
        position, pot = (seen.axes(name, subject)[:, axis] for name in ("position", "pot_position"))
        bench.person.show(f"{subject.title(axis)}: encoder {position[-1] - position[0]:+.4f}, "
                          f"potentiometer {pot[-1] - pot[0]:+.4f} {subject.unit(axis)}")
        if np.ptp(position) >= by and (np.ptp(pot) >= 0.8 * by or not subject.has_pot(axis)):
            break
    return Window.joined(parts)


def judge_hand(window: Window, subject: Subject, axis: int, by: float) -> list[Finding]:
    """Encoder and potentiometer of an axis that was moved by hand by at least `by`."""
    where, unit = subject.where(axis), subject.unit(axis)
    encoders, pots = window.axes("position", subject), window.axes("pot_position", subject)
    spans = np.ptp(encoders, axis=0)
    span, pot = float(spans[axis]), float(np.ptp(pots[:, axis]))
    has_pot = subject.has_pot(axis)
    if span < LEAST * by:
        other = int(np.argmax(spans / [HAND_M if subject.slides(k) else HAND_RAD for k in range(len(spans))]))
        if other != axis and spans[other] >= by * LEAST:
            return [Finding(where, f"stands still, and {subject.title(other)} moved by {spans[other]:.3f}",
                            f"{by:g} {unit} by itself", "the plugs of these two axes' encoders are swapped")]
        if has_pot and pot >= LEAST * by:
            return [Finding(where, f"its encoder stands still, its potentiometer moved by {pot:.3f} {unit}",
                            f"{by:g} {unit}", "the encoder is dead or unplugged")]
        return [Finding(where, f"moved by {span:.4f} {unit}", f"{by:g} {unit} by hand",
                        "is it stuck, or held? Else encoder and potentiometer are unplugged")]
    if not has_pot:
        return []
    if not np.isfinite(pot) or pot < LEAST * span:
        return [Finding(where, f"its encoder moved by {span:.3f} {unit}, its potentiometer by {pot:.4f}",
                        f"{span:.3f} {unit} both", "the potentiometer is dead or its cable loose")]
    slope = float(np.polyfit(encoders[:, axis], pots[:, axis], 1)[0])
    if slope < 0.0:
        return [Finding(where, f"encoder and potentiometer go opposite ways ({slope:+.2f})", "the same way",
                        "one of the scales bits_to_position and voltage_to_position has the wrong sign, or a plug "
                        "is reversed")]
    if not abs(slope - 1.0) <= SLOPE_WITHIN:
        return [Finding(where, f"its potentiometer moves {slope:.2f} times as far as its encoder",
                        f"1 within {100 * SLOPE_WITHIN:g} %",
                        "one of the scales bits_to_position and voltage_to_position is wrong")]
    return []


def _first_way(window: Window, subject: Subject, axis: int) -> str:
    position = window.axes("position", subject)[:, axis]
    far = position[int(np.argmax(np.abs(position - position[0])))]
    return "in its positive direction" if far >= position[0] else "in its negative direction"


def _buttons(bench: RunningBench, outcome: Outcome) -> None:
    """Digital inputs, one after the other; an input that is not pressed is a remark."""
    tried, left = {}, []
    channels = {name for cart in bench.carts for name in channel_inputs(cart.robot)}  # of their multiplexer: no buttons
    for name in _ios(bench):
        for place, row in enumerate(bench.document.io(name).digital_inputs):
            if row.name in channels:
                continue
            parts = [bench.sample(name, LOOK_S)]
            before = bool(parts[0].fields["input"][-1, place])
            how = "is pressed now: release it and press it again" if before else "press and release it"
            for _ in bench.person.doing(Press(row.name, not before), f"{row.name}: {how} (Enter: skip it)."):
                parts.append(bench.sample(name, LOOK_S))
                if parts[-1].fields["input"][-1, place] != before:
                    break
            seen = np.concatenate([part.fields["input"][:, place] for part in parts])
            tried[row.name] = before
            if seen.all() or not seen.any():
                left.append(row.name)
    outcome.figures["inputs"] = tried
    if left:
        outcome.notes.append(f"never changed: {', '.join(left)}")
