"""A real terminal of a given size, in tmux, for what draws on the whole of it."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.system.robot import ROOT, Robot

PATIENCE_S = 60.0


class Terminal:
    """One session with a shell, on a server of its own."""

    def __init__(self, robot: Robot, width: int, height: int) -> None:
        self._socket = f"t{os.getpid()}-{robot.name}-{width}"
        self._tmux("new-session", "-d", "-x", str(width), "-y", str(height), "-s", "look", "-c", str(ROOT),
                   "env", *(f"{key}={value}" for key, value in robot.environment.items() if key.startswith("TROCAR")),
                   f"PYTHONPATH={ROOT}", "PS1=ready> ", "TERM=tmux-256color", "bash", "--norc", "--noprofile")
        self.until("ready>")

    def _tmux(self, *words: str) -> str:
        done = subprocess.run(["tmux", "-L", self._socket, "-f", "/dev/null", *words], capture_output=True, text=True,
                              check=False)
        return done.stdout

    def trocar(self, *words: str) -> None:
        """Type a verb and Enter."""
        self.type(shlex.join([sys.executable, "-m", "trocar", *words]), "Enter")

    def type(self, *keys: str) -> None:
        """Press keys, or type words."""
        for key in keys:
            self._tmux("send-keys", "-t", "look", key)

    def screen(self) -> str:
        """What is on it now."""
        return self._tmux("capture-pane", "-p", "-t", "look")

    def until(self, *words: str) -> str:
        """The screen, when it shows all of these."""
        end = time.monotonic() + PATIENCE_S
        while True:
            shown = self.screen()
            if all(word in shown for word in words):
                return shown
            if time.monotonic() > end:
                pytest.fail(f"{words} not seen within {PATIENCE_S} s:\n{shown}")
            time.sleep(0.1)

    def close(self) -> None:
        """End it, and all in it."""
        self._tmux("kill-server")


@contextmanager
def terminal(robot: Robot, size: tuple[int, int]) -> Iterator[Terminal]:
    """A terminal beside a robot; the test is skipped where there is no tmux."""
    if shutil.which("tmux") is None:
        pytest.skip("no tmux: real terminals untested (apt-get install tmux)")
    made = Terminal(robot, *size)
    try:
        yield made
    finally:
        made.close()
