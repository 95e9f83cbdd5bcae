"""`trocar bench gui`: what the web console costs, and whether io notices it.

The full KINEMATIC system on the wall clock, homed, all arms moving all the time. The pages are scripted: they take what
a browser would be sent, twenty times a second, and draw nothing. `gui_cpu_percent_system` is the console's process with
one page System open, `gui_cpu_percent_3d` with one page 3D, `gui_cpu_percent_no_browser` while it runs without any
(100 % is one core); usually there is no process then. `io_period_p99_ratio` is io's period (99 %) with both pages open
to that without the process, median of pairs by turns.

`--browser`: the same with Chromium in the place of the scripted pages, which draws as far as this machine can; figures
are apart (`browser_…`), `browser_cpu_percent_…` is what it takes itself.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import statistics
import subprocess
import tempfile
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing, suppress
from typing import Any, Final

import numpy as np
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from shm import directory
from shm.client import Client
from shm.clock import monotonic_ns, pause
from shm.control_page import ControlPage
from tools.arms import home
from tools.bench.system import FULL
from tools.errors import Problem
from tools.free_port import reserved_port
from tools.remote import Remote
from tools.supervising import StartRequest, up_meanwhile

GUI: Final = "gui"
ARMS: Final = ("PSM1", "PSM2", "PSM3", "ECM", "MTML", "MTMR")
OTHERS: Final = ("SUJ", "console", "system", "MTMR_PSM1", "MTML_PSM2", "MTML_PSM3", "MTML_MTMR_ECM")
SYSTEM_PAGE: Final = (*(f"{name}/state" for name in (*ARMS, *OTHERS)), "messages")
SCENE_PAGE: Final = ("scene",)
PAIRS: Final = 5
TAKE_S: Final = 0.02
TURN_NS: Final = 1_000_000_000
SETTLE_S: Final = 2.0
PATIENCE_S: Final = 30.0
CHROMIUM: Final = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run")
LOADS_S: Final = 5.0


class MovingArms:
    """Small moves of all arms, to and fro."""

    def __init__(self, system: str) -> None:
        self._clients = [Client(system, name) for name in ARMS]
        self._sizes = [7 if name.startswith("MTM") else 4 if name == "ECM" else 6 for name in ARMS]
        self._turn_ns, self._sign = 0, 1.0

    def go_on(self) -> None:
        """Turn round where it is time to."""
        now_ns = monotonic_ns()
        if now_ns < self._turn_ns:
            return
        self._turn_ns, self._sign = now_ns + TURN_NS, -self._sign
        for client, size in zip(self._clients, self._sizes, strict=True):
            client.poll()
            increment = np.zeros(size)
            increment[0] = 0.03 * self._sign
            client.send("move_jr", increment)

    def close(self) -> None:
        """Let them come to rest."""
        for client in self._clients:
            client.close()


def run(seconds: float = 30.0, pairs: int = PAIRS, browser: bool = False) -> dict[str, Any]:
    """Measure; returns the object that `--json` prints. `seconds`: of each part of a pair."""
    name, short_s = f"bench-gui-{os.getpid()}", min(seconds, 10.0)
    if browser and shutil.which("chromium") is None:
        raise Problem("--browser needs Chromium: apt-get install chromium")
    with reserved_port(18080) as port, up_meanwhile(StartRequest(FULL, name, sets=(
            "clock=wall", f"gui.listen=127.0.0.1:{port}", "processes.gui.start=always"))):
        home(name)
        with closing(MovingArms(name)) as arms:
            figures = {}
            for key, pages in (("no_browser", ()), ("system", (SYSTEM_PAGE,)), ("3d", (SCENE_PAGE,))):
                with ExitStack() as stack:
                    for sources in pages:
                        stack.enter_context(closing(ScriptedPage(port, sources))).wait()
                    _wait(arms, min(SETTLE_S, seconds))
                    figures[f"gui_cpu_percent_{key}"] = _cpu_percent(_console(name), arms, short_s)
            figures["io_period_p99_ratio"] = _ratio(name, arms, seconds, pairs, lambda: _scripted(port))
            if browser:
                figures |= _in_browser(name, port, arms, seconds, pairs)
    return {
        "bench": GUI, "figures": figures,
        "conditions": {"seconds": seconds, "pairs": pairs, "arms": len(ARMS), "rate_hz": 20,
                       "cores": len(psutil.Process().cpu_affinity() or []), "load": os.getloadavg()[0],
                       "kernel": platform.release(), "python": platform.python_version()},
    }


class ScriptedPage:
    """A page that takes what it is sent, and comes again where it was disconnected."""

    def __init__(self, port: int, sources: tuple[str, ...]) -> None:
        self.received, self._is_over = 0, False
        self._address, self._sources = f"ws://127.0.0.1:{port}/live", sources
        self._taker = threading.Thread(target=self._take, daemon=True)
        self._taker.start()

    def _take(self) -> None:
        while not self._is_over:
            try:
                with connect(self._address, max_size=None, compression=None) as link:
                    link.send(json.dumps({"op": "want", "sources": self._sources}))
                    while not self._is_over:
                        self.received += '"tick"' in str(link.recv(PATIENCE_S))[:20]
            except (ConnectionClosed, OSError):
                pause(TAKE_S)

    def wait(self) -> None:
        """Until something has come; Problem where nothing comes."""
        end = monotonic_ns() + round(PATIENCE_S * 1e9)
        while not self.received:
            if monotonic_ns() > end:
                raise Problem("the web console has sent nothing")
            pause(TAKE_S)

    def close(self) -> None:
        """It has gone."""
        self._is_over = True
        self._taker.join(PATIENCE_S)


class RealBrowser:
    """Chromium without a window, with pages open."""

    def __init__(self, *addresses: str) -> None:
        self._home = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._popen = subprocess.Popen(["chromium", *CHROMIUM, f"--user-data-dir={self._home.name}", *addresses],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def processes(self) -> list[psutil.Process]:
        """All of it."""
        own = psutil.Process(self._popen.pid)
        return [own, *own.children(recursive=True)]

    def close(self) -> None:
        """End it."""
        for process in reversed(self.processes()):
            with suppress(psutil.Error):
                process.kill()
        self._popen.wait()
        self._home.cleanup()


def _in_browser(name: str, port: int, arms: MovingArms, seconds: float, pairs: int) -> dict[str, float]:
    figures, here = {}, f"http://127.0.0.1:{port}"
    for key, path in (("system", "/"), ("3d", "/3d")):
        with closing(RealBrowser(here + path)) as chromium:
            _wait(arms, LOADS_S)
            figures[f"browser_gui_cpu_percent_{key}"] = _cpu_percent(_console(name), arms, min(seconds, 10.0))
            figures[f"browser_cpu_percent_{key}"] = _cpu_percent(chromium.processes(), arms, min(seconds, 10.0))
    figures["browser_io_period_p99_ratio"] = _ratio(name, arms, seconds, pairs,
                                                    lambda: closing(RealBrowser(here, f"{here}/3d")), LOADS_S)
    return figures


def _scripted(port: int) -> AbstractContextManager[Any]:
    """A page System and a page 3D."""
    stack = ExitStack()
    for sources in (SYSTEM_PAGE, SCENE_PAGE):
        stack.enter_context(closing(ScriptedPage(port, sources)))
    return stack


def _wait(arms: MovingArms, seconds: float) -> None:
    end = monotonic_ns() + round(seconds * 1e9)
    while monotonic_ns() < end:
        pause(TAKE_S)
        arms.go_on()


def _console(system: str) -> list[psutil.Process]:
    with closing(ControlPage(system, GUI)) as page:
        return [psutil.Process(int(page.get("pid")))]


def _cpu_percent(processes: list[psutil.Process], arms: MovingArms, seconds: float) -> float:
    """CPU time that they take in a while in which arms move."""
    before, begin = _cpu_s(processes), monotonic_ns()
    _wait(arms, seconds)
    return (_cpu_s(processes) - before) / ((monotonic_ns() - begin) * 1e-9) * 100.0


def _cpu_s(processes: list[psutil.Process]) -> float:
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def _ratio(system: str, arms: MovingArms, seconds: float, pairs: int,
           pages: Callable[[], AbstractContextManager[Any]], settle_s: float = SETTLE_S) -> float:
    ratios = []
    with Remote(system, "supervisor") as remote:
        for _ in range(pairs):
            with pages():
                _wait(arms, min(settle_s, seconds))
                with_pages = _period_p99(system, arms, seconds)
            _ask(remote, "stop")
            ratios.append(with_pages / _period_p99(system, arms, seconds))
            _ask(remote, "start")
    return statistics.median(ratios)


def _ask(remote: Remote, command: str) -> None:
    reply = remote.settled(command, text=GUI, timeout=PATIENCE_S)
    if reply.outcome != "done":
        raise Problem(f"{command} {GUI} was {reply.outcome}: {reply.text}")


def _period_p99(system: str, arms: MovingArms, seconds: float) -> float:
    """99 % of io's periods in a while in which arms move, s."""
    with closing(directory.reader(system, "io", "state")) as ring:
        ring.newest()
        seen, stamps, end = ring.stamp_ns, [], monotonic_ns() + round(seconds * 1e9)
        while monotonic_ns() < end:
            pause(TAKE_S)
            arms.go_on()
            rows = ring.since(seen + 1)
            seen = int(rows[-1]["stamp_ns"]) if len(rows) else seen
            stamps.append(rows["stamp_ns"])
    return float(np.percentile(np.diff(np.unique(np.concatenate(stamps))), 99)) * 1e-9
