"""IO files (`saw-robot-io.schema.json`, version "6"): actuators, drives, sensors and inputs of the controllers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.read.validate import MatrixRows, Name, Rows, SafetySection, Section, VersionAsText

BoardId = Annotated[int, Field(ge=0, le=15, description="the controller's rotary switch")]


class LinearKeys(SafetySection):
    """scale · x + offset; both are 0 by default."""

    scale: float = 0.0
    offset: float = 0.0


class DriveKeys(SafetySection):
    """Efforts (N·m or N) to currents (A) to DAC bits and back."""

    effort_to_current: LinearKeys = LinearKeys()
    current_to_bits: LinearKeys
    bits_to_current: LinearKeys
    maximum_current: float = Field(default=0.0, ge=0.0, le=20.0, description="A")


class LimitKeys(SafetySection):
    """Soft position limits, rad or m."""

    lower: float
    upper: float


class EncoderKeys(SafetySection):
    """Counts to rad or m."""

    bits_to_position: LinearKeys
    position_limits_soft: LimitKeys
    velocity_source: Literal["FIRMWARE", "SOFTWARE"]


class PotentiometerKeys(SafetySection):
    """ADC bits to V to rad or m."""

    bits_to_voltage: LinearKeys
    voltage_to_position: LinearKeys = LinearKeys()


class ActuatorKeys(SafetySection):
    """One motor axis."""

    board_id: BoardId
    axis_id: int = Field(default=-1, ge=-1, le=9)
    joint_type: Literal["UNDEFINED", "REVOLUTE", "PRISMATIC"] = "UNDEFINED"
    drive: DriveKeys
    encoder: EncoderKeys | None = None
    potentiometer: PotentiometerKeys | None = None
    actuator_id: int | None = None  # written by the generator, but not used
    brake: dict[str, object] | None = None  # as above


class BrakeKeys(SafetySection):
    """One brake axis; currents in A, time in s."""

    board_id: BoardId
    axis_id: int = Field(default=-1, ge=-1, le=9)
    drive: DriveKeys
    release_current: float
    release_time: float = Field(ge=0.0, le=60.0)
    released_current: float
    engaged_current: float
    brake_id: int | None = None  # written by the generator, but not used


class ToleranceKeys(SafetySection):
    """Potentiometer against encoder: distance in rad or m, latency in s."""

    axis_id: int = Field(ge=0, le=15)
    distance: float = Field(ge=0.0)
    latency: float = Field(ge=0.0)


class PotCouplingKeys(SafetySection):
    """Matrices in CamelCase, as in the files."""

    JointToActuatorPosition: MatrixRows | None = None
    ActuatorToJointPosition: MatrixRows | None = None
    JointToActuatorEffort: MatrixRows | None = None
    ActuatorToJointEffort: MatrixRows | None = None


class PotentiometersKeys(SafetySection):
    """A robot's potentiometers: type, tolerances and coupling."""

    potentiometers_type: Literal["UNDEFINED", "NONE", "ANALOG", "DIGITAL"]
    tolerances: Rows[ToleranceKeys] = ()
    coupling: PotCouplingKeys | None = None
    lookup_table_file: str = ""


class RobotKeys(SafetySection):
    """One robot."""

    name: Name
    serial_number: str
    hardware_version: Literal["HARDWARE_UNDEFINED", "QLA1", "DQLA", "dRA1"] = "HARDWARE_UNDEFINED"
    number_of_actuators: int = Field(ge=0, le=16)
    actuators: Rows[ActuatorKeys] = ()
    number_of_brakes: int = Field(ge=0, le=16)
    brakes: Rows[BrakeKeys] = ()
    potentiometers: PotentiometersKeys | None = None
    only_IO: bool = False
    path: Rows[str] = ()
    has_encoder_preload: bool = False
    type: str = ""  # "io-only" in gripper files; the original software reads only_IO instead


class DigitalInputKeys(SafetySection):
    """One button or switch; times in s."""

    name: Name
    board_id: BoardId
    bit_id: int = Field(ge=0, le=31)
    pressed_value: bool
    trigger_when_pressed: bool
    trigger_when_released: bool
    skip_first_run: bool = False
    debounce_time: float = Field(default=0.0, ge=0.0, le=60.0, description="s")
    debounce_time_click: float = Field(default=0.0, ge=0.0, le=60.0, description="s")


class DigitalOutputKeys(SafetySection):
    """One output; times in s, frequency in Hz."""

    name: Name
    board_id: BoardId
    bit_id: int = Field(ge=0, le=31)
    high_duration: float = Field(default=0.0, ge=0.0)
    low_duration: float = Field(default=0.0, ge=0.0)
    is_PWM: bool = False
    PWM_frequency: float = Field(default=0.0, ge=0.0)


class DallasKeys(SafetySection):
    """One instrument memory."""

    name: Name
    board_id: BoardId


class LogKeys(Section):
    """Log settings of the original software; read, but not used."""

    allow: str = ""
    separate_file: bool = Field(default=False, alias="separate-file")


class IoFile(Section):
    """The whole file."""

    id: Literal["saw-robot-io.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["6"], VersionAsText] = Field(alias="$version")
    robots: Rows[RobotKeys] = ()
    digital_inputs: Rows[DigitalInputKeys] = ()
    digital_outputs: Rows[DigitalOutputKeys] = ()
    dallas_chips: Rows[DallasKeys] = ()
    log: LogKeys | None = None
