"""Stage `stop`: a person's emergency stop and the boards' own watchdog take power away, and nothing brings it back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.document.system import IoConfig
from trocar.procs.fpga import registers
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import Stop
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window
from trocar.tools.inspect import samples
from trocar.tools.inspect.bus_client import BusClient, FoundBoard
from trocar.tools.systems.processes import CONTINUE, RunningProcess, running

STOP: Final = 19  # signal: the process is stopped
STOP_S: Final = 0.1  # from the safety chain to the last amplifier
SLACK_S: Final = 0.05  # delay of our own polling, in addition to the watchdog's time
STAYS_S: Final = 2.0
LOOK_S: Final = 0.1


def run(bench: RunningBench) -> Outcome:
    """Bus after bus."""
    outcome = Outcome()
    for io in (io for io in bench.document.ios if io.port):
        arms = [subject for subject in (*bench.subjects, *bench.setups) if subject.io == io.name and subject.arm]
        if arms and not outcome.add(_emergency_stop(bench, arms, outcome)):
            outcome.add(_watchdog(bench, io, arms, outcome))
        if outcome.problems:
            break
    return outcome


def _enable(bench: RunningBench, arms: Sequence[Subject]) -> None:
    for subject in arms:
        bench.enable(subject)


def _emergency_stop(bench: RunningBench, arms: list[Subject], outcome: Outcome) -> list[Finding]:
    names = ", ".join(subject.name for subject in arms)
    bench.person.confirm(f"The amplifiers of {names} are switched on, nothing is driven. Then press the emergency "
                         f"stop: arms without brakes may sag, support them.{_keep_off(arms)}", "stop")
    io = arms[0].io
    try:
        _enable(bench, arms)
        parts = [bench.sample(io, LOOK_S)]
        for _ in bench.person.doing(Stop(True), "Press the EMERGENCY STOP now."):
            parts.append(bench.sample(io, LOOK_S))
            if not any(parts[-1].drives("amp_on", subject)[-1].any() for subject in arms):
                parts.append(bench.sample(io, LOOK_S))
                break
        window = Window.joined(parts)
        found = [each for subject in arms for each in judge_stop(window, subject)]
        if found:
            return found
        outcome.figures[f"{io} stop_s"] = {subject.name: stop_s(window, subject) for subject in arms}
        for _ in bench.person.doing(Stop(False), "Release the emergency stop."):
            bench.sample(io, LOOK_S)
        after = bench.sample(io, STAYS_S)
        return [each for subject in arms for each in judge_stays_off(after, subject)]
    finally:
        for subject in arms:
            bench.disable(subject)


def _keep_off(arms: Sequence[Subject]) -> str:
    return " Press no clutch of the setup joints, and no button of their column." if any(
        subject.is_setup for subject in arms) else ""


def stop_s(window: Window, subject: Subject) -> float:
    """From the first sample without supply or relay to the first without an amplifier on; NaN if one never occurred."""
    chain = ~(window.flags("powered", subject) & window.flags("relay", subject))
    on = np.flatnonzero(np.any(window.drives("amp_on", subject), axis=1))
    if not chain.any() or (len(on) and on[-1] == len(window) - 1):
        return float("nan")
    off = int(on[-1]) + 1 if len(on) else 0
    return max(0.0, float(window.stamp_s[off] - window.stamp_s[int(chain.argmax())]))


def judge_stop(window: Window, subject: Subject) -> list[Finding]:
    """Effect of the emergency stop."""
    on = window.drives("amp_on", subject)[-1]  # of its actuators, then its brakes
    if on.any():
        axis = int(on.argmax()) % len(subject.robot.actuators)
        return [Finding(subject.where(axis), "its amplifier is still on after the emergency stop",
                        "off", "switch the controllers off. Is the stop wired into the safety chain of these boards?")]
    if window.flags("powered", subject)[-1]:
        return [Finding(subject.whole(), "the motor supply is still good after the emergency stop", "gone",
                        "is the stop wired into the safety chain of these boards?")]
    seconds = stop_s(window, subject)
    if not seconds <= STOP_S:
        return [Finding(subject.whole(), f"its amplifiers went off {seconds:.3f} s after the safety chain",
                        f"{STOP_S:g} s", "have the controllers checked before anything else")]
    return []


def judge_stays_off(window: Window, subject: Subject) -> list[Finding]:
    """After its release, nothing may switch on by itself."""
    on = window.ever_on(subject)
    if not on.any():
        return []
    return [Finding(subject.where(int(on.argmax())), "its amplifier came on by itself", "off until power is requested",
                    "switch the controllers off, and report it with the logs")]


@dataclass(frozen=True, slots=True)
class Silence:
    """Reaction of boards to a silent host: when each cut (s; absent: never), and amplifiers still on."""

    cut_s: dict[int, float]
    still_on: tuple[tuple[int, int], ...]  # board, axis on it from 1


def _watchdog(bench: RunningBench, io: IoConfig, arms: list[Subject], outcome: Outcome) -> list[Finding]:
    if not io.watchdog_s:
        return judge_silence(io, (), Silence({}, ()))
    bench.person.confirm(f"{io.name} is made silent for a moment, with amplifiers on: the boards have to cut them by "
                         f"themselves. Support what may sag.{_keep_off(arms)}", "watchdog")
    numbers = sorted({a.board_id for subject in arms for a in subject.robot.actuators})
    try:
        with BusClient(io.port) as desk:
            boards = [desk.board(number) for number in numbers]
            _enable(bench, arms)
            process = next(each for each in running(bench.system) if each.instance == io.name)
            silence = _silenced(desk, boards, process, io.watchdog_s + SLACK_S)
        outcome.figures[f"{io.name} watchdog_s"] = {str(board): at for board, at in silence.cut_s.items()}
        pause(STAYS_S)  # io restarts meanwhile
        found = judge_silence(io, numbers, silence)
        after = bench.sample(io.name, LOOK_S)
        return found + [each for subject in arms for each in judge_stays_off(after, subject)]
    finally:
        for subject in arms:
            bench.disable(subject)


def _silenced(desk: BusClient, boards: Sequence[FoundBoard], process: RunningProcess, limit_s: float) -> Silence:
    """Stop the io, read its boards, which refreshes no watchdog, and let the io continue in any case."""
    cut: dict[int, float] = {}
    begin_ns = monotonic_ns()
    process.send(STOP)
    try:
        while len(cut) < len(boards) and (monotonic_ns() - begin_ns) * 1e-9 <= limit_s:
            for board in boards:
                if board.board not in cut and desk.read(board.board, registers.STATUS) & registers.STATUS_WATCHDOG:
                    cut[board.board] = (monotonic_ns() - begin_ns) * 1e-9
        still = [(board.board, axis.axis) for board in boards for axis in samples.take(desk, board).axes
                 if axis.amplifier == "on"]
    finally:
        process.send(CONTINUE)
    return Silence(cut, tuple(still))


def judge_silence(io: IoConfig, boards: Sequence[int], silence: Silence) -> list[Finding]:
    """Whether every board has cut its amplifiers in time."""
    if not io.watchdog_s:
        return [Finding(io.name, "its watchdog is switched off (watchdog_timeout 0)", "0.03 s",
                        "remove watchdog_timeout from the system file: the watchdog cuts motors if the computer fails")]
    limit = f"{io.watchdog_s:g} s"
    found = [Finding(f"{io.name}, board {board}", f"its watchdog did not act within {io.watchdog_s + SLACK_S:g} s",
                     limit, "this controller must not drive a robot: have it checked")
             for board in boards if board not in silence.cut_s]
    found += [Finding(f"{io.name}, board {board}", f"its watchdog was not confirmed to act within {at:.2f} s",
                      limit, "this computer may have stalled during the check: try again with nothing else running")
              for board, at in silence.cut_s.items() if at > io.watchdog_s + SLACK_S]
    found += [Finding(f"{io.name}, board {board} axis {axis}", "its amplifier stayed on without a host", "off",
                      "this controller must not drive a robot: have it checked") for board, axis in silence.still_on]
    return found
