"""`trocar demo`: an emulated robot that is powered, homed, and traces a slow circle with its tip."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import numpy as np
import typer

from procs.lib.kinematics import Kinematics
from shm.clock import monotonic_ns
from tools.arms import home, power_off, power_on
from tools.circle import Path, circle
from tools.errors import Problem
from tools.following import Follower, beats
from tools.health import Run
from tools.options import JsonOption
from tools.printing import emit, note, number, progress, table
from tools.processes import lives
from tools.remote import Remote
from tools.supervising import Background, Request
from tools.up import DEMO
from tools.watch import Watch, arm_document

ARM = "PSM1"
NAME = "demo"
CENTRE = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)  # rad and m: straight down, tip well out of the cannula
RADIUS_M = 0.015
TURN_S = 8.0
RATE_HZ = 200.0
RAMP_S = 1.0  # the circle starts and ends slowly
LINE_EVERY = 50
SHORTEST_S = 2.0


def demo(
    seconds: Annotated[float, typer.Option("--for", min=0.0, help="Stop after so many seconds; 0: on Ctrl-C.")] = 0.0,
    as_json: JsonOption = False,
    system: Annotated[str, typer.Option("--system", envvar="TROCAR_SYSTEM", metavar="NAME", help="Its name.")] = NAME,
) -> int:
    """Start an emulated robot, power and home it, trace a slow circle; needs no hardware. Ctrl-C ends it.

    Example: trocar demo --for 20
    """
    begin = monotonic_ns()
    summary: dict[str, Any] = {"state": None, "problems": []}
    with _robot(system) as background:
        try:
            _climb(system, begin)
            summary = _trace(system, begin, seconds)
        except KeyboardInterrupt:
            note("stopped before the circle began")
        except Problem as problem:
            summary["problems"].append(str(problem))
        finally:
            with contextlib.suppress(Problem), progress("power off") as say:
                power_off(system, say=say)
    summary["supervisor_exit"] = background.popen.returncode
    if background.popen.returncode:
        summary["problems"].append(f"the supervisor ended with {background.popen.returncode}")
    emit(summary) if as_json else _show(summary)
    return 1 if summary["problems"] else 0


@contextlib.contextmanager
def _robot(system: str) -> Iterator[Background]:
    """The demo system, up; down again on every path."""
    with progress(f"starting {system}") as say:
        background = Background(Request(DEMO, system, "emulated"), tied=True)
        try:
            background.wait_until_up(say)
        except BaseException:
            background.stop(say)
            raise
    try:
        yield background
    finally:
        with progress(f"stopping {system}") as say:
            background.stop(say)


def _climb(system: str, begin: int) -> None:
    with progress("power on") as say:
        power_on(system, say=say)
        note(f"powered after {_since(begin):.1f} s")
        home(system, say=say)
        note(f"homed after {_since(begin):.1f} s")


def _since(begin: int) -> float:
    return (monotonic_ns() - begin) * 1e-9


def _trace(system: str, begin: int, seconds: float) -> dict[str, Any]:
    """Trace the circle until the time is over or Ctrl-C; returns the summary."""
    arm = arm_document(system, ARM)
    homed_s = _since(begin)
    with contextlib.ExitStack() as stack:
        watch = stack.enter_context(Watch(system, ARM))
        remote = stack.enter_context(Remote(system, ARM))
        if not watch.look():
            raise Problem(_unseen(watch))
        if watch.count != len(CENTRE):
            raise Problem(f"{ARM} has {watch.count} joints; the demo's has an instrument and so {len(CENTRE)}")
        path = circle(Kinematics(arm.chain, arm.tool), np.array(CENTRE), RADIUS_M)
        for goal in (CENTRE, path.joints[0]):
            reply = remote.settled("move_jp", goal, timeout=30.0)
            if reply.outcome != "done":
                raise Problem(f"{ARM}: the move to the circle was {reply.outcome}: {reply.text}")
        run = Run(system, arm.io)
        stack.callback(run.close)
        length = max(SHORTEST_S, seconds - _since(begin)) if seconds else None
        follower = Follower(watch, remote, False)
        skipped = [0]
        with _line() as show:
            try:
                _circles(follower, path, run, watch, length, skipped, show)
            except Problem as problem:  # it goes into the summary
                run.errors.append(str(problem))
        return _summary(run, follower, watch, skipped[0], homed_s)


def _circles(follower: Follower, path: Path, run: Run, watch: Watch, length: float | None, skipped: list[int],
             show: Callable[[str], None]) -> None:
    """Follow the path round and round; `skipped[0]` counts set-points that came too late to be sent."""
    count = None if length is None else round(length * RATE_HZ)
    angle, full = 0.0, 2 * np.pi / TURN_S
    try:
        for k in beats(RATE_HZ, count, skipped):
            left = np.inf if count is None else (count - k) / RATE_HZ
            rate = full * min(1.0, k / RATE_HZ / RAMP_S, left / RAMP_S)
            angle += rate / RATE_HZ
            follower.collect()
            follower.send(*path.at(angle, rate), None)
            run.collect()
            if k % LINE_EVERY == 0:
                show(_status(run, watch))
    except KeyboardInterrupt:
        pass
    finally:
        follower.hold()


def _status(run: Run, watch: Watch) -> str:
    life = next((life for life in lives(run.system) if life.kind == "io"), None)
    if not watch.look():
        return _unseen(watch)
    tip = watch.reader.field("local_measured_cp")[:3] * 1e3
    rate, missed = (life.rate_hz, life.missed) if life is not None else (None, 0)
    return (f"{ARM} {watch.state} ({watch.text('sub_state')})  io {number(rate, '.0f')} Hz, {missed} missed  "
            f"tip {tip[0]:+7.2f} {tip[1]:+7.2f} {tip[2]:+8.2f} mm")


def _unseen(watch: Watch) -> str:
    return f"{watch.name}: its state cannot be read: {watch.trouble() or 'it has shown none'}"


@contextlib.contextmanager
def _line() -> Iterator[Callable[[str], None]]:
    """One line that is written over again and again; nothing where there is no terminal."""
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    try:
        yield lambda text: print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    finally:
        print(file=sys.stderr)


def _summary(run: Run, follower: Follower, watch: Watch, skipped: int, homed_s: float) -> dict[str, Any]:
    summary = run.summary()
    tracking, seen = follower.tracking, watch.look()
    if not seen:
        summary["problems"].append(_unseen(watch))
    elif watch.state != "ENABLED" or not watch.homed:
        summary["problems"].append(f"{ARM} ended in {watch.state} ({watch.text('sub_state')})")
    if follower.refused:
        summary["problems"].append(f"{ARM} refused {follower.refused} commands: {follower.refusal}")
    return {
        "state": watch.state if seen else None, "is_homed": seen and watch.homed, "homed_after_s": homed_s,
        "setpoints_skipped": skipped, "names": list(tracking.names), "rms": tracking.rms.tolist(),
        "max": tracking.most.tolist(), **summary,
    }


def _show(summary: dict[str, Any]) -> None:
    if "processes" in summary:
        figures = [
            (name, *(number(summary[f"{key}_{part}"]) for part in ("p50", "p99", "max")))
            for name, key in (("io period µs", "io_period_us"), ("io read → write µs", "read_to_write_us"))
        ]
        table("io", ("figure", "p50", "p99", "max"), figures, ("p50", "p99", "max"))
        rows = [(p["name"], number(p["rate_hz"]), str(p["cycles"]), str(p["missed"]), str(p["overruns"]),
                 str(p["restarts"])) for p in summary["processes"]]
        table("processes, during the circle", ("process", "Hz", "cycles", "missed", "overruns", "restarts"), rows,
              ("Hz", "cycles", "missed", "overruns", "restarts"))
        joints = zip(summary["names"], summary["rms"], summary["max"], strict=True)
        table("tracking error", ("joint", "RMS mrad|mm", "largest"),
              [(name, number(rms * 1e3, ".3f"), number(most * 1e3, ".3f")) for name, rms, most in joints],
              ("RMS mrad|mm", "largest"))
    for problem in summary["problems"]:
        print(f"PROBLEM: {problem}")
    if "processes" in summary and not summary["problems"]:
        print("everything stayed healthy")
