"""A whole system under test, started through the front door in a world of its own."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import psutil
import pytest
from typer.main import get_command

from tests.retries import retry
from tests.system.verb_template import Verb, VerbTemplate
from trocar.shm.memory.segment import SegmentError, names_of
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.held_time import HeldTime
from trocar.tools.cli import build

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs" / "systems" / "demo.yaml"
UP_S = 180.0
OWN_PROCESS = ("up", "demo", "bench", "commission")
AT_ONCE = ("status", "logs", "recordings", "dump")
"""Verbs that wait for nothing of a system."""
LOOK_MAX_S = 0.05
RESTART_S = 120.0


VERBS: list[VerbTemplate] = []
"""The template of verbs, where there is one."""
LED = "led"
"""A clock of tests: lockstep, whose time passes only while a verb runs or the test waits for something."""
STANDING: dict[str, HeldTime] = {}
"""The time of each such system, while it stands still."""
SLOWER, AT_250_HZ = (tuple(word for section in ("io", "arm", "emulation")
                           for word in ("--set", f"{section}.period_s={period_s}")) for period_s in (0.002, 0.004))
"""Periods of systems in simulated time: a third of the turns, a sixth."""
TELEOP_AT_500_HZ = ("--set", "processes.MTMR_PSM1.period_s=0.002")
"""The same for the teleoperation of the demo, which else has 1000 turns a second."""
COARSE = ("--set", "io.period_s=0.005", "--set", "arm.period_s=0.01")
"""Periods for arms without boards, where rates are not the subject."""
COARSE_ON_BOARDS = (*COARSE, "--set", "emulation.period_s=0.002")
"""The same with boards, whose plant needs a shorter period."""


def wait_for(condition: Callable[[], object], seconds: float, what: str) -> None:
    """Wait for a condition, seen while time stands, with a generous deadline; fails naming what did not happen."""
    end = time.monotonic() + seconds
    while True:
        began = time.process_time()
        if condition():
            return
        if time.monotonic() > end:
            pytest.fail(f"did not happen within {seconds} s: {what}")
        # looks take a fifth of a core at most
        took = min(time.process_time() - began, LOOK_MAX_S)
        with time_passes():
            pause(max(0.002, took) if STANDING else max(0.005, 4 * took))


@contextlib.contextmanager
def time_passes() -> Iterator[None]:
    """Let the time of all such systems pass, as fast as the machine allows."""
    names = list(STANDING)
    for name in names:
        STANDING.pop(name).close()
    try:
        yield
    finally:
        for name in names:
            with contextlib.suppress(SegmentError):  # it has ended
                STANDING[name] = HeldTime(name)


@functools.cache
def verb(name: str) -> Callable[..., object]:
    """The command line of one verb."""
    return get_command(build(name))


class Robot:
    """One system under test: the real supervisor with emulated boards."""

    def __init__(self, name: str, logs: Path, clock: str = "wall") -> None:
        self.name, self.clock, self.root = name, clock, ROOT
        self.logs = logs
        self.are_verbs_apart = False
        """Each verb has a fresh interpreter of its own, as programs of several people have."""
        self.environment = {**os.environ, "TROCAR_STATE": str(logs), "TROCAR_SYSTEM": name}
        self.supervisor: subprocess.Popen[str] | Verb | None = None
        self.pids: set[int] = set()

    def up(self, file: Path = DEMO, *options: str, wait: bool = True) -> None:
        """`trocar up FILE …` with our clock unless options name another one, and wait until everything runs."""
        self._let_time_go()  # of the system before
        if "--clock" not in options and not any(option.startswith("clock=") for option in options):
            slower = () if self.clock == "wall" else SLOWER
            options = (*slower, *options, "--clock", "lockstep" if self.clock == LED else self.clock)
            is_led = self.clock == LED
        else:
            is_led = False
        self.supervisor = self.popen("up", str(file), "--system", self.name, *options)
        if wait:
            wait_for(self.is_up, UP_S, f"system up; supervisor said:\n{self.output()}")
            self.pids |= {self.pid(i) for i in directory.instances(self.name)} - {0}  # who has begun
            if is_led:
                STANDING[self.name] = HeldTime(self.name)

    def output(self) -> str:
        """What the supervisor printed so far."""
        path = self.logs / "supervisor.txt"
        return path.read_text() if path.exists() else ""

    def is_up(self) -> bool:
        """The supervisor says RUNNING; fails at once when it has ended instead."""
        assert self.supervisor is not None
        if self.supervisor.poll() is not None:
            pytest.fail(f"the supervisor ended with {self.supervisor.returncode}:\n{self.output()}")
        try:
            page = ControlPage(self.name,
                               "supervisor")  # one page for both: the next supervisor clears a dead one's page
        except SegmentError:
            return False
        running = page.state == "RUNNING" and int(page.get("pid")) == self.supervisor.pid
        page.close()
        return running

    def state(self, instance: str) -> str:
        """Lifecycle state an instance shows, empty when it has no control page."""
        try:
            page = ControlPage(self.name, instance)
        except SegmentError:
            return ""
        state = page.state
        page.close()
        return state

    def cell(self, instance: str, name: str) -> float:
        """One number of an instance's control page."""
        page = ControlPage(self.name, instance)
        value = page.get(name)
        page.close()
        return value

    def pid(self, instance: str) -> int:
        """Process id an instance shows."""
        return int(self.cell(instance, "pid"))

    def kill(self, instance: str) -> int:
        """kill -9; returns the pid that died."""
        pid = self.pid(instance)
        os.kill(pid, signal.SIGKILL)
        return pid

    def comes_back(self, instance: str, before: int) -> None:
        """Wait until another process than this one runs, while time passes slowly: an interpreter takes real time."""
        end = time.monotonic() + RESTART_S
        while (pid := self.pid(instance)) == before or self.state(instance) != "RUNNING":
            assert time.monotonic() < end, f"{instance} is not back after {RESTART_S} s; {self.output()}"
            self.passes(0.002, 0.1)
            pause(0.01)
        self.pids.add(pid)

    def passes(self, seconds: float, real_s: float = 60.0) -> None:
        """Let so much of the time pass that stands still; less after `real_s`."""
        if self.name in STANDING:
            held = STANDING[self.name]
            held.run_until(held.now_ns() + round(seconds * 1e9), real_s)

    def types(self, *words: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        """Run a verb, whatever its exit code.

        It runs in this process, which has imported it already: a fresh interpreter takes a second of computing time.
        Verbs that start processes or keep time get one all the same, and those of another tree.
        """
        keeps_time = words[0] == "stream" and self.clock == "wall"
        if self.are_verbs_apart or words[0] in OWN_PROCESS or keeps_time or self.root != ROOT:
            with time_passes():
                return subprocess.run([sys.executable, "-m", "trocar", *words], cwd=self.root, env=self.environment,
                                      timeout=timeout, capture_output=True, text=True, check=False)
        out, err, code = io.StringIO(), io.StringIO(), 0
        passes = contextlib.nullcontext() if words[0] in AT_ONCE else time_passes()
        with passes, mock.patch.dict(os.environ, self.environment), contextlib.redirect_stdout(out), \
                contextlib.redirect_stderr(err), contextlib.chdir(self.root):
            try:
                verb(words[0])(words, prog_name="trocar")
            except SystemExit as end:
                code = int(end.code or 0)
        return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())

    def popen(self, *words: str) -> subprocess.Popen[str] | Verb:
        """Begin a verb in a process of its own; what it and the system print is `output`."""
        with (self.logs / "supervisor.txt").open("a") as out:
            if VERBS and self.root == ROOT and not self.are_verbs_apart:
                return VERBS[0].begin(words, self.environment, out.fileno())
            return subprocess.Popen([sys.executable, "-m", "trocar", *words], cwd=self.root, env=self.environment,
                                    stdout=out, stderr=out, text=True)

    def home(self, *arms: str, timeout: float = 120.0) -> None:
        """`trocar home`, see `insist`."""
        self.insist("home", *arms, timeout=timeout)

    def trocar(self, *words: str, code: int | None = 0, timeout: float = 120.0) -> str:
        """Run a verb; returns its output, fails on another exit code than expected."""
        done = self.types(*words, timeout=timeout)
        if code is not None and done.returncode != code:
            pytest.fail(f"trocar {' '.join(words)} → {done.returncode}\n{done.stdout}\n{done.stderr}\n{self.output()}")
        return done.stdout + done.stderr if code else done.stdout

    def insist(self, *words: str, timeout: float = 120.0) -> str:
        """Run a verb, again where the machine was too busy for it, until it succeeds; returns its output."""
        done = self.patiently(*words, timeout=timeout)
        if done.returncode:
            pytest.fail(f"trocar {' '.join(words)} → {done.returncode}\n{done.stdout}\n{done.stderr}\n{self.output()}")
        return done.stdout

    def patiently(self, *words: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        """What becomes of a verb where the machine was not too busy for it."""
        done: list[subprocess.CompletedProcess[str]] = []

        def attempt() -> str:
            done.append(self.types(*words, timeout=timeout))
            return f"{done[-1].stdout}{done[-1].stderr}" if done[-1].returncode else ""

        self.retry(attempt, f"trocar {' '.join(words)}")
        return done[-1]

    def retry(self, attempt: Callable[[], str], what: str) -> str:
        """See tests/retries.py."""
        return retry(attempt, self._written, what)

    def _written(self) -> list[Path]:
        return [*self.logs.rglob("*.log"), *self.logs.glob("supervisor.txt")]

    def down(self) -> int:
        """Ask the supervisor to end and wait for it."""
        self._let_time_go()
        if self.supervisor is None:
            return 0
        if self.supervisor.poll() is None:
            self.supervisor.send_signal(signal.SIGINT)
        return self.supervisor.wait(timeout=60)

    def _let_time_go(self) -> None:
        if self.name in STANDING:
            STANDING.pop(self.name).close()

    def left_over(self) -> list[str]:
        """Processes and segments that are still there."""
        alive = []
        for pid in self.pids:
            with contextlib.suppress(psutil.NoSuchProcess):  # it ends while we look
                process = psutil.Process(pid)
                if process.status() != psutil.STATUS_ZOMBIE:
                    alive.append(f"process {pid} {' '.join(process.cmdline())}")
        return alive + ["~".join(parts) for parts in names_of(self.name)]
