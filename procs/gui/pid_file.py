"""The gains in use as a PID file for download: the output of `trocar pid save`."""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from trocar.procs.gui.robots import IoRobot

DUE_S: Final = 30.0
WAITING: Final = 4
"""Maximum number of requests at a time, including the one being made."""
NOTES: Final = 400
"""Letters of them that fit beside a file."""


class PidFiles:
    """Makes them one at a time, each in a process of its own: reading and checking files delays no page."""

    def __init__(self, system: str) -> None:
        self._system, self._one, self._asked = system, asyncio.Lock(), 0

    async def answer(self, robot: IoRobot, _: Request) -> Response:
        """The answer to a request for the file of a robot."""
        return await self.file(robot)

    async def file(self, robot: IoRobot) -> Response:
        """The file of a robot, or the reason why there is none."""
        if self._asked >= WAITING:
            return Response(f"{WAITING} files are being written: try again later", 503, media_type="text/plain")
        self._asked += 1
        try:
            async with self._one:
                return await self._made(robot)
        finally:
            self._asked -= 1

    async def _made(self, robot: IoRobot) -> Response:
        with tempfile.TemporaryDirectory(prefix="trocar-") as place:
            made = Path(place) / f"PID-{robot.robot.name}.json"
            code, said = await self._run("pid", "save", robot.robot.name, str(made), "--system", self._system)
            if code or not made.is_file():
                return Response(said or "no file was written", 409, media_type="text/plain")
            notes = said.replace(str(made), made.name).encode("ascii", "replace").decode()[:NOTES]
            return Response(made.read_bytes(), media_type="application/json", headers={
                "content-disposition": f'attachment; filename="{made.name}"', "cache-control": "no-store",
                "x-notes": "; ".join(notes.splitlines())})

    async def _run(self, *words: str) -> tuple[int, str]:
        running = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "trocar", *words, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT)
        try:
            said, _ = await asyncio.wait_for(running.communicate(), DUE_S)
        except TimeoutError:
            running.kill()
            await running.wait()
            return 1, f"it took longer than {DUE_S:g} s"
        return running.returncode or 0, said.decode(errors="replace").strip()
