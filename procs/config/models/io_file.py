"""Files of the hardware: IO files, PID files, and head sensors on USB."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from trocar.procs.config.read.sections import MatrixRows, Name, Rows, SafetyKeys, SafetySection, Section, VersionAsText
from trocar.procs.document.gains import PidAxis
from trocar.procs.document.keys import BOARD_ID
from trocar.procs.document.system import DigitalInput, DigitalOutput, InstrumentReader, Linear, Potentiometer, Tolerance

BoardId = Annotated[int, Field(ge=BOARD_ID.low, le=BOARD_ID.high, description=BOARD_ID.text)]


class DriveKeys(SafetySection):
    """Efforts (N·m or N) to currents (A) to DAC bits and back."""

    effort_to_current: SafetyKeys[Linear] = Linear()
    current_to_bits: SafetyKeys[Linear]
    bits_to_current: SafetyKeys[Linear]
    maximum_current: float = Field(default=0.0, ge=0.0, le=20.0, description="A")


class LimitKeys(SafetySection):
    """Soft position limits, rad or m."""

    lower: float
    upper: float


class EncoderKeys(SafetySection):
    """Counts to rad or m."""

    bits_to_position: SafetyKeys[Linear]
    position_limits_soft: LimitKeys
    velocity_source: Literal["FIRMWARE", "SOFTWARE"]


class ActuatorKeys(SafetySection):
    """One motor axis."""

    board_id: BoardId
    axis_id: int = Field(default=-1, ge=-1, le=9)
    joint_type: Literal["UNDEFINED", "REVOLUTE", "PRISMATIC"] = "UNDEFINED"
    drive: DriveKeys
    encoder: EncoderKeys | None = None
    potentiometer: SafetyKeys[Potentiometer] | None = None
    actuator_id: int | None = None  # written by the generator, but not used
    brake: dict[str, object] | None = None  # as above


class BrakeKeys(SafetySection):
    """One brake axis; currents in A, time in s."""

    board_id: BoardId
    axis_id: int = Field(default=-1, ge=-1, le=9)
    drive: DriveKeys
    release_current: float
    release_s: float = Field(ge=0.0, le=60.0, alias="release_time")
    released_current: float
    engaged_current: float
    brake_id: int | None = None  # written by the generator, but not used


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
    actuators: Rows[ActuatorKeys] = ()
    number_of_brakes: int = Field(ge=0, le=16)
    brakes: Rows[BrakeKeys] = ()
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
