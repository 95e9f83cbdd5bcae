"""All pages of the web console, as one application."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

import orjson
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import BUTTONS, MESSAGES, PROCESSES, SCENE
from trocar.procs.gui.fault_files import FAULT_FILES, FaultFiles
from trocar.procs.gui.meshes import MeshFiles
from trocar.procs.gui.packed import FOREVER, ONCE, Packed
from trocar.procs.gui.pages.arm import arm_page
from trocar.procs.gui.pages.assets import MEDIA, asset_files, assets
from trocar.procs.gui.pages.buttons import buttons_page
from trocar.procs.gui.pages.console import console_page
from trocar.procs.gui.pages.focus import focus_page
from trocar.procs.gui.pages.frame import absent_page, page, pages_of
from trocar.procs.gui.pages.operate import operate_page
from trocar.procs.gui.pages.pid import pid_page
from trocar.procs.gui.pages.plots import TOPICS, plots_page, topics_of
from trocar.procs.gui.pages.processes import processes_page
from trocar.procs.gui.pages.robot_io import io_page
from trocar.procs.gui.pages.scene import MESHES, scene_page
from trocar.procs.gui.pages.setup_joints import carts_page
from trocar.procs.gui.pages.system import system_page
from trocar.procs.gui.pages.teleop import teleop_page
from trocar.procs.gui.pid_file import PidFiles
from trocar.procs.gui.robots import robots_of, with_actuators, with_gains

MadePage = tuple[str, tuple[str, ...], Callable[[], None]]
"""Path, sources, and function that makes its content."""


def pages_of_system(document: SystemConfig) -> list[MadePage]:
    """All there are."""
    linked = {path for _, path in pages_of(document)}
    made: list[MadePage] = [
        ("/", (MESSAGES,), lambda: system_page(document)),
        ("/operate", (SCENE,), lambda: operate_page(document, linked)),
        ("/3d", (SCENE,), lambda: scene_page(document)),
        ("/console", (), partial(console_page, document)),
        ("/teleop", (), lambda: teleop_page(document)),
        ("/buttons", (BUTTONS,), partial(buttons_page, document)),
        ("/suj", (), partial(carts_page, document)),
        ("/focus", (), partial(focus_page, document)),
        ("/plots", (), lambda: plots_page(document)),
        ("/processes", (PROCESSES,), processes_page),
    ]
    made = [row for row in made if row[0] in linked]
    made += [(f"/arm/{arm.name}", (MESSAGES, SCENE), partial(arm_page, document, arm)) for arm in document.arms]
    robots = robots_of(document)
    for section, wants, content_of, found in (("io", (MESSAGES,), io_page, with_actuators(robots)),
                                              ("pid", (), pid_page, with_gains(robots))):
        made += [(path, wants, partial(content_of, found, robot)) for robot in found for path in
                 ((robot.path(section), f"/{section}") if robot is found[0] else (robot.path(section),))]
    return made


def texts_of_pages(document: SystemConfig) -> dict[str, bytes]:
    """All pages by their paths; by "" the one for other paths."""
    found = {}
    for path, wants, content in [*pages_of_system(document), ("", (), absent_page)]:
        with page(document, path, wants) as whole:
            content()
        found[path] = f"<!doctype html>{whole.html()}".encode()
    run = hashlib.sha256(b"".join(found.values())).hexdigest()[:16].encode()
    return {path: text.replace(b"<html ", b'<html data-run="%s" ' % run, 1) for path, text in found.items()}


def name_of(texts: dict[str, bytes]) -> str:
    """Name of these pages, which each of them has: another one for a system, or a version, whose pages differ."""
    return texts[""].split(b'data-run="', 1)[1].split(b'"', 1)[0].decode()


def application(document: SystemConfig, texts: dict[str, bytes], live: Callable[[WebSocket], Awaitable[None]],
                log: logging.Logger) -> Starlette:
    """The pages of a system, made before, their files, and their connection `live`."""
    routes: list[BaseRoute] = [WebSocketRoute("/live", live)]
    routes += [Route(path, Packed(text, "text/html", ONCE).answer) for path, text in texts.items() if path]
    routes.append(Route(f"{assets()}/{{name:path}}", _Assets().answer))
    routes.append(Route(f"{MESHES}/{{version}}/{{number}}", MeshFiles(document, log).answer))
    files = PidFiles(document.name)
    for robot in with_gains(robots_of(document)):
        routes.append(Route(f"/files{robot.path('pid')}.json", partial(files.answer, robot)))

    async def topics(_: Request) -> Response:
        return Response(orjson.dumps(topics_of(document.name)), media_type="application/json",
                        headers={"cache-control": ONCE})

    routes.append(Route(f"{FAULT_FILES}/{{name}}", FaultFiles(document).answer))

    absent = Packed(texts[""], "text/html", ONCE, status=404)

    async def not_found(request: Request, _: Exception) -> Response:
        return await absent.answer(request)

    made = Starlette(routes=[*routes, Route(TOPICS, topics)], exception_handlers={404: not_found})
    made.router.redirect_slashes = False
    return made


class _Assets:
    """Style and scripts, as they were at start."""

    def __init__(self) -> None:
        self._files = {name: Packed(text, MEDIA[Path(name).suffix], FOREVER) for name, text in asset_files().items()}
        asset_files.cache_clear()

    async def answer(self, request: Request) -> Response:
        """The file of this name."""
        file = self._files.get(request.path_params["name"])
        return Response("no such file", 404, media_type="text/plain") if file is None else await file.answer(request)
