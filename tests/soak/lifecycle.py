"""Three clients start, stop, subscribe and connect at random, processes die and hang meanwhile: nobody is forgotten.

    python -m tests.soak.lifecycle --seed 1 --steps 300 --clock wall

The model says what must run when everything has settled, which is looked at now and then: whom the last one who asked
wanted to run, or to end, whom somebody has subscribed to, or is connected with. In between, at each look: no two
processes of an instance. In the end: setup, main and quit came in order, nothing is left. Exit code 1 when not.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import psutil

from tests.soak.lifecycle_client import LifecycleClient
from trocar.procs.tables import lifecycle
from trocar.shm.memory.segment import names_of
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.inspect.processes import ProcessStatus, statuses
from trocar.tools.systems.supervising import Background, StartRequest, up_meanwhile

CLIENTS: Final = 3
SETTLE_EVERY: Final = 30
SETTLE_S: Final = 90.0  # whoever is stopped in its setup is killed after 60 s
LINGER_S: Final = 0.3
APART_NS: Final = 300_000_000
"""What two clients ask for within this may be carried out in either order."""
COARSE: Final = ("io.period_s=0.005", "arm.period_s=0.005")  # rates are not the subject
STEADY, WANTED = "steady", "wanted"
"""A process that always runs, and one that runs on demand."""
ALWAYS: Final = ("io", "PSM1", STEADY)
NAMES: Final = (*ALWAYS, WANTED)
NOTES: Final = """
import os, pathlib
import trocar

def note(word):
    with open(pathlib.Path(__file__).with_suffix(".txt"), "a") as file:
        file.write(f"{os.getpid()} {word}\\n")

class Noted(trocar.Process):
    def setup(self):
        note("setup")
        for server in self.listening:
            self.watch(server)

    def main(self):
        note("main")
        clients = []
        while self.wait(0.05):
            self.process_messages()
            self.publish("count", count=1)
            for server in self.listening:
                if self.is_ready(server):
                    clients.append(server.accept()[0])

    def quit(self):
        note("quit")
