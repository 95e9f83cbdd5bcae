"""Fixtures of all tests: where the test data are, and a shared-memory world of one's own."""

from __future__ import annotations

import contextlib
import gc
import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests import examples, retries, searches, skips
from trocar.shm.memory import private
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import FOLDER, names_of

ROOT = Path(__file__).resolve().parent.parent
SYSTEMS = ROOT / "tests" / "system"  # whole robots: on the wall clock nobody else may take their cores
COUNTER = itertools.count()
PATIENCE_S = 30.0
GONE_S = 5.0  # a process that a test has adopted may need so long to end


def pytest_configure(config: pytest.Config) -> None:
    """Ctrl-C works in what the tests start, also where we run in the background of a shell, which turns it off.

    Bytecode is kept, also where the environment says not to, as container images do: the tests start hundreds of
    interpreters, and each would compile every module anew. None of their systems has a recorder unless it asks for one.
    """
    examples.choose(config.option.markexpr)
    os.environ["TROCAR_RECORDER"] = "0"
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Say which tests want the machine for themselves, and leave soaks and peers out unless `-m` speaks of them.

    `-m "not slow"` takes the place of the settings' `not soak and not peers`.
    """
    for item in items:
        waits = item.get_closest_marker("simulated") or item.get_closest_marker("patient")  # for whoever is late
        if item.get_closest_marker("slow") and not waits and item.path.is_relative_to(SYSTEMS):
            item.add_marker("alone")
        if item.get_closest_marker("alone") and not item.path.is_relative_to(SYSTEMS):  # tools/test collects them there
            raise pytest.UsageError(f"{item.nodeid} is marked alone, which tools/test does not expect in this folder")
    left_out = [mark for mark in ("soak", "peers") if mark not in config.option.markexpr]
    items_left = [item for item in items if any(item.get_closest_marker(mark) for mark in left_out)]
    items_left += searches.done(config, items)
    items[:] = [item for item in items if item not in items_left]
    config.hook.pytest_deselected(items=items_left)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Of thousands of tests, nothing becomes garbage before the end; no collection needs to look through them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Whole files may be skipped."""
    skips.note(report)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Which searches have passed; what was skipped."""
    skips.note(report)
    searches.note(report)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """What a worker of xdist tells at its end."""
    output = getattr(node, "workeroutput", {})
    retries.made += output.get("retries", [])
    searches.left_out.update(output.get("left_out", ()))
    searches.changed.update(output.get("changed", ()))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Searches need not run again before something changes; too many retries fail, and skips that CI does not allow."""
    if session.exitstatus == pytest.ExitCode.OK:
        searches.remember(session.config)
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput.update(retries=retries.made, left_out=list(searches.left_out),
                                           changed=list(searches.changed))
    elif len(retries.made) > retries.BUDGET or skips.are_too_many():
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """How often a busy machine made a test try again; which searches did not run; what CI would not leave out."""
    for line in searches.summary():
        terminalreporter.write_line(line)
    for line in sorted(skips.found):
        terminalreporter.write_line(f"skipped, which CI does not allow: {line}")
    terminalreporter.write_line(f"{len(retries.made)} retries on a busy machine, allowed are {retries.BUDGET}")
    for line in retries.made:
        terminalreporter.write_line(f"  {line}")


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """`data("golden/wire")` is the path of test data; the test is skipped where they are absent."""
    folder = Path(os.environ.get("TROCAR_TEST_DATA", str(ROOT.parent / "shared" / "data")))

    def find(name: str) -> Path:
        path = folder / name
        if not path.exists():
            pytest.skip(f"test data {path} is not there (set TROCAR_TEST_DATA)")
        return path

    return find


@dataclass
class World:
    """A shared-memory system name that only one test uses, and the processes that test started in it."""

    name: str
    children: list[subprocess.Popen[str]] = field(default_factory=list)

    def start(self, code: str, *arguments: str) -> subprocess.Popen[str]:
        """A fresh interpreter that runs `code`; `sys.argv[1]` is the world's name, the arguments follow."""
        command = [sys.executable, "-c", code, self.name, *arguments]
        child = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.children.append(child)
        return child

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Wait for a condition with a generous deadline; fails saying what did not happen."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"did not happen within {PATIENCE_S} s: {what}")
            time.sleep(0.001)

    def finish(self, child: subprocess.Popen[str]) -> str:
        """Wait for a child to end well; returns what it printed."""
        out, _ = child.communicate(timeout=PATIENCE_S)
        assert child.returncode == 0, f"child ended with {child.returncode}: {out}"
        return out

    def kill(self, child: subprocess.Popen[str]) -> None:
        """kill -9, and wait until it is gone."""
        child.send_signal(signal.SIGKILL)
        child.communicate(timeout=PATIENCE_S)

    def remove(self) -> None:
        """Unlink every segment, as the supervisor does at the end."""
        remove_all(self.name)

    def left_over(self) -> list[str]:
        """Children still running and segments still there."""
        running = [f"process {child.pid}" for child in self.children if child.poll() is None]
        return running + ["~".join(parts) for parts in names_of(self.name)]


@pytest.fixture
def world() -> Iterator[World]:
    """A world of one's own; the test fails when a process or a segment of it outlives the test."""
    here = World(f"t{os.getpid()}x{next(COUNTER)}")
    yield here
    left = here.left_over()
    for child in here.children:
        with contextlib.suppress(ProcessLookupError):
            child.kill()
        child.communicate()
    here.remove()
    assert not left, f"left behind: {', '.join(left)}"


@pytest.fixture(autouse=True)
def nothing_outlives_the_test() -> Iterator[None]:
    """Fails a test after which more of this process's worlds or children are there than before."""
    before = _present()
    yield
    end = time.monotonic() + GONE_S
    while (left := _present() - before) and time.monotonic() < end:
        time.sleep(0.01)
    assert not left, f"left behind: {', '.join(sorted(left))}"


def _present() -> set[str]:
    """Of /dev/shm the names alone: looking at each file, as names_of does, takes as long as a short test."""
    own = tuple(f"trocar~t{os.getpid()}{mark}" for mark in "x-")
    segments = {name for name in (*os.listdir(FOLDER), *(name[1:] for name in private.segments()))  # noqa: PTH208
                if name.startswith(own)}
    children = set()
    for pid in _children():
        with contextlib.suppress(psutil.NoSuchProcess):
            child = psutil.Process(pid)
            if child.status() != psutil.STATUS_ZOMBIE:
                children.add(f"process {child.pid} ({child.name()})")
    return segments | children


def _children() -> list[int]:
    """Our children. The kernel's lists, where it keeps them, take a thirtieth of a look at all processes."""
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:  # there are none: asking for that costs next to nothing
        return []
    try:
        lists = [(task / "children").read_text() for task in Path("/proc/self/task").iterdir()]
        return [int(pid) for pid in " ".join(lists).split()]
    except OSError:
        return [child.pid for child in psutil.Process().children()]
