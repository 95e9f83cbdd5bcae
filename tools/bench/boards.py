"""`trocar bench boards`: the CPU time that emulated boards take for one cycle of their host.

A cycle is a broadcast query, a hub read and a broadcast write at 1500 Hz, with the physics steps at 1 kHz that fall
into it, all amplifiers on and the arms moving. Ten boards (five PSMs) and two boards (one PSM) take turns on the same
machine; `ratio_10_vs_2` is formed of turns side by side. Eight boards do so with the native library (keys that end in
_8) and without (_8_numpy). `procs/boards/cost.py` measures, in a process for each.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig, to_json
from trocar.procs.native.library import SWITCH, native
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import BOARDS_STATE
from trocar.tools.bench.children import Figure, Report, Team, Turns
from trocar.tools.bench.io_loop import write_system
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import progress
from trocar.tools.systems.cleanup import own_folder

ROUNDS, TURN_S = 9, 0.8
PSMS = {10: 5, 2: 1, 8: 4}  # by number of boards
NUMPY = -8  # eight boards without the native library
COUNTER = itertools.count()

WHOLE = "10 whole"

FIGURES: dict[str, Figure] = {
    "cycle_cpu_us_p50": (WHOLE, "p50", 1e3),
    "cycle_cpu_us_p10": (WHOLE, "p10", 1e3),
    "cycle_cpu_us_p99": (WHOLE, "p99", 1e3),
    "cycle_cpu_us_p50_paused": ("10 paused", "p50", 1e3),
    "cycle_cpu_us_p50_sockets": ("10 sockets", "p50", 1e3),
    "cycle_cpu_us_p99_sockets": ("10 sockets", "p99", 1e3),
    "cycle_cpu_us_p50_2": ("2 whole", "p50", 1e3),
    "cycle_cpu_us_p99_2": ("2 whole", "p99", 1e3),
    "cycle_cpu_us_p50_2_sockets": ("2 sockets", "p50", 1e3),
    "physics_us_p50": ("10 physics", "p50", 1e3),
    "answering_us_p50": ("10 answering", "p50", 1e3),
    "query_us_p50": ("10 query", "p50", 1e3),
    "hub_read_us_p50": ("10 read", "p50", 1e3),
    "write_us_p50": ("10 write", "p50", 1e3),
    "state_record_us_p50": ("10 record", "p50", 1e3),
    "physics_us_p50_2": ("2 physics", "p50", 1e3),
    "answering_us_p50_2": ("2 answering", "p50", 1e3),
}
OF_EIGHT = (
    ("cycle_cpu_us_p50", "whole", "p50"), ("cycle_cpu_us_p99", "whole", "p99"),
    ("cycle_cpu_us_p50_paused", "paused", "p50"), ("physics_us_p50", "physics", "p50"),
    ("answering_us_p50", "answering", "p50"),
)
COMPARED: dict[str, Figure] = {
    f"{key}_8{suffix}": (f"{boards} {what}", percentile, 1e3)
    for boards, suffix in ((8, ""), (NUMPY, "_numpy")) for key, what, percentile in OF_EIGHT
}
"""Eight boards with the native library and without."""
KINDS = {
    "cycle": "broadcast query, hub read, broadcast write; windows of 3 cycles with 2 physics steps, mean of a cycle",
    "paused": "after a pause of 2 ms each window, as in real time; the others one after the other",
    "sockets": "with the server's waiting, receiving and sending on loopback",
    "not counted": "state record (state_record_us), waking up and pacing of the process",
}


def run(rounds: int = ROUNDS, turn_s: float = TURN_S) -> dict[str, Any]:
    """Measure."""
    found = Turns()
    with contextlib.ExitStack() as stack, progress("bench boards") as say:
        say("starting", None)
        which = (*PSMS, NUMPY) if native().library is not None else tuple(PSMS)
        teams = {boards: stack.enter_context(_team(boards)) for boards in which}
        for team in teams.values():
            team.wait()

        def turn(boards: int) -> Report:
            reported = teams[boards].measure(turn_s)
            found.keep(reported, f"{boards} ")
            return reported

        before = turn(2)
        for i in range(rounds):
            say(f"round {i + 1} of {rounds}", i / rounds)
            ten, after, eight = turn(10), turn(2), turn(8)
            found.keep_ratios("ratio_10_vs_2", *((ten["whole"], two["whole"]) for two in (before, after)))
            if NUMPY in teams:
                found.keep_ratios("native_ratio", (turn(NUMPY)["paused"], eight["paused"]))
            before = after
    compared = {key: row for key, row in COMPARED.items() if NUMPY in teams or not key.endswith("_numpy")}
    figures = found.figures(FIGURES | compared)
    conditions = {
        "boards": "10 (5 PSMs, 35 axes) and 2 (1 PSM, 7 axes); 8 (4 PSMs, 28 axes)",
        "state": "amplifiers on, every arm swinging",
        "turns": f"{rounds} rounds of turns of {turn_s:g} s",
        "cycle_cpu_us_p50_of_turns": "{:.1f} to {:.1f}".format(*found.span(WHOLE)), **KINDS,
        "clock": "CPU time of the thread that serves",
    }
    return {"figures": figures | {name: median(ratios) for name, ratios in found.ratios.items()},
            "conditions": conditions}


@contextlib.contextmanager
def _team(boards: int) -> Iterator[Team]:
    """The process that measures this many boards; its files are removed at the end."""
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
