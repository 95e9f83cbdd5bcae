"""Kinematic files, tool files, the tool index, and weights measured on a master."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from trocar.procs.config.read.sections import Keys, MatrixRows, Rows, Section, keys_of
from trocar.procs.document.arms import DhLink, JawConfig, MasterGravityParameters


@keys_of(DhLink)
class LinkKeys(Section):
    """One Denavit-Hartenberg row; m, rad, kg, N·m or N. Inertia about the centre of mass in axes x, y, z."""

    convention: Literal["standard", "modified"] | None = None
    mode: Literal["active", "passive"] = "active"
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

    actuator_to_joint: MatrixRows = Field(alias="ActuatorToJointPosition")


class KinematicFile(Section):
    """A kinematic chain."""

    DH: DhKeys
    base: MatrixRows | None = Field(default=None, alias="base-offset")
    coupling: CouplingKeys | None = None


class EngageKeys(Section):
    """Actuator positions of the last four axes between which a tool is engaged, rad."""

    engage_lower: Rows[float] = Field(alias="lower")
    engage_upper: Rows[float] = Field(alias="upper")


class ToolFile(Section):
    """An instrument."""

    OLD_KEYS: ClassVar[dict[str, str]] = {  # of files from before dVRK 2.4
        "tooltip-offset": "tooltip_offset",
        "tool-engage-position": "tool_engage_position",
        "snake_like": "snake-like",
    }

    DH: DhKeys
    jaw: Keys[JawConfig]
    tip: MatrixRows = Field(alias="tooltip_offset")
    coupling: CouplingKeys
    tool_engage_position: EngageKeys
    snake: bool = Field(default=False, alias="snake-like")


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


@keys_of(MasterGravityParameters)
class GravityControllerKeys(Section):
    """Parameters for gravity compensation; the limits and start of the measurement are not used."""

    GC_init_pos: Any = None
    joint_position_upper_limit: Any = None
    joint_position_lower_limit: Any = None


class GravityFile(Section):
    """The whole file: parameters of the controller, and data of the measurement."""

    version: Literal["2.0"]
    GC_controller: GravityControllerKeys
    ARM_NAME: str = ""
    SN: str = ""
    date_time: str = ""
    lse: Any = None
    GC_Test: Any = None
