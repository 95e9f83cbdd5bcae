"""Files of the hardware: IO files, PID files, and head sensors on USB."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from trocar.procs.config.read.sections import MatrixRows, Name, Rows, SafetyKeys, SafetySection, Section, VersionAsText
from trocar.procs.document.gains import PidAxis
from trocar.procs.document.system import (
    Actuator,
    Brake,
    DigitalInput,
    DigitalOutput,
    InstrumentReader,
    Linear,
    Tolerance,
)


class EffortOffset(SafetySection):
    """A key that is not used."""

    offset: float = 0.0


class ActuatorDrive(SafetySection):
    """Efforts (N·m or N) to currents (A)."""

    effort_to_current: EffortOffset


class UnusedOfActuator(SafetySection):
    """Keys written by the generator, but not used."""

    further_keys_of = Actuator
    drive: ActuatorDrive
    actuator_id: int | None = None
    brake: dict[str, object] | None = None


class BrakeDrive(SafetySection):
    """A key that is not used: a brake has no effort."""

    effort_to_current: SafetyKeys[Linear] = Linear()


class UnusedOfBrake(SafetySection):
    """A key written by the generator, but not used."""

    further_keys_of = Brake
    drive: BrakeDrive
    brake_id: int | None = None


class ToleranceAxis(SafetySection):
    """The key of a tolerance that is not used, but checked."""

    further_keys_of = Tolerance
    axis_id: int = Field(ge=0, le=15)


class PotCouplingKeys(SafetySection):
    """Matrices in CamelCase, as in the files."""

    JointToActuatorPosition: MatrixRows | None = None
    ActuatorToJointPosition: MatrixRows | None = None
    JointToActuatorEffort: MatrixRows | None = None
    ActuatorToJointEffort: MatrixRows | None = None


class PotentiometersKeys(SafetySection):
    """A robot's potentiometers: type, tolerances and coupling."""

    potentiometers_type: Literal["UNDEFINED", "NONE", "ANALOG", "DIGITAL"]
    tolerances: Rows[SafetyKeys[Tolerance]] = ()
    coupling: PotCouplingKeys | None = None
    lookup_table_file: str = ""


class RobotKeys(SafetySection):
    """One robot."""

    name: Name
    serial: str = Field(alias="serial_number")
    hardware: Literal["HARDWARE_UNDEFINED", "QLA1", "DQLA", "dRA1"] = Field(
        default="HARDWARE_UNDEFINED", alias="hardware_version")
    number_of_actuators: int = Field(ge=0, le=16)
    actuators: Rows[SafetyKeys[Actuator]] = ()
    number_of_brakes: int = Field(ge=0, le=16)
    brakes: Rows[SafetyKeys[Brake]] = ()
    potentiometers: PotentiometersKeys | None = None
    only_IO: bool = False
    path: Rows[str] = ()
    has_encoder_preload: bool = False
    type: str = ""  # "io-only" in gripper files; the original software reads only_IO instead


class LogKeys(Section):
    """Log settings of the original software; read, but not used."""

    allow: str = ""
    separate_file: bool = Field(default=False, alias="separate-file")


class IoFile(Section):
    """The whole file."""

    id: Literal["saw-robot-io.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["6"], VersionAsText] = Field(alias="$version")
    robots: Rows[RobotKeys] = ()
    digital_inputs: Rows[SafetyKeys[DigitalInput]] = ()
    digital_outputs: Rows[SafetyKeys[DigitalOutput]] = ()
    dallas_chips: Rows[SafetyKeys[InstrumentReader]] = ()
    log: LogKeys | None = None


class GainIndex(SafetySection):
    """The key of an actuator that is no gain."""

    further_keys_of = PidAxis
    index: int = Field(ge=0, le=15)


class PidFile(Section):
    """The whole file; gains are N·m/rad, N·m·s/rad or N/m, N·s/m."""

    id: Literal["saw-controllers-pid.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(alias="$version")
    pid: Rows[SafetyKeys[PidAxis]] = Field(min_length=1)


MAX_REPORT: Final = 64  # bytes, of a full-speed device

UsbNumber = Annotated[str, Field(pattern=r"^(0[xX])?[0-9a-fA-F]{1,4}$", description="up to four hexadecimal digits"),
                      AfterValidator(lambda text: int(text, 16))]


class HidFile(Section):
    """Keys as in the original's `share/hid`; USB numbers are texts of up to four hexadecimal digits."""

    vendor: UsbNumber = Field(alias="id_vendor")
    product: UsbNumber = Field(alias="id_product")
    index: int = Field(alias="index_data", ge=0, lt=MAX_REPORT)
