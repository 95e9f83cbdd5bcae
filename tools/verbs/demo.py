"""`trocar demo`: a surgeon's hand on emulated boards draws an eight on a master, and a PSM follows it.

Its time is paced unless another clock is asked for: a busy machine makes it slower and breaks nothing.
"""

from __future__ import annotations

import contextlib
import math
from typing import Annotated, Any

import typer

from trocar.procs.machine.extras import missing
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.machine.verb_lines import default_system
from trocar.procs.tables.bring_up import DISABLED, ENABLED, HOMED
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import WALL, SystemTime, speed_in_words
from trocar.tools.client.bring_up import bring_all
from trocar.tools.client.following import beats
from trocar.tools.examples.hand import Hand, figure_eight
from trocar.tools.examples.operator_sim import OperatorSim, SimTeleop
from trocar.tools.inspect.health import HealthWatch
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.standing import first_thing, standings
from trocar.tools.inspect.tracing import Trace
from trocar.tools.inspect.watch import arm_document
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import LiveLine, emit, note, number, progress, table, tell
from trocar.tools.systems.supervising import START_S, StartRequest, up_meanwhile
from trocar.tools.systems.web_address import web_addresses
from trocar.tools.verbs.options import ClockOption, JsonOption, SetOption, clock_set

SYSTEM = PROJECT_CONFIGS / "systems" / "demo-teleop.yaml"
NAME = "demo"
SIZE_M = 0.04
TURN_S = 8.0
RATE_HZ = 100.0  # poses of the hand
RAMP_S = 1.0  # the drawing starts slowly
LINE_EVERY = 50
SLOWEST, AROUND_S = 20.0, 60.0  # real time: so many times what was asked for, and for all else
# What is good: well within what a surgeon's hand notices, and far from what a loop with a fault in it shows.
# Latencies: 4 and 10 periods of the system's loops.
MOST = {"error_mm_rms": 2.0, "error_deg_rms": 3.0, "latency_ms_p50": 8.0, "latency_ms_p99": 20.0}
STOPPED = "the system was stopped"
UNITS = {"mm": "mm", "deg": "°", "ms": "ms"}


def demo(
    seconds: Annotated[float, typer.Option(
        "--for", min=0.0, help="Length of the following, in seconds of the system's time; 0: until Ctrl-C.")] = 0.0,
    clock: ClockOption = "",
    listen: Annotated[str, typer.Option(
        "--listen", metavar="ADDRESS", help="Address of the web console, e.g. 0.0.0.0:8080; browsers on other machines "
        "need the token that is printed.")] = "",
    sets: SetOption = None,
    as_json: JsonOption = False,
    system: Annotated[str, typer.Option("--system", envvar="TROCAR_SYSTEM", metavar="NAME",
                                          help="System name.")] = default_system(NAME),
) -> int:
    """Start emulated boards, home a master and a PSM, and let an emulated hand move the master: the PSM follows. No
    hardware is needed; Ctrl-C ends it. The web console, if installed, shows the arms; its address is printed. After a
    fault, run trocar home, then trocar send console teleop_enable 1; until then the emulated hand does not touch the
    master.

    --for counts seconds of the system's time, by default simulated time, so the demo takes longer on a busy machine.
    It gives up after 1 minute + 20 × --for of real time (with --for 0: never). Exit code 1: it gave up, an error
    occurred, a process crashed, or the PSM did not follow. With --clock wall, latencies that are too long are
    printed, but do not change the exit code.

    Example: trocar demo --for 10
    """
    values = (*(sets or ()), *clock_set(clock))
    begin = monotonic_ns()
    end = begin + round((SLOWEST * seconds + AROUND_S) * 1e9) if seconds else None
    summary: dict[str, Any] = {"problems": []}
    lacks = missing("starlette")
    if lacks and listen:
        raise Problem(lacks)
    console = () if lacks else (f"gui.listen={listen}" if listen else "gui={}",)  # without an address: a free one
    with up_meanwhile(StartRequest(SYSTEM, system, "emulated", sets=(*console, *values)),
                      _left_s(end) or START_S) as background:
        try:
            if lacks or (links := web_addresses(system)):
                note(lacks or f"view and control it: {', '.join(links)}")
            _bring_up(system, begin, end)
            summary = _operate(system, begin, seconds, end)
        except KeyboardInterrupt:
            note("stopped before the motion began")
        except (Problem, SegmentError) as problem:
            summary["problems"].append(f"{problem}. The demo ends and its system is stopped")
        finally:
            if background.state() == "RUNNING":  # not of the next system of this name
                with contextlib.suppress(Problem, SegmentError), progress("power off") as say:
                    bring_all(system, (), DISABLED, say=say)
            else:  # all else that was seen may be of the next one
                summary["problems"] = [STOPPED]
    summary["supervisor_exit"] = background.popen.returncode
    if background.popen.returncode:
        summary["problems"].append(f"the supervisor ended with {background.popen.returncode}")
    emit(summary) if as_json else _show(summary)
    return 1 if summary["problems"] else 0


