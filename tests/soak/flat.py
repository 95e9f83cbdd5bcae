"""Whether memory, descriptors and threads of every process stay as they are, while a system is used as usual.

    python -m tests.soak.flat --minutes 15

A master, a PSM, a console on emulated boards, and a process of a user's that comes and goes with who connects. The arm
moves, commands are carried out and refused, clients come and go, people look. Nobody dies. Prints a row for each
process and what grew; exit code 1 when something did. Memory is what the process has for itself (RssAnon).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import socket
import statistics
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil
import yaml

from tests.soak.system import FILE
from trocar.procs.machine import log_files
from trocar.procs.tables.bring_up import HOMED
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.bring_up import bring, silent
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.processes import statuses
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note
from trocar.tools.systems.supervising import Background, StartRequest, up_meanwhile

WARM_UP: Final = 0.25  # of the time; what is made at its first use is there by then
EVERY_S: Final = 2.0
GROWTH_KB: Final = 512
"""Of memory that is no leak: an allocator takes such pieces at a time."""
PLACES: Final = ((0.1, -0.1, 0.12, 0.0, 0.0, 0.0), (0.4, 0.2, 0.16, 0.3, 0.2, -0.2))
CALLED: Final = """
import trocar

class Called(trocar.Process):
    def setup(self):
        self.watch(self.listening[0])

    def main(self):
        while self.wait(1.0):
            self.process_messages()
            if self.is_ready(self.listening[0]):
                client, _ = self.listening[0].accept()
                with client:
                    client.sendall(b"here")
"""


@dataclass
class Footprint:
    """What one process had, sample by sample."""

    pid: int
    memory_kb: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)

    def look(self) -> None:
        """Once more; psutil.Error, OSError: it has ended."""
        lines = Path(f"/proc/{self.pid}/status").read_text().splitlines()
        words = dict(line.split(":", 1) for line in lines)
        self.memory_kb.append(int(words["RssAnon"].split()[0]))
        self.threads.append(int(words["Threads"]))
        self.files.append(len(list(Path(f"/proc/{self.pid}/fd").iterdir())))

    def grown(self) -> tuple[float, float, float]:
        """Memory (kB), files and threads: the last quarter of the samples beside the first after the warm-up."""
        def by(values: list[int]) -> float:
            counted = values[round(len(values) * WARM_UP) :]
            part = max(1, len(counted) // 4)
            return statistics.median(counted[-part:]) - statistics.median(counted[:part])

        return by(self.memory_kb), by(self.files), by(self.threads)


class Soak:
    """One run."""

    def __init__(self, name: str, folder: Path, seed: int) -> None:
        self.name, self._folder, self._chance = name, folder, random.Random(seed)
        self.footprints: dict[str, Footprint] = {}
        self.rounds, self.refused, self.calls, self.hours = 0, 0, 0, 0.0
        with socket.create_server(("127.0.0.1", 0)) as server:
            self._port = int(server.getsockname()[1])

    def run(self, seconds: float, clock: str) -> list[str]:
        """Use a system for so long; returns what grew."""
        with up_meanwhile(StartRequest(self._file(), self.name, "emulated", sets=(f"clock={clock}",))) as background:
            arms = ["MTMR", "PSM1"]
            if problem := next(filter(None, bring(self.name, arms, HOMED, 0.0, silent, note).values()), ""):
                raise Problem(problem)
            pids = {"supervisor": background.popen.pid, "logs": _log_keeper(background)}
            pids |= {row.name: row.pid for row in statuses(self.name) if row.pid and row.name != "called"}
            self.footprints = {each: Footprint(pid) for each, pid in pids.items()}
            with SystemTime(self.name) as time:
                began_ns, end = time.now_ns(), monotonic_ns() + round(seconds * 1e9)
                while monotonic_ns() < end:
                    self._use()
                    for each in self.footprints.values():
                        each.look()
                    pause(self._chance.uniform(0.5, 1.5) * EVERY_S)
                self.hours = (time.now_ns() - began_ns) / 3.6e12
        return list(self._problems())

    def _file(self) -> Path:
        content = yaml.safe_load(FILE.read_text())
        content["trocar"]["processes"] = {"called": {"module": "called.py", "listen": f"127.0.0.1:{self._port}",
                                                     "linger_s": 0.5}}
        (self._folder / "called.py").write_text(CALLED)
        file = self._folder / "flat.yaml"
        file.write_text(yaml.safe_dump(content))
        return file

    def _use(self) -> None:
        """What people and programs do."""
        self.rounds += 1
        with Remote(self.name, "PSM1") as arm, Remote(self.name, "console") as console:
            arm.settled("move_jp", PLACES[self.rounds % 2], timeout=60.0)
            self.refused += arm.answered("move_jp", (0.0,)).outcome == "refused"
            console.answered("set_scale", (self._chance.uniform(0.1, 1.0),))
        statuses(self.name)
        with contextlib.closing(Subscriber(self.name, "PSM1", "soak")) as subscriber, \
                contextlib.closing(directory.reader(self.name, "PSM1", "state")) as reader:
            subscriber.want("state", "wrench")
            reader.newest()
        if self.rounds % 3 == 0:
            with socket.create_connection(("127.0.0.1", self._port), timeout=30.0) as client:
                self.calls += client.recv(10) == b"here"

    def _problems(self) -> Iterator[str]:
        for name, each in self.footprints.items():
            memory_kb, files, threads = each.grown()
            if memory_kb > GROWTH_KB or files > 0 or threads > 0:
                way = each.memory_kb[:: max(1, len(each.memory_kb) // 20)]
                yield f"{name} grew: {memory_kb:+.0f} kB, {files:+.0f} descriptors, {threads:+.0f} threads; kB: {way}"

    def rows(self) -> Iterator[str]:
        """A table for people."""
        yield "| process | memory at first, kB | in the end | growth | descriptors | growth | threads | growth |"
        yield "|---|---|---|---|---|---|---|---|"
        for name, each in self.footprints.items():
            memory_kb, files, threads = each.grown()
            yield (f"| {name} | {each.memory_kb[0]} | {each.memory_kb[-1]} | {memory_kb:+.0f} | {each.files[-1]} | "
                   f"{files:+.0f} | {each.threads[-1]} | {threads:+.0f} |")


def _log_keeper(background: Background) -> int:
    children = psutil.Process(background.popen.pid).children()
    return int(next(child.pid for child in children if log_files.__file__ in child.cmdline()))


def main() -> None:
    """By hand."""
    parser = argparse.ArgumentParser(prog="tests.soak.flat", description=__doc__)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--clock", choices=("wall", "paced", "lockstep"), default="paced")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TROCAR_STATE"] = folder
        soak = Soak(f"flat{os.getpid()}", Path(folder), chosen.seed)
        problems = soak.run(chosen.minutes * 60.0, chosen.clock)
    print("\n".join(soak.rows()))
    print(f"{chosen.minutes:g} min, {soak.hours:.2f} h of system time, {soak.rounds} rounds, {soak.refused} refused "
          f"commands, {soak.calls} calls that started a process; load {os.getloadavg()[1]:.1f}")
    print("\n".join(problems) or "flat")
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
