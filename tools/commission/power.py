"""Stage `power`: relays close and the motor supplies come up, while every amplifier stays off."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window

SUPPLY_S: Final = 8.0  # then io switches it off by itself
UP_S: Final = 3.0  # time for a supply to come up; never more: some overheat their boards meanwhile
LOOK_S: Final = 1.0
IDLE_A: Final = 0.1


def run(bench: RunningBench) -> Outcome:
    """One arm after the other."""
    outcome = Outcome()
    for subject in (*(each for each in bench.subjects if each.arm), *bench.setups):
        bench.person.confirm(
            f"The relays of {subject.whole()} close and their motor supply is switched on for {SUPPLY_S:g} s. All "
            "amplifiers stay off: nothing should move. Hand on the emergency stop.", subject.name)
        if outcome.add(_one(bench, subject, outcome)):
            break
    return outcome


def _one(bench: RunningBench, subject: Subject, outcome: Outcome) -> list[Finding]:
    answer, window = bench.asked(subject.io, "supply_on", (SUPPLY_S,), subject.name, 2.0)
    if not answer.is_done:
        return [Finding(subject.whole(), f"io: {answer.text}", "done", "what prevents it?")]
    try:
        parts = [window, bench.sample(subject.io, 0.2)]
        while not parts[-1].flags("powered", subject)[-1] and parts[-1].stamp_s[-1] - parts[0].stamp_s[0] < UP_S:
            parts.append(bench.sample(subject.io, 0.2))
        parts.append(bench.sample(subject.io, LOOK_S))
    finally:
        bench.asked(subject.io, "power_off", (), subject.name, 2.0)
    window, after = Window.joined(parts), bench.sample(subject.io, LOOK_S)
    up = window.flags("powered", subject)
    outcome.figures[subject.name] = {"power_good_after_s": float(window.stamp_s[np.argmax(up)] - window.stamp_s[0])
                                     if up.any() else None}
    return judge(window, after, subject)


def judge(window: Window, after: Window, subject: Subject) -> list[Finding]:
    """The supply came up, no amplifier did; `after`: all of it is off again."""
    found = []
    on = window.drives("amp_on", subject)
    currents = np.abs(window.drives("current", subject)[-len(window) // 4 :]).mean(axis=0)
    for axis in range(len(subject.robot.actuators)):
        if on[:, axis].any():
            found.append(Finding(subject.where(axis), "its amplifier is on", "off, as it was not requested",
                                 "switch the controller off: an amplifier out of control must not get power"))
        elif currents[axis] > IDLE_A and subject.actuator(axis).maximum_current > 0.0:
            found.append(Finding(subject.where(axis), f"{currents[axis]:.3f} A with its amplifier off",
                                 f"{IDLE_A:g} A at most", "calibrate the current offsets, or the amplifier is broken"))
    if not window.flags("powered", subject)[-1]:
        closed, fault = (bool(window.flags(name, subject)[-1]) for name in ("relay", "power_fault"))
        seen = "a motor supply fault" if fault else "no motor supply" if closed else "the safety relay does not close"
        found.append(Finding(subject.whole(), f"{seen} within {UP_S:g} s", "supply and relay good on every board",
                             "is the emergency stop released, the safety chain plugged in, the supply switched on?"))
    elif after.flags("powered", subject)[-1]:
        found.append(Finding(subject.whole(), "its motor supply stays on after power_off", "off",
                             "switch the controllers off and check their relays"))
    return found
