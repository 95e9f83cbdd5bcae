"""`trocar bench ring`: latency of shared memory, and of other libraries for the same job, on the same two cores.

Everything is measured in short turns, round after round: a turn of ours, a turn of a peer, a turn of ours, and so on.
On a virtual machine the two cores may be near each other in one second and far apart in the next, which doubles every
time; so ratios are formed from adjacent turns, and the median over all rounds is printed.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from trocar.procs.machine.extras import missing
from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import PROBE, PROBE_4K
from trocar.tools.bench.children import Figure, Report, Team, Turns
from trocar.tools.bench.measuring import cpu_model
from trocar.tools.bench.parts import BATCH, LOOK_S, LOOKERS, POLLERS, make_segments
from trocar.tools.bench.peers import MODULES, SETTINGS
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import progress
from trocar.tools.systems.cleanup import own_folder

ROUNDS, TURN_S = 9, 0.2
COUNTER = count()
SOURCE = ROOT / "tools" / "pingpong.c"
FLAGS = ("-O2", "-std=c11")
PEERS = ("c", *SETTINGS)
CHILD = (sys.executable, "-m", "trocar.tools.bench.children")

FIGURES: dict[str, Figure] = {
    "round_trip_us_p50": ("trip", "p50", 1e3),
    "round_trip_us_p99": ("trip", "p99", 1e3),
    "publish_ns_p50": ("publish", "p50", 1),
    "newest_ns_p50": ("newest", "p50", 1),
    "next_ns_p50": ("next", "p50", 1),
    "publish_readers8_ns_p50": ("publish_readers8", "p50", 1),
    "round_trip_4k_us_p50": ("trip_4k", "p50", 1e3),
    "publish_4k_ns_p50": ("publish_4k", "p50", 1),
    "mailbox_us_p50": ("mailbox", "p50", 1e3),
    "mailbox_us_p99": ("mailbox", "p99", 1e3),
    "wakeup_us_p50": ("wakeup", "p50", 1e3),
    "wakeup_us_p99": ("wakeup", "p99", 1e3),
}

Commands = dict[str, list[str]]  # of a team: role and command line


class RingTurns(Turns):
    """Results of the turns; the ratios are of a peer's time and ours, with C of ours and C's."""

    def keep_peer(self, name: str, before: Report, theirs: Report, after: Report) -> None:
        """Add a turn of a peer, between two of ours."""
        self.keep({name: theirs["trip"]})
        pairs = [(theirs["trip"], ours["trip"]) for ours in (before, after)]
        self.keep_ratios(name, *(pair[::-1] if name == "c" else pair for pair in pairs))

    def drop(self, name: str) -> None:
        """Forget a peer."""
        self.turns.pop(name, None)
        self.ratios.pop(name, None)

    def all_figures(self) -> dict[str, float]:
        """All figures, flat."""
        peers = [name for name in PEERS if name in self.ratios]
        return (self.figures(FIGURES) | self.figures({f"{name}_us_p50": (name, "p50", 1e3) for name in peers})
                | {f"ratio_vs_{name}": median(self.ratios[name]) for name in peers})


def run(rounds: int = ROUNDS, turn_s: float = TURN_S) -> dict[str, Any]:
    """Measure."""
    cores = _pair(psutil.Process().cpu_affinity() or [0])
    about: dict[str, str] = {}  # the peers: settings, or why one was left out
    found = RingTurns()
    with _world() as (system, folder), contextlib.ExitStack() as stack, progress("bench ring") as say:
        say("starting", None)
        own = {name: stack.enter_context(Team("ring", commands)) for name, commands in _own(system, cores).items()}
        peers: dict[str, Team] = {}
        for name in PEERS:
            commands, about[name] = _peer(name, folder, cores)
            if commands:
                peers[name] = stack.enter_context(Team(f"ring, {name}", commands))
        for team in own.values():
            team.wait()
        for name, team in list(peers.items()):
            try:
                team.wait()
            except Problem as problem:
                about[name] = f"left out: {problem}"
                del peers[name]
        for i in range(rounds):
            say(f"round {i + 1} of {rounds}", i / rounds)
            _round(turn_s, own, peers, about, found)
    turns = {"turns": f"{rounds} rounds of turns of {turn_s:g} s, a turn of Trocar before and after each peer's",
             "round_trips": sum(turn["n"] for turn in found.turns["trip"]),
             "round_trip_us_p50_of_turns": "{:.2f} to {:.2f}".format(*found.span("trip"))}
    conditions = {**_machine(cores), **turns, **_settings(), **about}
    return {"figures": found.all_figures(), "conditions": conditions}


def _round(turn_s: float, own: dict[str, Team], peers: dict[str, Team], about: dict[str, str],
           found: RingTurns) -> None:
    """A turn of ours before and behind each peer's, then one of every other part."""
    before = own["trip"].measure(turn_s)
    found.keep(before)
    for name, team in list(peers.items()):
        try:
            theirs = team.measure(turn_s)
        except Problem as problem:
            about[name] = f"left out: {problem}"
            del peers[name]
            found.drop(name)
            continue
        after = own["trip"].measure(turn_s)
        found.keep(after)
        found.keep_peer(name, before, theirs, after)
        before = after
    for name, team in own.items():
        if name != "trip":
            found.keep(team.measure(turn_s))


