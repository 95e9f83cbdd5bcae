"""Files of Classic set-up joints: potentiometers and brakes of the passive arms that carry PSMs and the ECM."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from procs.lib.config.validate import Name, Rows, Section

JOINTS, PLUGS = 6, 4

Joints = Annotated[Rows[float], Field(min_length=JOINTS, max_length=JOINTS, description=f"{JOINTS} numbers")]


class SetupArmKeys(Section):
    """One passive arm: currents in A, potentiometers from V to rad or m."""

    name: Name
    type: Literal["ECM", "PSM", "Motorized PSM"]
    plug_number: int = Field(ge=1, le=PLUGS)
    serial_number: str = ""
    brake_release_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A")
    brake_engaged_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A")
    primary_offsets: Joints
    primary_scales: Joints
    secondary_offsets: Joints
    secondary_scales: Joints
    primary_secondary_weight: Rows[float] = ()
    simulated_position: Joints | None = None
    DH: dict[str, object] | None = None  # emulated boards don't care where the arms are in space
    world_origin_to_SUJ: dict[str, object] | None = None
    SUJ_tip_to_tool_origin: dict[str, object] | None = None


class SetupFile(Section):
    """The arms of one patient cart."""

    arms: Rows[SetupArmKeys] = Field(min_length=1)
    reference_arm: str = ""
