"""The page 3D: all arms in their current poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import SCENE
from trocar.procs.gui.gate import FILES
from trocar.procs.gui.meshes import drawn_parts, mesh_files, version_of
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box

MESHES: Final = f"{FILES}mesh"
VIEWS: Final = (("all", "All"), ("operator", "Operator's view"), ("front", "Front"), ("side", "Side"), ("top", "Top"))


def arm_scene(document: SystemConfig, only: str = "") -> None:
    """Arms in 3D, `only` one or all, moved by the source `scene`."""
    script("stage.js")
    files = mesh_files(document)
    drawn = {"arms": {arm.name: _drawn(document, arm, files) for arm in document.arms if only in ("", arm.name)},
             "only": only, "meshes": {"folder": f"{MESHES}/{version_of(files)}",
                                      "names": [Path(file).name for file in files]}}
    with box("stage small" if only else "stage", data_drawn=json.dumps(drawn)):
        Part("canvas")
        box("names")


def _drawn(document: SystemConfig, arm: ArmConfig, files: list[str]) -> dict[str, Any]:
    """Data that a page needs to draw an arm, and to pull on its emulated robot."""
    same = [other.name for other in document.arms if other.type == arm.type]
    return {"type": arm.type, "colour": same.index(arm.name), "robot": _emulated(document, arm),
            "parts": drawn_parts(arm, files), "joints": len(arm.chain.links)}


def _emulated(document: SystemConfig, arm: ArmConfig) -> str:
    """The robot on emulated boards that is this arm's; empty where there is none."""
    if document.emulation is None or arm.simulation == "KINEMATIC":
        return ""
    robots = [robot.name for io in document.emulated().ios for robot in io.robots]
    return next((name for name in (arm.robot, f"{arm.io}/{arm.robot}") if name in robots), "")


def scene_page(document: SystemConfig) -> None:
    """Its content."""
    with box("card wide", data_source=SCENE):
        with box("row head"):
            for view, text in VIEWS:
                Part("button", "", text, type="button", data_view=view)
            if any(arm.type == "MTM" for arm in document.arms):
                Part("button", "", "Masters", type="button", data_view="masters")
            box("spacer")
            Part("span", "age")
            Part("span", "quiet", "Drag to turn, wheel to zoom, right button to shift. Orange: a joint near its limit.")
        if any(_emulated(document, arm) for arm in document.arms):
            Part("p", "quiet", "These robots are emulated: drag a tip to pull it by hand. Masters follow easily.")
        arm_scene(document)
