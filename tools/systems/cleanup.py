"""Cleanup after a killed verb that has started a system of its own.

A small process beside it waits for its end of any kind: the kernel closes the pipe between them. Unless the verb has
reported success before, this process ends the system and removes its shared memory and folder.
"""

from __future__ import annotations

import contextlib
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import FOLDER
from trocar.tools.output.errors import Problem
from trocar.tools.systems.ending import stop_system
from trocar.tools.systems.find import environment

FINE: Final = b"fine\n"
PATIENCE_S: Final = 10.0


def await_end(child: subprocess.Popen[bytes] | subprocess.Popen[str], patience_s: float) -> None:
    """Wait for the end of a child, and kill it if it does not end."""
    try:
        child.wait(timeout=patience_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


class Keeper(Closable):
    """The cleanup process beside ours, for one system and maybe a folder; a context manager."""

    def __init__(self, system: str, folder: Path | None = None) -> None:
        """Start it, in a session of its own: a signal to our process group does not end it."""
        words = [sys.executable, "-P", "-m", "trocar.tools.systems.cleanup", system,
                 *([str(folder)] if folder is not None else [])]
        self._child = subprocess.Popen(words, cwd=ROOT, env=environment(), stdin=subprocess.PIPE,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)

    def close(self) -> None:
        """No cleanup needed: the process may end."""
        assert self._child.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._child.stdin.write(FINE)
            self._child.stdin.close()
        await_end(self._child, PATIENCE_S)


@contextlib.contextmanager
def own_folder(system: str) -> Iterator[Path]:
    """A folder for measurements as `system`; it and all shared memory of that name are removed at the end."""
    folder = Path(tempfile.gettempdir(), f"trocar-{system}-{secrets.token_hex(4)}")  # short: iceoryx2 bounds paths
    with Keeper(system, folder):  # before there is anything to remove
        try:
            folder.mkdir(mode=0o700)
            yield folder
        finally:
            _remove(system, folder)


def _remove(system: str, folder: Path) -> None:
    """Segments of the system, the folder, and other shared memory under the name of the folder."""
    remove_all(system)
    for path in FOLDER.glob(f"{folder.name}_*"):
        path.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Wait for the end of the parent; the report it sent before decides the rest."""
    system, *folders = sys.argv[1:]
    if sys.stdin.buffer.read() == FINE:
        return
    with contextlib.suppress(Problem):
        stop_system(system, lambda text, part: None)
    for folder in folders:
        _remove(system, Path(folder))


if __name__ == "__main__":
    main()