@contextlib.contextmanager
def _world() -> Iterator[tuple[str, str]]:
    """A system's name and a folder, all that is made in either gone at the end."""
    system = f"bench{os.getpid()}-{next(COUNTER)}"
    with own_folder(system) as folder:
        make_segments(system)
        yield system, str(folder)


def _own(system: str, cores: tuple[int, int]) -> dict[str, Commands]:
    """The teams of our own parts; the last of a team measures, on the first core."""

    def team(*roles: str) -> Commands:
        last = len(roles) - 1
        return {f"{role} {i}": [*CHILD, "parts", role, system, str(cores[i != last])] for i, role in enumerate(roles)}

    return {
        "trip": team("pong", "ping"),
        "trip_4k": team("pong_4k", "ping_4k"),
        "local": team("local"),
        "crowd": team(*["poller"] * POLLERS, *["looker"] * LOOKERS, "crowd"),
        "mailbox": team("client", "owner"),
        "wakeup": team("waker", "sleeper"),
    }


def _peer(name: str, folder: str, cores: tuple[int, int]) -> tuple[Commands, str]:
    """The team of a peer and its version and settings; an empty team and the reason when it is missing."""
    first, second = (str(core) for core in cores)
    if name == "c":
        return _compiled(folder, first, second)
    module = MODULES.get(name)
    if module is None:
        version = f"Python {platform.python_version()}"
    elif lacks := missing(module):
        return {}, lacks
    else:
        version = importlib.metadata.version({"zmq": "pyzmq"}.get(module, module))
    start = [*CHILD, "peers"]
    if module is None:
        team = {name: [*start, name, folder, second, first]}
    else:
        team = {f"{name}_pong": [*start, f"{name}_pong", folder, first, second],
                f"{name}_ping": [*start, f"{name}_ping", folder, second, first]}
    return team, f"{version}; {SETTINGS[name]}"


def _compiled(folder: str, first: str, second: str) -> tuple[Commands, str]:
    """The ping-pong in C, when it can be had."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return {}, "gcc is not there; sudo apt-get install gcc libc6-dev"
    program = Path(folder) / "pingpong"
    done = subprocess.run([gcc, *FLAGS, "-o", program, SOURCE], capture_output=True, text=True, check=False)
    if done.returncode:
        return {}, f"gcc failed: {''.join(done.stderr.strip().splitlines()[:1])}"
    version = subprocess.run([gcc, "--version"], capture_output=True, text=True, check=False).stdout.splitlines()[:1]
    text = f"{''.join(version)}, {' '.join(FLAGS)}; the ring of shm/ring/ring.py in C11 atomics, tools/{SOURCE.name}"
    return {"c": [str(program), first, second]}, text


def _pair(cores: list[int]) -> tuple[int, int]:
    return cores[0], cores[-1]


def _machine(cores: tuple[int, int]) -> dict[str, Any]:
    first, second = cores
    pinned = f"{first} and {second}" if first != second else f"{first}, the only core: polling processes alternate"
    return {"cpu": cpu_model(), "pinned": pinned}


def _settings() -> dict[str, Any]:
    """The settings of the measurements, in words."""
    return {
        "payload_bytes": schema_of(PROBE).dtype.itemsize - 16,
        "payload_4k_bytes": schema_of(PROBE_4K).dtype.itemsize - 16,
        "round_trip": f"depth {PROBE.depth}; publish, poll next() until the answer is copied into our record, read its "
                      "stamp, which is the question's; garbage collector off, as with all peers",
        "publish, newest, next": f"one process, nothing else attached; means of {BATCH} calls",
        "publish_readers8": f"1 writer at full speed, {POLLERS + LOOKERS} readers, each a process on the other core: "
                            f"{POLLERS} poll next() without pause, {LOOKERS} take newest() every {LOOK_S * 1e3:g} ms; "
                            f"means of {BATCH} calls",
        "mailbox": "from just before a loop sends to the command in the polling owner's hands, its 7 numbers read",
        "wakeup": "from just before it is woken to the process running that slept",
    }
