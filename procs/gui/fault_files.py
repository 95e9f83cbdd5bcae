"""The recordings of faults as files to save: `/files/recordings/NAME`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.gate import FILES
from trocar.procs.gui.packed import ONCE
from trocar.procs.machine.paths import recordings_folder
from trocar.procs.recordings import names
from trocar.procs.recordings.folder import kept

FAULT_FILES: Final = f"{FILES}recordings"
MEDIA: Final = "application/octet-stream"
AT_A_TIME: Final = 2
"""Files that are sent; further requests are refused."""


def recordings_of(document: SystemConfig) -> Path | None:
    """Folder of its recordings; None if nothing is recorded."""
    recorder = document.recorder
    return recordings_folder(os.environ, document.name, recorder.folder) if recorder is not None else None


class FaultFiles:
    """The files in the folder of a system, as they are at the request."""

    def __init__(self, document: SystemConfig) -> None:
        self._folder = recordings_of(document)
        self._sent = 0

    async def answer(self, request: Request) -> Response:
        """The file of this name; other files of the folder are none."""
        name = request.path_params["name"]
        found = [file.path for file in kept(self._folder, names.FAULT)] if self._folder is not None else []
        path = next((path for path in found if path.name == name), None)
        if path is None:
            return Response("no such recording: the oldest ones are removed", 404, media_type="text/plain")
        if self._sent >= AT_A_TIME:
            return Response(f"{self._sent} recordings are being saved; try again later", 503, media_type="text/plain")
        return _CountedFile(self, path)

    def count(self, change: int) -> None:
        """A file begins, or has ended."""
        self._sent += change


class _CountedFile(FileResponse):
    def __init__(self, files: FaultFiles, path: Path) -> None:
        super().__init__(path, media_type=MEDIA, filename=path.name, headers={"cache-control": ONCE})
        self._files = files

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self._files.count(1)
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._files.count(-1)
