"""The page Operate: the robot in 3D in the middle, beside it panels, chosen one by one or by a preset."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import LIMITS, MESSAGES, PROCESSES, SCENE, STRIP
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, choice, head
from trocar.procs.gui.pages.processes import processes_card
from trocar.procs.gui.pages.scene import arm_scene
from trocar.procs.gui.pages.system import messages_card

PRESETS: Final = {"Operate": "jog links joints walls", "Tune": "joints pages", "Diagnose": "links messages processes",
                  "Commission": "jog joints messages pages"}
"""Panels of each."""
OTHERS: Final = (("Gains and steps", "/pid"), ("Plots", "/plots"), ("IO: checks, brakes, encoders", "/io"),
                 ("Buttons", "/buttons"), ("Setup joints", "/suj"))
PANELS: Final = {"jog": "Jog", "links": "Teleoperation", "joints": "Joints", "walls": "Walls", "pages": "Pages",
                 "messages": "Messages", "processes": "Processes"}


def operate_page(document: SystemConfig, linked: set[str]) -> None:
    """Its content; `linked`: paths of the pages that the system has."""
    script("operate.js")
    with box("row presets scroll"):
        for name, panels in PRESETS.items():
            Part("button", "", name, type="button", data_preset=panels)
        box("spacer")
        for panel, text in PANELS.items():
            Part("button", "quiet", text, type="button", data_opens_panel=panel, aria_pressed="false")
    with box("operate"):
        with box("side"):
            _jog(document)
            _links(document)
            _walls()
            _pages(document, linked)
        with box("card middle", data_source=SCENE):
            arm_scene(document)
        with box("side"):
            _joints()
        with box("below"):
            with _panel("messages", MESSAGES):
                messages_card(document)
            with _panel("processes", PROCESSES):
                processes_card()


@contextmanager
def _panel(name: str, source: str = "", classes: str = "") -> Iterator[None]:
    shows = {"data_source": source} if source else {}
    with Part("section", classes, data_panel=name, **shows, aria_label=PANELS[name], hidden=True):
        yield


def _jog(document: SystemConfig) -> None:
    with _panel("jog", LIMITS, "card"):
        head("h2", "", "Jog")
        with box("row"):
            choice(((arm.name, arm.name) for arm in document.arms), id="jog-arm", aria_label="Arm to jog")
            Part("select", id="jog-joint", aria_label="Joint to jog")
        with box("bigs"):
            for text, sign in (("−", -1), ("+", 1)):
                Part("button", "big commands", text, type="button", data_big=str(sign),
                     aria_label=f"Jog {'back' if sign < 0 else 'forward'}")
        with box("row"):
            Part("span", "quiet", "now")
            Part("b", "", "–", id="jog-now")
            box("spacer")
            Part("span", "quiet", "Moves while held, slowly.")


def _links(document: SystemConfig) -> None:
    if document.teleop_psms or document.teleop_ecms:
        with _panel("links", STRIP, "card"):
            head("h2", "", "Teleoperation")
            box("links", id="links")


def _joints() -> None:
    with _panel("joints", LIMITS, "card"):
        with head("h2", "", "Joints"):
            Part("span", "quiet", "▮ measured  ┃ setpoint  ◆ goal")
        box("limits", id="limits")


def _walls() -> None:
    with _panel("walls", SCENE, "card"):
        head("h2", "", "Walls")
        box("links", id="walls")


def _pages(document: SystemConfig, linked: set[str]) -> None:
    with _panel("pages", "", "card"):
        head("h2", "", "Pages", has_age=False)
        with Part("ul", "pages"):
            rows = [(text, path) for text, path in OTHERS if path in linked]
            for text, path in (*rows, *((arm.name, f"/arm/{arm.name}") for arm in document.arms)):
                with Part("li"):
                    Part("a", "", text, href=path)
