"""`trocar bench boards`: the CPU time that emulated boards take for one cycle of their host.

A cycle is a broadcast query, a hub read and a broadcast write at 1500 Hz, with the physics steps at 1 kHz that fall
into it, all amplifiers on and the arms moving. Ten boards (five PSMs) and two boards (one PSM) take turns on the same
machine; `ratio_10_vs_2` is formed of turns side by side. Eight boards do so with the compiled kernel (keys that end in
_8) and without (_8_numpy). `procs/boards/cost.py` measures, in a process for each.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import psutil

from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig, to_json
from trocar.procs.native.library import SWITCH, kernel
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import BOARDS_STATE
from trocar.tools.bench.children import Team
from trocar.tools.bench.io_loop import write_system
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import progress
from trocar.tools.systems.cleanup import own_folder

ROUNDS, TURN_S = 9, 0.8
PSMS = {10: 5, 2: 1, 8: 4}  # by number of boards
NUMPY = -8  # eight boards without the kernel
COUNTER = itertools.count()

# figure: boards, what was measured, its percentile
FIGURES = {
    "cycle_cpu_us_p50": (10, "whole", "p50"),
    "cycle_cpu_us_p10": (10, "whole", "p10"),
    "cycle_cpu_us_p99": (10, "whole", "p99"),
    "cycle_cpu_us_p50_paused": (10, "paused", "p50"),
    "cycle_cpu_us_p50_sockets": (10, "sockets", "p50"),
    "cycle_cpu_us_p99_sockets": (10, "sockets", "p99"),
    "cycle_cpu_us_p50_2": (2, "whole", "p50"),
    "cycle_cpu_us_p99_2": (2, "whole", "p99"),
    "cycle_cpu_us_p50_2_sockets": (2, "sockets", "p50"),
    "physics_us_p50": (10, "physics", "p50"),
    "answering_us_p50": (10, "answering", "p50"),
    "query_us_p50": (10, "query", "p50"),
    "hub_read_us_p50": (10, "read", "p50"),
    "write_us_p50": (10, "write", "p50"),
    "state_record_us_p50": (10, "record", "p50"),
    "physics_us_p50_2": (2, "physics", "p50"),
    "answering_us_p50_2": (2, "answering", "p50"),
}
# The same with 8 boards, with and without the kernel.
COMPARED = {
    "cycle_cpu_us_p50_8": ("whole", "p50"),
    "cycle_cpu_us_p99_8": ("whole", "p99"),
    "cycle_cpu_us_p50_paused_8": ("paused", "p50"),
    "physics_us_p50_8": ("physics", "p50"),
    "answering_us_p50_8": ("answering", "p50"),
}
KINDS = {
    "cycle": "broadcast query, hub read, broadcast write; windows of 3 cycles with 2 physics steps, mean of a cycle",
    "paused": "after a pause of 2 ms each window, as in real time; the others one after the other",
    "sockets": "with the server's waiting, receiving and sending on loopback",
    "not counted": "state record (state_record_us), waking up and pacing of the process",
}

BoardsReport = dict[str, dict[str, int]]


@dataclass
class BoardsResult:
    """What the turns gave, by number of boards."""

    turns: dict[int, list[BoardsReport]] = field(default_factory=lambda: {10: [], 2: []})
    ratios: list[float] = field(default_factory=list)
    kernel_ratios: list[float] = field(default_factory=list)

    def keep_round(self, before: BoardsReport, ten: BoardsReport, after: BoardsReport) -> None:
        """A turn of ten boards between two turns of two; `after` is the `before` of the next."""
        if not self.turns[2]:
            self.turns[2].append(before)
        self.turns[10].append(ten)
        self.turns[2].append(after)
        self.ratios += [ten["whole"]["p50"] / two["whole"]["p50"] for two in (before, after)]

    def keep_eight(self, quick: BoardsReport, slow: BoardsReport | None) -> None:
        """Turns of eight boards with the kernel and without."""
        self.turns.setdefault(8, []).append(quick)
        if slow is not None:
            self.turns.setdefault(NUMPY, []).append(slow)
            self.kernel_ratios.append(slow["paused"]["p50"] / quick["paused"]["p50"])

    def figures(self) -> dict[str, float]:
        """All figures, flat: medians over the turns."""
        found = {key: median(turn[what][percentile] for turn in self.turns[boards]) / 1e3
                 for key, (boards, what, percentile) in FIGURES.items()}
        for boards, suffix in ((8, ""), (NUMPY, "_numpy")):
            if boards in self.turns:
                found |= {key + suffix: median(turn[what][percentile] for turn in self.turns[boards]) / 1e3
                          for key, (what, percentile) in COMPARED.items()}
        if self.kernel_ratios:
            found["kernel_ratio"] = median(self.kernel_ratios)
        return {**found, "ratio_10_vs_2": median(self.ratios)}

    def span(self) -> str:
        """The quickest and the slowest turn: far apart when somebody else was at work, too."""
        medians = [turn["whole"]["p50"] / 1e3 for turn in self.turns[10]]
        return f"{min(medians):.1f} to {max(medians):.1f}"


def run(rounds: int = ROUNDS, turn_s: float = TURN_S) -> dict[str, Any]:
    """Measure; one object with `bench`, `figures` and `conditions`."""
    found = BoardsResult()
    with contextlib.ExitStack() as stack, progress("bench boards") as say:
        say("starting", None)
        which = (*PSMS, NUMPY) if kernel().library is not None else tuple(PSMS)
        teams = {boards: stack.enter_context(_team(boards)) for boards in which}
        for team in teams.values():
            team.wait()
        before = teams[2].measure(turn_s)
        for i in range(rounds):
            say(f"round {i + 1} of {rounds}", i / rounds)
            ten, after = teams[10].measure(turn_s), teams[2].measure(turn_s)
            found.keep_round(before, ten, after)
            found.keep_eight(teams[8].measure(turn_s), teams[NUMPY].measure(turn_s) if NUMPY in teams else None)
            before = after
    conditions = {
        "computed_by": "the kernel" if kernel().library is not None else f"numpy: {kernel().why}",
        "boards": "10 (5 PSMs, 35 axes) and 2 (1 PSM, 7 axes); 8 (4 PSMs, 28 axes)",
        "state": "amplifiers on, every arm swinging",
        "turns": f"{rounds} rounds of turns of {turn_s:g} s", "cycle_cpu_us_p50_of_turns": found.span(), **KINDS,
        "clock": "CPU time of the thread that serves", "cores": len(psutil.Process().cpu_affinity() or []),
        "kernel": platform.release(), "python": platform.python_version(), "numpy": np.__version__,
    }
    return {"bench": "boards", "figures": found.figures(), "conditions": conditions}


@contextlib.contextmanager
def _team(boards: int) -> Iterator[Team]:
    """The process that measures so many boards; what is made for it is gone at the end."""
    environment = ("env", f"{SWITCH}=0") if boards == NUMPY else ()
    boards = abs(boards)
    name = f"bench{os.getpid()}-{next(COUNTER)}"
    with own_folder(name) as folder:
        system = _system(folder, boards, name)
        document = folder / "document.json"
        document.write_bytes(to_json(system))
        sizes = {"axes": sum(len(robot.actuators) for io in system.ios for robot in io.robots), "boards": boards}
        command = [*environment, sys.executable, "-m", "trocar.procs.boards.cost", name, str(document)]
        create_ring(name, "boards", BOARDS_STATE, sizes, {})
        with Team("boards", {f"{boards} boards": command}) as team:
            yield team


def _system(folder: Path, boards: int, name: str) -> SystemConfig:
    loaded = load_system(write_system(folder, PSMS[boards]), boards="emulated", name=name)
    if loaded.errors or loaded.system is None:
        raise Problem(f"bench boards: {'; '.join(str(error) for error in loaded.errors)}")
    return loaded.system
