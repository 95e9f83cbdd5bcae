"""The children of a bench: started once, each on its core, asleep until ordered to measure for some seconds.

`python -m trocar.tools.bench.children MODULE ROLE WORD... CORE` is a child: the role is one of `ROLES` of a module in
tools/bench, which gets the words. A child prints `{}` when it is ready. Then, for each line `seconds` it reads, it
measures and prints one line: for every measurement its percentiles in ns. Long-lived children make it cheap to measure
many things in turn, which is necessary on a machine whose cores are near each other in one second and far apart in the
next.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import resource
import select
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from time import monotonic_ns
from typing import IO

import psutil

from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.closable import Closable
from trocar.shm.time.clock import pause
from trocar.tools.output.errors import Problem

PATIENCE_S = 30.0  # with a line
FAREWELL_S = 3.0
LOOK_S = 0.2
CPU_S = 120  # of a child in all: one that polls for a crashed partner ends
WARM_UP = 200  # first times of each turn, not counted
KEPT = 1_000_000  # times a child keeps

Times = Mapping[str, list[int]]
Turn = Callable[[float], Times]
Percentiles = Mapping[str, int]
Report = Mapping[str, Percentiles]
Figure = tuple[str, str, float]
"""Measurement, its percentile, number of ns in the unit."""


def summary(times: list[int]) -> dict[str, int]:
    """Percentiles of some times; a short list is taken whole."""
    counted = sorted(times[WARM_UP:] if len(times) > WARM_UP else times)
    if not counted:
        raise Problem("nothing was measured: the turn was too short")
    count = len(counted)
    return {"p50": counted[count // 2], "p99": counted[count * 99 // 100], "n": count}


def pin(core: int) -> None:
    """To this core, without the garbage collector, and with a CPU time limit."""
    psutil.Process().cpu_affinity([core])
    gc.disable()
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    if hard == resource.RLIM_INFINITY or hard > CPU_S:
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))


def serve(turn: Turn) -> None:
    """A turn for every line, until the other side closes."""
    print("{}", flush=True)
    for line in sys.stdin:
        try:
            reported = {name: summary(times) for name, times in turn(float(line)).items()}
        except Problem as problem:
            sys.exit(str(problem))
        print(json.dumps(reported), flush=True)


@dataclass
class Turns:
    """Results of turns, by measurement, and ratios of adjacent turns, by their names."""

    turns: dict[str, list[Percentiles]] = field(default_factory=dict)
    ratios: dict[str, list[float]] = field(default_factory=dict)

    def keep(self, reported: Report, prefix: str = "") -> None:
        """Add a turn."""
        for name, turn in reported.items():
            self.turns.setdefault(prefix + name, []).append(turn)

    def keep_ratios(self, name: str, *pairs: tuple[Percentiles, Percentiles]) -> None:
        """Add ratios of medians, the first of a pair to the second."""
        self.ratios.setdefault(name, []).extend(first["p50"] / second["p50"] for first, second in pairs)

    def figures(self, table: Mapping[str, Figure]) -> dict[str, float]:
        """Medians over the turns of the figures of a table; KeyError names a measurement that is missing."""
        return {key: median(turn[percentile] for turn in self.turns[name]) / unit
                for key, (name, percentile, unit) in table.items()}

    def span(self, name: str) -> tuple[float, float]:
        """The fastest and the slowest turn, µs: far apart under other load."""
        medians = [turn["p50"] / 1e3 for turn in self.turns[name]]
        return min(medians), max(medians)


class Team(Closable):
    """The processes of one measurement, by role; those in front wait for the last, which measures."""

    def __init__(self, name: str, commands: Mapping[str, Sequence[str]]) -> None:
        """Start them; `wait` returns when they are ready."""
        self.name = name
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._errors: dict[str, IO[bytes]] = {}
        try:
            for role, command in commands.items():
                self._errors[role] = errors = tempfile.TemporaryFile()  # noqa: SIM115, closed in close
                self._children[role] = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE,
                                                        stdout=subprocess.PIPE, stderr=errors)
        except OSError as error:
            self.close()
            raise Problem(f"bench {name}: {error}") from None

    def wait(self) -> None:
        """Until all are ready."""
        self._hear(PATIENCE_S)

    def measure(self, seconds: float) -> dict[str, dict[str, int]]:
        """One turn of all; the percentiles of their measurements."""
        for child in self._children.values():
            assert child.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # it has ended: `_hear` reports its output
                child.stdin.write(b"%f\n" % seconds)
                child.stdin.flush()
        return self._hear(PATIENCE_S + seconds)

    def _hear(self, patience_s: float) -> dict[str, dict[str, int]]:
        """One line of each; the first that ends without one is reported, as it causes later failures."""
        end = monotonic_ns() + int(patience_s * 1e9)
        texts = dict.fromkeys(self._children, b"")
        while waiting := {role: out for role, out in self._outs().items() if not texts[role].endswith(b"\n")}:
            ready, _, _ = select.select(waiting.values(), [], [], LOOK_S)
            for role, out in waiting.items():
                part = os.read(out, 1 << 16) if out in ready else b""
                texts[role] += part
                if not part and (out in ready or self._children[role].poll() is not None):
                    raise Problem(f"bench {self.name}: {role} ended {self._last_words(role)}")
            if monotonic_ns() > end:
                raise Problem(f"bench {self.name}: {' and '.join(waiting)} did not answer within {patience_s:g} s")
        reported: dict[str, dict[str, int]] = {}
        for text in texts.values():
            reported |= json.loads(text)
        return reported

    def _outs(self) -> dict[str, int]:
        return {role: child.stdout.fileno() for role, child in self._children.items() if child.stdout is not None}

    def _last_words(self, role: str) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._children[role].wait(timeout=10.0)
        self._errors[role].seek(0)
        lines = self._errors[role].read().decode(errors="replace").strip().splitlines()
        return f"with {self._children[role].returncode}: {lines[-1] if lines else 'no word'}"

    def close(self) -> None:
        """Let them end; a child that does not end is killed, with all processes it started."""
        for child in self._children.values():
            if child.stdin is not None:
                with contextlib.suppress(BrokenPipeError):
                    child.stdin.close()
        for child in self._children.values():
            _end(child)
            if child.stdout is not None:
                child.stdout.close()
        for errors in self._errors.values():
            errors.close()
        self._children.clear()
        self._errors.clear()


def _end(child: subprocess.Popen[bytes]) -> None:
    try:
        family = psutil.Process(child.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        family = []
    try:
        child.wait(timeout=FAREWELL_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    for each in reversed(family):  # the oldest last: it cleans up behind the others
        if not _gone(each):
            with contextlib.suppress(psutil.NoSuchProcess):
                each.kill()
            _gone(each)


def _gone(process: psutil.Process) -> bool:
    """Whether it ends within FAREWELL_S; a zombie counts as ended."""
    end = monotonic_ns() + int(FAREWELL_S * 1e9)
    with contextlib.suppress(psutil.NoSuchProcess):
        while process.status() != psutil.STATUS_ZOMBIE:
            if monotonic_ns() > end:
                return False
            pause(0.005)
    return True


def main(words: Sequence[str]) -> None:
    """A child of a bench."""
    if len(words) < 3:
        sys.exit("started by: trocar bench ring")
    module, role, *about, core = words
    make: Callable[..., Turn] = importlib.import_module(f"trocar.tools.bench.{module}").ROLES[role]
    pin(int(core))
    serve(make(*about))


if __name__ == "__main__":
    main(sys.argv[1:])