"""


class RandomWalk:
    """One system, and what has been asked of it."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.name, self._folder, self._chance = f"lifecycle{os.getpid()}", folder, random.Random(seed)
        self.violations: list[str] = []
        self.steps = dict.fromkeys(("ask", "subscribe", "unsubscribe", "connect", "kill", "hang", "client dies"), 0)
        self.clients: list[LifecycleClient] = []
        self._last: dict[str, tuple[str, LifecycleClient, int, int]] = {}  # verb, whose, its number, when
        self._unclear: set[str] = set()  # two asked for different things at once
        self._open_files = 0
        with socket.create_server(("127.0.0.1", 0)) as server:
            self._port = int(server.getsockname()[1])

    def run(self, steps: int, clock: str) -> list[str]:
        """So many steps; returns what is wrong."""
        with up_meanwhile(StartRequest(self._file(), self.name, sets=(f"clock={clock}", *COARSE))) as background:
            self.clients = [LifecycleClient(self.name) for _ in range(CLIENTS)]
            try:
                self._settle(background)
                for number in range(1, steps + 1):
                    self._step()
                    self._look()
                    pause(self._chance.choice((0.0, 0.0, 0.02, 0.1, 0.5)))
                    if number % SETTLE_EVERY == 0 or number == steps:
                        self._settle(background)
                        print(f"{number} steps: {self.steps}; wrong: {len(self.violations)}", flush=True)
            finally:
                for client in self.clients:
                    client.kill()
        self._wrong(*(f"{pid} {name} is left" for name, pids in self._running().items() for pid in pids))
        self._wrong(*(f"segment {'~'.join(parts)} is left" for parts in names_of(self.name)))
        for name in (STEADY, WANTED):
            self._wrong(*order((self._folder / f"{name}.txt").read_text().splitlines()))
        return self.violations

    def _file(self) -> Path:
        usual = {"topics": [{"name": "count", "fields": [{"name": "count", "type": "int"}]}], "hung_s": 0.5,
                 "late_s": 0.3, "restart_limit": 1000, "backoff_s": 0.0}
        rows = [{"name": STEADY, "module": f"{STEADY}.py", **usual},
                {"name": WANTED, "module": f"{WANTED}.py", "linger_s": LINGER_S, "listen": f"127.0.0.1:{self._port}",
                 **usual},
                *({"name": name, "restart_limit": 1000, "backoff_s": 0.0} for name in ("io", "PSM1"))]
        for name in (STEADY, WANTED):
            (self._folder / f"{name}.py").write_text(NOTES)
        file = self._folder / "lifecycle.json"
        arms = [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}]
        file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms,
                                    "trocar": {"processes": rows}}))
        return file

    # what happens

    def _step(self) -> None:
        kind = self._chance.choices(list(self.steps), (40, 15, 12, 10, 12, 6, 5))[0]
        self.steps[kind] += 1
        client, name = self._chance.choice(self.clients), self._chance.choice(NAMES)
        if kind == "ask":
            self._ask(client, self._chance.choice(("start", "stop", "restart")), name)
        elif kind == "subscribe":
            topic = "count" if name in (STEADY, WANTED) else "state"
            client.want(name, topic)
        elif kind == "unsubscribe" and client.wants:
            client.drop(self._chance.choice(sorted(client.wants)))
        elif kind == "connect":
            client.connect(self._port)
        elif kind in ("kill", "hang"):
            for pid in self._running()[name]:
                _signal(pid, signal.SIGKILL if kind == "kill" else signal.SIGSTOP)
        elif kind == "client dies":
            client.kill()
            self.clients[self.clients.index(client)] = LifecycleClient(self.name)

    def _ask(self, client: LifecycleClient, verb: str, name: str) -> None:
        now, before = monotonic_ns(), self._last.get(name)
        if before is not None and before[1] is not client and now - before[3] < APART_NS:
            self._unclear.add(name)
        else:
            self._unclear.discard(name)
        self._last[name] = verb, client, client.ask(verb, name), now

    # what must be true

    def _running(self) -> dict[str, list[int]]:
        """All processes of each instance, as the kernel lists them."""
        found: dict[str, list[int]] = {name: [] for name in NAMES}
        for process in psutil.process_iter(["cmdline"]):
            words = [word for word in process.info["cmdline"] or [] if word]
            if words[-4:-1] == ["--system", self.name, "--name"] and "handover.py" not in " ".join(words):
                found.setdefault(words[-1], []).append(process.pid)
        return found

    def _look(self) -> None:
        self._wrong(*(f"two processes of {name}: {pids}" for name, pids in self._running().items() if len(pids) > 1))

    def _settle(self, background: Background) -> None:
        """Everybody is answered; then who must run does, and who must not does not."""
        self._until(self._all_answered, "somebody waits for an answer")
        for name in ALWAYS:
            if (wanted := self._must_run(name)) is not None:
                self._until(lambda name=name, wanted=wanted: self._runs(name) is wanted,  # type: ignore[misc]
                            f"{name} must {'' if wanted else 'not '}run")
        for name in ALWAYS:  # from here on these run, and nothing is unclear
            self._ask(self.clients[0], "start", name)
            self._until(self._all_answered, "somebody waits for an answer")
            self._until(lambda name=name: self._runs(name) is True, f"{name} was started and does not run")  # type: ignore[misc]
        self._nobody_wants_it()
        self._until(lambda: self._runs(WANTED) is False, f"{WANTED} runs though nobody wants it")
        for desired in (lambda: self.clients[0].want(WANTED, "count"), lambda: self.clients[1].connect(self._port)):
            desired()
            self._until(lambda: self._runs(WANTED) is True, f"{WANTED} does not run though somebody wants it")
            self._nobody_wants_it()
            self._until(lambda: self._runs(WANTED) is False, f"{WANTED} runs though nobody wants it any more")
        files = partial(os.listdir, f"/proc/{background.popen.pid}/fd")
        self._open_files = self._open_files or len(files())
        self._until(lambda: len(files()) <= self._open_files,
                    f"the supervisor has {len(files())} open files, {self._open_files} at first")

    def _nobody_wants_it(self) -> None:
        """All leave the process on demand; what a person has asked for by hand ends as well."""
        for client in self.clients:
            if WANTED in client.wants:
                client.drop(WANTED)
            if client.connected:
                client.connect(0)
        pause(2 * LINGER_S + 1.0)
        self._ask(self.clients[0], "stop", WANTED)
        self._until(self._all_answered, "somebody waits for an answer")
        pause(2 * LINGER_S)  # one that was stopped while somebody seemed to wait for it is refused for so long

    def _must_run(self, name: str) -> bool | None:
        """None: it is not clear."""
        verb, client, number, _ = self._last.get(name, ("start", None, 0, 0))
        if client is None:
            return True
        if name in self._unclear or client not in self.clients or client.asked[number] != "done":
            return None
        return verb != "stop"

    def _all_answered(self) -> bool:
        for client in self.clients:
            client.poll()
        return all(outcome for client in self.clients for outcome in client.asked.values())

    def _runs(self, name: str) -> bool | None:
        """None: it is on its way."""
        status, pids = self._status(name), self._running()[name]
        if status.lifecycle == lifecycle.STOPPED and not pids:
            return False
        return True if status.state == lifecycle.RUNNING and pids == [status.pid] and not status.problem else None

    def _status(self, name: str) -> ProcessStatus:
        return next(row for row in statuses(self.name) if row.name == name)

    def _until(self, true: Callable[[], bool], otherwise: str) -> None:
        end = monotonic_ns() + round(SETTLE_S * 1e9)
        while not true():
            if monotonic_ns() > end:
                self._wrong(f"{otherwise}: {[(row.name, row.state, row.exit_reason) for row in statuses(self.name)]}")
                return
            pause(0.02)

    def _wrong(self, *found: str) -> None:
        for each in found:
            print(f"WRONG {each}", flush=True)
        self.violations += found


def order(notes: list[str]) -> list[str]:
    """What is wrong with the notes of one instance's processes: setup, main, quit of each, one after another."""
    wrong, lives = [], dict[str, list[str]]()
    for line in notes:
        pid, word = line.split()
        if (pid not in lives and word != "setup") or (pid in lives and pid != list(lives)[-1]):
            wrong.append(f"{line} while another one ran, or before its setup")
        lives.setdefault(pid, []).append(word)
    usual = (["setup"], ["setup", "main"], ["setup", "main", "quit"], ["setup", "quit"])
    return wrong + [f"process {pid} did {' '.join(words)}" for pid, words in lives.items() if words not in usual]


def _signal(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return


def main() -> None:
    """By hand."""
    parser = argparse.ArgumentParser(prog="tests.soak.lifecycle", description=__doc__)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--clock", choices=("wall", "paced", "lockstep"), default="wall")
    chosen = parser.parse_args()
    print(f"seed {chosen.seed}, {chosen.steps} steps, {chosen.clock}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TROCAR_STATE"] = folder
        violations = RandomWalk(chosen.seed, Path(folder)).run(chosen.steps, chosen.clock)
    print("\n".join(violations) or "nothing is wrong")
    sys.exit(1 if violations else 0)


if __name__ == "__main__":
    main()