def _bring_up(system: str, begin: int, end: int | None) -> None:
    with progress("power-on") as say:
        bring_all(system, (), ENABLED, _left_s(end), say)
        note(f"powered after {_since(begin):.1f} s")
    with progress("homing") as say:
        bring_all(system, (), HOMED, _left_s(end), say)
        note(f"homed after {_since(begin):.1f} s")


def _left_s(end: int | None) -> float:
    """Real time that is left; 0: as usual."""
    return 0.0 if end is None else max(1.0, (end - monotonic_ns()) * 1e-9)


def _since(begin: int) -> float:
    return (monotonic_ns() - begin) * 1e-9


def _operate(system: str, begin: int, seconds: float, end: int | None) -> dict[str, Any]:
    """Follow until the time is over or Ctrl-C; returns the summary."""
    homed_s = _since(begin)
    with contextlib.ExitStack() as stack:
        time = stack.enter_context(SystemTime(system))
        seat = stack.enter_context(OperatorSim(system, "console"))
        teleop = seat.teleops[0]
        hand = stack.enter_context(Hand(system, seat, teleop))
        hand.begin()
        note(f"following after {_since(begin):.1f} s")
        io = arm_document(system, teleop.slave).io
        run, trace = HealthWatch(system, io), Trace(system, teleop.name, teleop.slave, io)
        stack.callback(run.close)
        stack.callback(trace.close)
        skipped, drawing, drawing_ns = [0], monotonic_ns(), time.now_ns()
        with contextlib.closing(LiveLine()) as line:
            try:
                _draw(hand, teleop, (run, trace), seconds, skipped, time, end, line)
            except Problem as problem:  # it goes into the summary
                run.errors[str(problem)] = ""
        speed = (time.now_ns() - drawing_ns) * 1e-9 / _since(drawing)
        reported = "" if teleop.is_following else teleop.reported
        around = {"clock": time.clock, "speed": speed, "homed_after_s": homed_s, "hand_skipped": skipped[0]}
        return {**around, **judged({**trace.figures(), **run.summary()}, reported, time.simulated)}


def _draw(hand: Hand, teleop: SimTeleop, watched: tuple[HealthWatch, Trace], seconds: float, skipped: list[int],
          time: SystemTime, end: int | None, line: LiveLine) -> None:
    """Draw eights for so long (0: until Ctrl-C); `skipped[0]` counts poses that came too late. Problem at `end`.

    What is let go of meanwhile is drawn anew from where it is taken again.
    """
    run, trace = watched
    taken = 0
    count, reported = round(seconds * RATE_HZ) if seconds else None, ""
    with contextlib.suppress(KeyboardInterrupt):
        for k in beats(RATE_HZ, count, skipped, time=time):
            if end is not None and monotonic_ns() >= end:
                trace.collect()
                raise Problem(f"ended after {k / RATE_HZ:.1f} of {seconds:g} s: this machine is busy "
                              f"({speed_in_words(time)})")
            if hand.holds():
                passed_s = (k - taken) / RATE_HZ
                size = SIZE_M * min(1.0, passed_s / RAMP_S)
                hand.draw(figure_eight(2.0 * math.pi * passed_s / TURN_S, size))
            else:
                taken = k
            run.collect()
            if k % LINE_EVERY == 0:
                trace.collect()
                so_far = f"{k / RATE_HZ:.0f} s" + (f" of {seconds:g} s" if seconds else "")
                parts, cause = _state(run.system, teleop, time)
                if cause and cause != reported:
                    line.report(cause)
                reported = cause
                line.show([so_far, *parts])
    trace.collect()


