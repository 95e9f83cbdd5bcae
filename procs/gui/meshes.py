"""Meshes of arms for the pages: the files as they are, which browsers read (static/meshes.js).

A file from outside is never parsed in this process, which carries the commands of operators.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
from starlette.requests import Request
from starlette.responses import Response

from trocar.procs.document.arms import ArmConfig, Matrix
from trocar.procs.document.system import SystemConfig
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.procs.machine.mesh_file import MAX_BYTES, contents

READ: Final = (".stl", ".dae")
"""Formats that the pages can draw."""
CACHE: Final = "private, max-age=3600"


def mesh_files(document: SystemConfig) -> list[str]:
    """The files of all arms; pages and requests name one by its number in this list."""
    return list(dict.fromkeys(mesh.file for arm in document.arms for row in arm.meshes for mesh in row.meshes
                              if mesh.file.lower().endswith(READ)))


def version_of(files: Iterable[str]) -> str:
    """Part of the address of meshes: another one when a file has changed."""
    found = [(file, path.stat().st_mtime_ns, path.stat().st_size) if (path := Path(file)).exists() else file
             for file in files]
    return hashlib.sha256(repr(found).encode()).hexdigest()[:16]


def drawn_parts(arm: ArmConfig, files: list[str]) -> list[dict[str, Any]]:
    """The parts of an arm: `parent`, a number among the base, the joints of its chain, and these parts themselves;
    `pose` in it, x y z and quaternion x y z w; `meshes`, each with the number of its file."""
    frames = ["", *(link.name for link in arm.chain.links), *(row.name for row in arm.meshes)]
    return [{"parent": frames.index(row.parent), "pose": _pose(row.pose), "meshes": [
        {"file": files.index(mesh.file), "pose": _pose(mesh.pose), "scale": list(mesh.scale)}
        for mesh in row.meshes if mesh.file in files]} for row in arm.meshes]


def _pose(matrix: Matrix) -> list[float]:
    return [round(value, 6) for value in pose_from_matrix(np.array(matrix)).tolist()]


class MeshFiles:
    """Serves the files that the document names, and no others."""

    def __init__(self, document: SystemConfig, log: logging.Logger) -> None:
        self._files = {str(number): Path(file) for number, file in enumerate(mesh_files(document))}
        self._log, self._reported = log, set[str]()

    async def answer(self, request: Request) -> Response:
        """The file with the number in the path."""
        return await self.file(request.path_params["number"])

    async def file(self, number: str) -> Response:
        """One by its number, or the reason why there is none, which is logged once."""
        path = self._files.get(number)
        if path is None:
            return Response("no such mesh", 404, media_type="text/plain")
        media, data = await asyncio.to_thread(contents, path)
        if data:
            return Response(data, media_type=media, headers={"cache-control": CACHE})
        why = f"{path.name} cannot be read or has more than {MAX_BYTES // 1_000_000} MB"
        if number not in self._reported:
            self._reported.add(number)
            self._log.warning("3D: a mesh is not shown: %s", why)
        return Response(why, 404, media_type="text/plain", headers={"cache-control": "no-store"})
