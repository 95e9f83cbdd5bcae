"""`trocar bench gui`: cost of the web console, and its effect on io.

The full KINEMATIC system on the wall clock, homed, all arms moving all the time. The pages are scripted: they receive a
browser's messages, twenty times a second, and draw nothing. `gui_cpu_percent_system` is the console's process with one
page System open, `gui_cpu_percent_3d` with one page 3D, `gui_cpu_percent_no_browser` while it runs without any (100 %
is one core); usually there is no process then. `io_period_p99_ratio` is io's period (99 %) with both pages open to that
without the process, median of pairs by turns.

`--browser`: the same with Chromium in the place of the scripted pages, which draws as far as this machine can; figures
are apart (`browser_…`), `browser_cpu_percent_…` is the CPU time of the browser itself.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import threading
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from trocar.procs.machine.free_port import reserved_port
from trocar.shm.time.clock import pause
from trocar.tools.bench.beside import ARMS, PAIRS, TAKE_S, MovingArms, RobotAtWork, full_robot
from trocar.tools.bench.measuring import PATIENCE_S, wait_until
from trocar.tools.output.errors import Problem
from trocar.tools.systems.cleanup import own_folder

GUI: Final = "gui"
OTHERS: Final = ("SUJ", "console", "system", "MTMR_PSM1", "MTML_PSM2", "MTML_PSM3", "MTML_MTMR_ECM")
STRIP: Final = ("strip", "alarms")
"""Of every page."""
SYSTEM_PAGE: Final = (*(f"{name}/state" for name in (*ARMS, *OTHERS)), "messages", *STRIP)
SCENE_PAGE: Final = ("scene", *STRIP)
SETTLE_S: Final = 2.0
CHROMIUM: Final = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run")
LOADS_S: Final = 5.0


def run(seconds: float = 30.0, pairs: int = PAIRS, browser: bool = False) -> dict[str, Any]:
    """Measure. `seconds`: of each part of a pair."""
    name, short_s = f"bench-gui-{os.getpid()}", min(seconds, 10.0)
    if browser and shutil.which("chromium") is None:
        raise Problem("--browser needs Chromium: apt-get install chromium")
    with (own_folder(name) as folder, reserved_port(18080) as port,
          full_robot(name, f"gui.listen=127.0.0.1:{port}", "processes.gui.start=always"),
          closing(MovingArms(name)) as arms):
        robot, figures = RobotAtWork(name, arms.go_on), {}
        for key, pages in (("no_browser", ()), ("system", (SYSTEM_PAGE,)), ("3d", (SCENE_PAGE,))):
            with _scripted(port, *pages):
                robot.wait(min(SETTLE_S, seconds))
                figures[f"gui_cpu_percent_{key}"] = robot.cpu_percent(short_s, robot.process(GUI))
        figures["io_period_p99_ratio"] = robot.period_ratio(
            GUI, seconds, pairs, partial(_scripted, port, SYSTEM_PAGE, SCENE_PAGE), SETTLE_S)
        if browser:
            figures |= _in_browser(folder, robot, f"http://127.0.0.1:{port}", seconds, pairs)
    return {"figures": figures, "conditions": {"seconds": seconds, "pairs": pairs, "arms": len(ARMS), "rate_hz": 20}}


class ScriptedPage:
    """A page that receives its messages, and reconnects after a disconnection."""

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
        """Wait for a message; Problem if there is none."""
        wait_until(lambda: self.received, "something from the web console")

    def close(self) -> None:
        """The page disconnects."""
        self._is_over = True
        self._taker.join(PATIENCE_S)


class RealBrowser:
    """Chromium without a window, with pages open; it ends with us in any case."""

    def __init__(self, folder: Path, *addresses: str) -> None:
        home = tempfile.mkdtemp(dir=folder)
        self._popen = subprocess.Popen(
            ["setpriv", "--pdeathsig", "KILL", "chromium", *CHROMIUM, f"--user-data-dir={home}", *addresses],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def processes(self) -> list[psutil.Process]:
        """All processes of the browser."""
        own = psutil.Process(self._popen.pid)
        return [own, *own.children(recursive=True)]

    def close(self) -> None:
        """End it."""
        for process in reversed(self.processes()):
            with suppress(psutil.Error):
                process.kill()
        self._popen.wait()


def _in_browser(folder: Path, robot: RobotAtWork, here: str, seconds: float, pairs: int) -> dict[str, float]:
    figures, short_s = {}, min(seconds, 10.0)
    for key, path in (("system", "/"), ("3d", "/3d")):
        with closing(RealBrowser(folder, here + path)) as chromium:
            robot.wait(LOADS_S)
            figures[f"browser_gui_cpu_percent_{key}"] = robot.cpu_percent(short_s, robot.process(GUI))
            figures[f"browser_cpu_percent_{key}"] = robot.cpu_percent(short_s, *chromium.processes())
    figures["browser_io_period_p99_ratio"] = robot.period_ratio(
        GUI, seconds, pairs, lambda: closing(RealBrowser(folder, here, f"{here}/3d")), LOADS_S)
    return figures


def _scripted(port: int, *pages: tuple[str, ...]) -> ExitStack:
    """Pages, scripted; each has got something."""
    with ExitStack() as stack:
        for sources in pages:
            stack.enter_context(closing(ScriptedPage(port, sources))).wait()
        return stack.pop_all()