def _state(system: str, teleop: SimTeleop, time: SystemTime) -> tuple[list[str], str]:
    """What a line shows, the most important first; and in a sentence what is in FAULT, or else why no arm follows."""
    processes = statuses(system)
    found = standings(system, processes)
    faults = [one.name for one in found if one.is_fault]
    io = next((process for process in processes if process.kind == "io"), None)
    rate, missed = (io.rate_hz, io.missed) if io is not None else (None, 0)
    goal = " ".join(f"{x * 1e3:+7.2f}" for x in teleop.value("goal_cp")[:3] if x is not None)
    parts = [f"FAULT: {' '.join(faults)}"] if faults else []
    parts += [f"{teleop.slave} follows {teleop.masters[0]}"] if teleop.is_following else [teleop.shown_state]
    parts += [f"io {number(rate, '.0f')} Hz, {missed} missed", f"goal {goal} mm"]
    parts += [f"{time.clock} {time.speed:.2f}"] if time.simulated else []
    return parts, first_thing(processes, found) if faults else "" if teleop.is_following else teleop.reported


def judged(summary: dict[str, Any], reported: str, simulated: bool) -> dict[str, Any]:
    """The summary with `problems`: errors, dead processes, a slave that does not follow in the end (`reported`).

    `late`: figures that are not good. In simulated time, which a busy machine does not change, they are problems.
    """
    late = [*summary["late"], *too_much(summary)]
    problems = [*summary["problems"], *([reported] if reported else []), *(late if simulated else [])]
    return {**summary, "following": not reported, "problems": problems, "late": [] if simulated else late}


def too_much(figures: dict[str, float]) -> list[str]:
    """Which figures are not good, in words; what was not measured is not."""
    printed = []
    for name, most in MOST.items():
        what, unit, which = name.split("_")
        if not figures[name] <= most:
            meaning = f"following {what}" if what == "error" else what
            printed.append(f"{meaning} ({which}) {number(figures[name], '.2f')} {UNITS[unit]}, allowed {most:g}")
    return printed


def _show(summary: dict[str, Any]) -> None:
    if "processes" in summary:
        rows = [("following error mm", number(summary["error_mm_rms"], ".2f"), number(summary["error_mm_max"], ".2f")),
                ("following error °", number(summary["error_deg_rms"], ".2f"), number(summary["error_deg_max"], ".2f"))]
        table("PSM1 against the goals of the teleoperation", ("figure", "RMS", "largest"), rows, ("RMS", "largest"))
        late = ("master → slave ms", *(number(summary[f"latency_ms_{part}"], ".2f") for part in ("p50", "p99")), "–")
        figures = [late] + [
            (name, *(number(summary[f"{key}_{part}"]) for part in ("p50", "p99", "max")))
            for name, key in (("io period µs", "io_period_us"), ("io read → write µs", "read_to_write_us"))
        ]
        simulated = "" if summary["clock"] == WALL else (
            f", simulated: {summary['clock']}, {summary['speed']:.2f} of real time; they are not this machine's")
        table(f"time{simulated}", ("figure", "p50", "p99", "max"), figures, ("p50", "p99", "max"))
        processes = [(p["name"], number(p["rate_hz"]), str(p["cycles"]), str(p["missed"]), str(p["overruns"]),
                      str(p["restarts"])) for p in summary["processes"]]
        table("processes, while following", ("process", "Hz", "cycles", "missed", "overruns", "restarts"), processes,
              ("Hz", "cycles", "missed", "overruns", "restarts"))
    late = summary.get("late", [])
    for text in (*(f"PROBLEM: {problem}" for problem in summary["problems"]), *(f"LATE: {text}" for text in late)):
        tell(text)
    if "processes" in summary and not summary["problems"]:
        tell(f"everything stayed healthy{'; this machine was too busy for real time' if late else ''}")
