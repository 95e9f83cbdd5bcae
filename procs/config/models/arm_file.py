"""Arm files (`dvrk-psm|ecm|mtm.schema.json`, version "1"): kinematics, tool and behaviour of one arm."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.read.validate import Section, VersionAsText
from trocar.procs.kinematics.endoscopes import NAMES

Pitch = Annotated[float, Field(ge=-3.2, le=3.2, description="rad")]


class ArmFile(Section):
    """Keys of all arm files; as in dVRK 2.4, these need not state their format."""

    id: str = Field(default="", alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(default="1", alias="$version")
    kinematic: str = Field(min_length=1, description="a kinematic file")
    generation: Literal["Classic", "Si"]
    homing_zero_position: bool | None = None
    mounting_pitch: Pitch | None = None
    re_home: bool = True
    skip_gravity_compensation: bool = False
    kinematic_gc: str = ""


class PsmFile(ArmFile):
    """A patient side manipulator."""

    id: Literal["dvrk-psm.schema.json"] = Field(default="dvrk-psm.schema.json", alias="$id")
    tool_detection: Literal["AUTOMATIC", "MANUAL", "FIXED"] = "AUTOMATIC"
    tool: str = Field(default="", description="NAME:MODEL or NAME:MODEL:VERSION")
    custom_tool_index: str = ""
    cannula_depth: float | None = Field(default=None, ge=0.0, le=1.0, description="m")


class EcmFile(ArmFile):
    """An endoscope arm."""

    id: Literal["dvrk-ecm.schema.json"] = Field(default="dvrk-ecm.schema.json", alias="$id")
    endoscope: Literal[NAMES]  # type: ignore[valid-type]  # they are made from kinds and looks
    mounting_pitch: Pitch


class MtmFile(ArmFile):
    """A master arm."""

    id: Literal["dvrk-mtm.schema.json"] = Field(default="dvrk-mtm.schema.json", alias="$id")
    platform_gain: float = Field(default=0.5, ge=0.0, le=1.0)
    gripper_events_debounce: float = Field(default=0.2, ge=0.0, description="s")
    gripper_events_zero: float = 0.0
    kinematic_type: Literal["ITERATIVE", "CLOSED"] = "ITERATIVE"
    gravity_compensation: str = ""
