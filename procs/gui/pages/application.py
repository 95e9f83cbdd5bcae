"""All pages of the web console, as one application."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

from fastapi import FastAPI
from nicegui import app, ui

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import BUTTONS, MESSAGES, PROCESSES, SCENE
from trocar.procs.gui.meshes import MeshFiles
from trocar.procs.gui.pages.arm import arm_page
from trocar.procs.gui.pages.assets import STATIC, assets
from trocar.procs.gui.pages.buttons import buttons_page
from trocar.procs.gui.pages.console import console_page
from trocar.procs.gui.pages.focus import focus_page
from trocar.procs.gui.pages.frame import page
from trocar.procs.gui.pages.pid import pid_page
from trocar.procs.gui.pages.plots import plots_page
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
    made: list[MadePage] = [
        ("/", (MESSAGES,), lambda: system_page(document)),
        ("/3d", (SCENE,), lambda: scene_page(document)),
        ("/console", (), partial(console_page, document)),
        ("/teleop", (), lambda: teleop_page(document)),
        ("/buttons", (BUTTONS,), partial(buttons_page, document)),
        ("/suj", (), partial(carts_page, document)),
        ("/focus", (), partial(focus_page, document)),
        ("/plots", (), lambda: plots_page(document)),
        ("/processes", (PROCESSES,), processes_page),
    ]
    made += [(f"/arm/{arm.name}", (MESSAGES, SCENE), partial(arm_page, document, arm)) for arm in document.arms]
    robots = robots_of(document)
    for section, content_of, found in (("io", io_page, with_actuators(robots)), ("pid", pid_page, with_gains(robots))):
        made += [(path, (), partial(content_of, found, robot)) for robot in found for path in
                 ((robot.path(section), f"/{section}") if robot is found[0] else (robot.path(section),))]
    return made


def application(document: SystemConfig, log: logging.Logger) -> FastAPI:
    """The pages of a system."""
    app.add_static_files(assets(), str(STATIC), max_cache_age=86400)
    for path, wants, content in pages_of_system(document):
        _add(document, path, wants, content)
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    files = PidFiles(document.name)
    for robot in with_gains(robots_of(document)):
        outer.add_api_route(f"/files{robot.path('pid')}.json", partial(files.file, robot), response_model=None)
    outer.add_api_route(f"{MESHES}/{{number}}", MeshFiles(document, log).file, response_model=None)
    ui.run_with(outer, title=f"Trocar {document.name}", dark=None, tailwind=False, show_welcome_message=False,
                binding_refresh_interval=None, reconnect_timeout=5.0, message_history_length=0)
    return outer


def _add(document: SystemConfig, path: str, wants: tuple[str, ...], content: Callable[[], None]) -> None:
    @ui.page(path)
    def show() -> None:
        with page(document, path, wants):
            content()
