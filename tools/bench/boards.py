"""`trocar bench boards`: the CPU time that emulated boards take for one cycle of their host.

Whole systems in this process (procs/host): five PSMs on ten boards, one on two, four on eight. Their io sends a
broadcast query, a hub read and a broadcast write at 1500 Hz, with the physics steps at 1 kHz that fall into it, all
amplifiers on and the arms moving. `ratio_10_vs_2` is formed of turns side by side. Eight boards do so with the native
library (keys that end in _8) and without (_8_numpy). Between two datagrams io and arms use the caches, as they do in
real time.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable
from statistics import median
from time import thread_time_ns
from typing import Any, Final

import numpy as np

from trocar.procs.fpga import wire
from trocar.procs.host.loops import HostedBoards
from trocar.procs.native.library import native
from trocar.tools.bench.children import Figure, Percentiles, Report, Turns
from trocar.tools.bench.host_run import PSMS, HostRun
from trocar.tools.bench.measuring import without_native
from trocar.tools.output.printing import progress

ROUNDS, TURN_S = 5, 1.0
SIZES: Final = {10: 5, 2: 1, 8: 4}  # PSMs by number of boards
NUMPY: Final = -8  # eight boards without the native library
SETS: Final = ("clock=lockstep", "io.period_s=0.000666667", "arm.period_s=0.005", "emulation.period_s=0.001")
CYCLES: Final = 3  # of a window: a physics step falls into two of them
PARTS: Final = {wire.QUADLET_WRITE: "query", wire.BLOCK_READ: "read", wire.BLOCK_WRITE: "write"}
WHOLE: Final = "10 whole"

FIGURES: dict[str, Figure] = {
    "cycle_cpu_us_p50": (WHOLE, "p50", 1e3),
    "cycle_cpu_us_p10": (WHOLE, "p10", 1e3),
    "cycle_cpu_us_p99": (WHOLE, "p99", 1e3),
    "cycle_cpu_us_p50_2": ("2 whole", "p50", 1e3),
    "cycle_cpu_us_p99_2": ("2 whole", "p99", 1e3),
    "physics_us_p50": ("10 physics", "p50", 1e3),
    "answering_us_p50": ("10 answering", "p50", 1e3),
    "query_us_p50": ("10 query", "p50", 1e3),
    "hub_read_us_p50": ("10 read", "p50", 1e3),
    "write_us_p50": ("10 write", "p50", 1e3),
    "state_record_us_p50": ("10 record", "p50", 1e3),
    "physics_us_p50_2": ("2 physics", "p50", 1e3),
    "answering_us_p50_2": ("2 answering", "p50", 1e3),
}
OF_EIGHT = (("cycle_cpu_us_p50", "whole", "p50"), ("cycle_cpu_us_p99", "whole", "p99"),
            ("physics_us_p50", "physics", "p50"), ("answering_us_p50", "answering", "p50"))
COMPARED: dict[str, Figure] = {
    f"{key}_8{suffix}": (f"{boards} {what}", percentile, 1e3)
    for boards, suffix in ((8, ""), (NUMPY, "_numpy")) for key, what, percentile in OF_EIGHT
}
"""Eight boards with the native library and without."""


class TimedBoards:
    """A system with homed arms, whose boards' work is timed."""

    def __init__(self, run: HostRun) -> None:
        """From now on the calls of its boards take the time of reading the clock longer."""
        self._run = run
        boards = run.host.loops["boards"]
        assert isinstance(boards, HostedBoards)
        world = boards.world
        self._used = dict.fromkeys((*PARTS.values(), "physics", "record"), 0)
        self._inner = self._count = 0
        self._windows: dict[str, list[int]] = {}
        begin = thread_time_ns()
        self._clock = thread_time_ns() - begin
        answers = {tcode: self._timed(part, world.answer) for tcode, part in PARTS.items()}
        other = world.answer

        def answer(bus: int, data: wire.Buffer, *where: int) -> Any:
            tcode = data[wire.TCODE_AT] >> 4
            if tcode == wire.QUADLET_WRITE:
                self._close_cycle()
            return answers.get(tcode, other)(bus, data, *where)

        world.answer = answer  # type: ignore[method-assign, assignment]  # timed
        world.step = self._timed("physics", world.step)  # type: ignore[method-assign]  # timed
        world.on_step = self._timed("record", world.on_step)

    def _timed(self, part: str, what: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, its own time (without that of timed calls in it, and of reading the clock) counted."""

        def call(*arguments: Any) -> Any:
            begin, before = thread_time_ns(), self._inner
            found = what(*arguments)
            spent = thread_time_ns() - begin
            self._used[part] += spent - (self._inner - before) - self._clock
            self._inner = before + spent
            return found

        return call

    def _close_cycle(self) -> None:
        self._count = (self._count + 1) % CYCLES
        if self._count:
            return
        used = self._used
        answering = sum(used[part] for part in PARTS.values())
        for name, ns in {**used, "answering": answering, "whole": answering + used["physics"]}.items():
            self._windows.setdefault(name, []).append(ns)
        self._used.update(dict.fromkeys(used, 0))

    def turn(self, seconds: float) -> Report:
        """The system works for this long, of its own time; percentiles of the boards' work, ns a cycle."""
        self._windows.clear()
        gc.disable()
        try:
            self._run.play(seconds)
        finally:
            gc.enable()
        return {name: summary(windows) for name, windows in self._windows.items()}


def summary(windows: list[int]) -> Percentiles:
    """Percentiles of the mean times of a cycle in each window, ns."""
    values = np.rint(np.percentile(windows, (10, 50, 99)) / CYCLES).astype(int).tolist()
    return dict(zip(("p10", "p50", "p99"), values, strict=True)) | {"n": len(windows)}


def run(rounds: int = ROUNDS, turn_s: float = TURN_S) -> dict[str, Any]:
    """Measure."""
    found = Turns()
    with contextlib.ExitStack() as stack, progress("bench boards") as say:
        say("homing", None)
        runs = {boards: _homed(stack, boards) for boards in SIZES}
        if native().library is not None:
            with without_native():
                runs[NUMPY] = _homed(stack, NUMPY)

        def turn(boards: int) -> Report:
            reported = runs[boards].turn(turn_s)
            found.keep(reported, f"{boards} ")
            return reported

        before = turn(2)
        for i in range(rounds):
            say(f"round {i + 1} of {rounds}", i / rounds)
            ten, after, eight = turn(10), turn(2), turn(8)
            found.keep_ratios("ratio_10_vs_2", *((ten["whole"], two["whole"]) for two in (before, after)))
            if NUMPY in runs:
                found.keep_ratios("native_ratio", (turn(NUMPY)["whole"], eight["whole"]))
            before = after
        compared = {key: row for key, row in COMPARED.items() if NUMPY in runs or not key.endswith("_numpy")}
    figures = found.figures(FIGURES | compared)
    conditions = {
        "boards": "10 (5 PSMs, 35 axes) and 2 (1 PSM, 7 axes); 8 (4 PSMs, 28 axes)",
        "state": "amplifiers on, every arm swinging", "sets": list(SETS),
        "turns": f"{rounds} rounds of turns of {turn_s:g} s of the system's time",
        "cycle": "broadcast query, hub read, broadcast write; means of 3 cycles, with 2 physics steps",
        "cycle_cpu_us_p50_of_turns": "{:.1f} to {:.1f}".format(*found.span(WHOLE)),
        "not counted": "state record (state_record_us), sockets, waking up and pacing of the process",
        "clock": "CPU time of this thread",
    }
    return {"figures": figures | {name: median(ratios) for name, ratios in found.ratios.items()},
            "conditions": conditions}


def _homed(stack: contextlib.ExitStack, boards: int) -> TimedBoards:
    return TimedBoards(stack.enter_context(HostRun(f"{SIZES[abs(boards)]}{PSMS}", SETS)))
