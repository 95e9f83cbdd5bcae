"""Files of setup joints: potentiometers, brakes and geometry of the arms that carry PSMs and the ECM."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.models.kinematic_file import DhKeys
from trocar.procs.config.read.validate import MatrixRows, Name, Rows, Section

JOINTS, PLUGS = 6, 4

Joints = Annotated[Rows[float], Field(min_length=JOINTS, max_length=JOINTS, description=f"{JOINTS} numbers")]
Three = Annotated[Rows[float], Field(min_length=3, max_length=3, description="3 numbers")]
SetupName = Annotated[Name, Field(max_length=24)]
Address = Annotated[
    str, Field(pattern=r"^(([0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2})?$", description="a Bluetooth address; empty: no board")]


class FrameKeys(Section):
    """A pose, m."""

    Translation: Three
    Rotation: MatrixRows


class SetupArmKeys(Section):
    """One Classic setup arm: currents in A, potentiometers from V to rad or m."""

    name: SetupName
    type: Literal["ECM", "PSM", "Motorized PSM"]
    plug_number: int = Field(ge=1, le=PLUGS)
    serial_number: str = ""
    brake_release_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A")
    brake_engaged_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A")
    primary_offsets: Joints | None = None
    primary_scales: Joints | None = None
    secondary_offsets: Joints | None = None
    secondary_scales: Joints | None = None
    primary_secondary_weight: object = 0.5  # a number for all joints, or one for each
    simulated_position: Joints | None = None
    DH: DhKeys | None = None
    world_origin_to_SUJ: FrameKeys | None = None
    SUJ_tip_to_tool_origin: FrameKeys | None = None


class SetupFile(Section):
    """The arms of one Classic patient cart."""

    arms: Rows[SetupArmKeys] = Field(min_length=1)
    reference_arm: str = "ECM"


class SiArmKeys(Section):
    """One Si setup arm: potentiometers from counts to rad or m, read by a board over Bluetooth."""

    name: SetupName
    arduino_mac: Address | None = None
    serial_number: str = ""
    primary_offsets: Rows[float] | None = None
    primary_scales: Rows[float] | None = None
    secondary_offsets: Rows[float] | None = None
    secondary_scales: Rows[float] | None = None
    primary_secondary_weight: object = 0.5  # a number for all joints, or one for each
    simulated_position: Rows[float] | None = None
    DH: DhKeys | None = None
    world_origin_to_SUJ: FrameKeys | None = None
    SUJ_tip_to_tool_origin: FrameKeys | None = None


class SiSetupFile(Section):
    """The arms of one Si patient cart."""

    arms: Rows[SiArmKeys] = Field(min_length=1)
    base_arduino_mac: Address | None = None
    reference_arm: str = "ECM"


class FixedArmKeys(Section):
    """One arm in a fixed position."""

    name: SetupName
    measured_cp: MatrixRows


class FixedSetupFile(Section):
    """Arms on fixed stands."""

    arms: Rows[FixedArmKeys] = Field(min_length=1)
    reference_arm: str = "ECM"
    reference_arm_as_before: str = Field(default="", alias="reference-arm")  # the key that the original reads
