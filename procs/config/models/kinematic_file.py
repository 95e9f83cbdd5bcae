"""Kinematic files, tool files and the tool index: Denavit-Hartenberg rows, limits, masses, couplings."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from trocar.procs.config.read.validate import MatrixRows, Rows, Section


class LinkKeys(Section):
    """One Denavit-Hartenberg row; m, rad, kg, N·m or N. Inertia about the centre of mass in axes x, y, z."""

    name: str = ""
    convention: Literal["standard", "modified"] | None = None
    type: Literal["revolute", "prismatic"]
    mode: Literal["active", "passive"] = "active"
    alpha: float
    A: float
    theta: float
    D: float
    offset: float = 0.0
    qmin: float = 0.0
    qmax: float = 0.0
    ftmax: float = Field(default=0.0, ge=0.0)
    mass: float = Field(default=0.0, ge=0.0)
    cx: float = 0.0
    cy: float = 0.0
    cz: float = 0.0
    Ixx: float = 0.0
    Iyy: float = 0.0
    Izz: float = 0.0
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0
    x1: float = 1.0
    x2: float = 0.0
    x3: float = 0.0
    y1: float = 0.0
    y2: float = 1.0
    y3: float = 0.0
    z1: float = 0.0
    z2: float = 0.0
    z3: float = 1.0


class DhKeys(Section):
    """The rows, under either of the two names in use."""

    convention: Literal["standard", "modified"] | None = None
    joints: Rows[LinkKeys] = ()
    links: Rows[LinkKeys] = ()


class CouplingKeys(Section):
    """Coupling of actuators to joints; the inverse, and that of efforts, are derived from it."""

    ActuatorToJointPosition: MatrixRows


class KinematicFile(Section):
    """A kinematic chain."""

    DH: DhKeys
    base_offset: MatrixRows | None = Field(default=None, alias="base-offset")
    coupling: CouplingKeys | None = None


class JawKeys(Section):
    """Range in rad, effort limit in N·m."""

    qmin: float
    qmax: float
    ftmax: float = Field(ge=0.0)


class EngageKeys(Section):
    """Actuator positions of the last four axes between which a tool is engaged, rad."""

    lower: Rows[float]
    upper: Rows[float]


class ToolFile(Section):
    """An instrument."""

    OLD_KEYS: ClassVar[dict[str, str]] = {  # of files from before dVRK 2.4
        "tooltip-offset": "tooltip_offset",
        "tool-engage-position": "tool_engage_position",
        "snake_like": "snake-like",
    }

    DH: DhKeys
    jaw: JawKeys
    tooltip_offset: MatrixRows
    coupling: CouplingKeys
    tool_engage_position: EngageKeys
    snake_like: bool = Field(default=False, alias="snake-like")


class InstrumentKeys(Section):
    """One entry of the index."""

    model: str = Field(pattern=r"^[^:\[\]]+$", description="a text without : [ ]")
    names: Rows[Annotated[str, Field(pattern=r"^[^:\[\]]+$", description="a text without : [ ]")]] = Field(min_length=1)
    description: str = ""
    generation: str = ""
    file: str = Field(min_length=1)
    version_min: int | None = Field(default=None, ge=0)
    version_max: int | None = Field(default=None, ge=0)


class ToolIndexFile(Section):
    """Instruments with their files."""

    instruments: Rows[InstrumentKeys] = Field(min_length=1)
