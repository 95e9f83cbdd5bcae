"""Arm files (`dvrk-psm|ecm|mtm.schema.json`, version "1"), and files of setup joints, which carry the arms."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.models.kinematic_file import DhKeys
from trocar.procs.config.read.sections import MatrixRows, Name, Rows, Section, VersionAsText, keys_of
from trocar.procs.document.arms import ArmConfig
from trocar.procs.kinematics.endoscopes import NAMES

Pitch = Annotated[float, Field(ge=-3.2, le=3.2, description="rad")]


@keys_of(ArmConfig, "arm file")
class ArmFile(Section):
    """Keys of all arm files; as in dVRK 2.4, these need not state their format."""

    id: str = Field(default="", alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(default="1", alias="$version")
    kinematic: str = Field(min_length=1, description="a kinematic file")
    generation: Literal["Classic", "Si"]
    homing_zero_position: bool | None = None
    mounting_pitch: Pitch | None = None
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


@keys_of(ArmConfig, "MTM")
class MtmFile(ArmFile):
    """A master arm."""

    id: Literal["dvrk-mtm.schema.json"] = Field(default="dvrk-mtm.schema.json", alias="$id")
    kinematic_type: Literal["ITERATIVE", "CLOSED"] = "ITERATIVE"
    gravity_compensation: str = ""


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


class MeasuredArmKeys(Section):
    """One setup arm with potentiometers, from V (Si: counts) to rad or m."""

    name: SetupName
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


class SetupArmKeys(MeasuredArmKeys):
    """One Classic setup arm: currents in A."""

    type: Literal["ECM", "PSM", "Motorized PSM"]
    plug: int = Field(ge=1, le=PLUGS, alias="plug_number")
    release_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A", alias="brake_release_current")
    engaged_current: float = Field(default=0.0, ge=-20.0, le=20.0, description="A", alias="brake_engaged_current")
    primary_offsets: Joints | None = None
    primary_scales: Joints | None = None
    secondary_offsets: Joints | None = None
    secondary_scales: Joints | None = None
    simulated_position: Joints | None = None

    @property
    def lifts(self) -> bool:
        """Whether a motor moves its first joint."""
        return self.type == "Motorized PSM"


class SetupFile(Section):
    """The arms of one Classic patient cart."""

    arms: Rows[SetupArmKeys] = Field(min_length=1)
    reference_arm: str = "ECM"


class SiArmKeys(MeasuredArmKeys):
    """One Si setup arm, with a board that reads its potentiometers over Bluetooth."""

    arduino_mac: Address | None = None


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
