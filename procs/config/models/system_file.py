"""System files (`dvrk-system.schema.json`, version "1"): buses, arms, consoles, and their connections."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from trocar.procs.config.read.sections import MatrixRows, Name, Rows, SafetySection, Section, VersionAsText, keys_of
from trocar.procs.document.bridges import RosArm
from trocar.procs.document.consoles import TeleopEcmConfig, TeleopPsmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga.port_name import PORTS, PortName
from trocar.procs.tables.arm_types import ARM_TYPES

PERIOD_S = 1 / 1500  # as in the original, without its 60 µs of compensation for relative sleeps
TELEOP_PERIOD_S = 1 / 1000
WATCHDOG_S = 0.03

PROTOCOLS = {
    "sequential-read-write": "sequential-read-write",
    "srw": "sequential-read-write",
    "sequential-read-broadcast-write": "sequential-read-broadcast-write",
    "srbw": "sequential-read-broadcast-write",
    "broadcast-query-read-write": "broadcast-query-read-write",
    "bqrw": "broadcast-query-read-write",
    "brw": "broadcast-query-read-write",
}
RESERVED = frozenset({"boards", "supervisor", "system", "gui", "ros_bridge", "socket_bridge", "foxglove", "recorder"})
_EMIO = re.compile(r"emio(?::\d+)?\Z")  # allowed in dVRK files, but not supported here


def _known_port(port: str) -> str:
    if not _EMIO.match(port):
        PortName.parse(port)
    return port


Port = Annotated[str, AfterValidator(_known_port), Field(description=PORTS)]


class IoKeys(SafetySection):
    """One bus."""

    name: Name
    port: Port
    protocol: Literal[tuple(PROTOCOLS)] = "broadcast-query-read-write"  # type: ignore[valid-type]  # a table's
    period: float = Field(default=PERIOD_S, ge=0.0001, le=0.1, description="s")
    watchdog_timeout: float = Field(default=WATCHDOG_S, description="s; 0 or less switches it off")
    configuration_files: Rows[str] = ()
    close_all_relays: bool = True


class InterfaceKeys(SafetySection):
    """An interface of a component."""

    component: str
    interface: str


class IoDeviceKeys(SafetySection):
    """A device wired to a bus: pedals, head sensor, focus controller."""

    name: str = ""
    IO: str
    IO_file: str


class BaseFrameKeys(SafetySection):
    """Either a fixed transform, or an interface that provides it."""

    reference_frame: str | None = None
    transform: MatrixRows | None = None
    component: str | None = None
    interface: str | None = None


def _named(component: object) -> object:
    """A component given by its name alone."""
    return {"name": component} if isinstance(component, str) else component


@keys_of(RosArm)
class ComponentKeys(SafetySection):
    """The component that provides an arm; `from: ros`: an arm on ROS (docs/ros.md)."""

    name: str = ""
    source: Literal["ros"] | None = Field(default=None, alias="from")
    if TYPE_CHECKING:
        namespace: str | None = None
        domain: int | None = None
        interface: str | None = None
        check_names: bool = True


TYPES = (*(name + how for name in ARM_TYPES for how in ("", "_DERIVED", "_GENERIC")), "SUJ_Classic", "SUJ_Si",
         "SUJ_Fixed", "FOCUS_CONTROLLER")


class ArmKeys(SafetySection):
    """One arm."""

    name: Name
    type: Literal[TYPES]  # type: ignore[valid-type]  # they are made from the table of arm types
    name_on_IO: Name | None = None
    IO: str = ""
    serial: str = ""
    simulation: Literal["NONE", "KINEMATIC"] = "NONE"
    arm_file: str = ""
    IO_file: str = ""
    IO_gripper_file: str = ""
    PID_file: str = ""
    period: float = Field(default=PERIOD_S, ge=0.0001, le=0.1, description="s")
    PID_period: float = Field(default=0.0, ge=0.0, le=0.1, description="s; 0 runs the PID in the cycle of its bus")
    skip_ROS_bridge: bool = False
    component: Annotated[ComponentKeys, BeforeValidator(_named)] = ComponentKeys()
    interface: str = ""
    base_frame: BaseFrameKeys | None = None


_CLUTCH = {"clutch": "a clutch for one teleoperation; list this one in a console of its own that has the clutch"}


class GripperScalingKeys(SafetySection):
    """Gripper angles for closed and open, rad."""

    zero: float = 0.0
    max: float = 1.0471976


@keys_of(TeleopPsmConfig)
class TeleopPsmParameters(SafetySection):
    """Parameters of a PSM teleoperation; angles in rad."""

    gripper_scaling: GripperScalingKeys = GripperScalingKeys()


class TeleopPsmKeys(SafetySection):
    """Teleoperation of one slave by one master."""

    instead: ClassVar[Mapping[str, str]] = _CLUTCH
    type: Literal["TELEOP_PSM", "TELEOP_PSM_DERIVED", "TELEOP_PSM_GENERIC"] = "TELEOP_PSM"
    MTM: str
    PSM: str
    configure_parameter: TeleopPsmParameters | None = None
    period: float = Field(default=TELEOP_PERIOD_S, ge=0.0001, le=0.1, description="s")
    PSM_base_frame: InterfaceKeys | None = None
    component: str = ""
    interface: str = ""


@keys_of(TeleopEcmConfig)
class TeleopEcmParameters(SafetySection):
    """Parameters of an ECM teleoperation."""


class TeleopEcmKeys(SafetySection):
    """Teleoperation of the endoscope arm by two masters."""

    instead: ClassVar[Mapping[str, str]] = _CLUTCH
    type: Literal["TELEOP_ECM", "TELEOP_ECM_DERIVED", "TELEOP_ECM_GENERIC"] = "TELEOP_ECM"
    MTML: str
    MTMR: str
    ECM: str
    configure_parameter: TeleopEcmParameters | None = None
    period: float = Field(default=TELEOP_PERIOD_S, ge=0.0001, le=0.1, description="s")
    component: str = ""
    interface: str = ""


class ConsoleKeys(SafetySection):
    """One operator's console."""

    name: Name
    input_type: Literal["PEDALS_ONLY", "PEDALS_ISI_HEAD_SENSOR", "PEDALS_DVRK_HEAD_SENSOR", "PEDALS_GOOVIS_HEAD_SENSOR",
                        "SIMULATED", "COMPONENTS"]
    IO_pedals: IoDeviceKeys | None = None
    IO_head_sensor: IoDeviceKeys | None = None
    HID_file: str = ""
    clutch: InterfaceKeys | None = None
    camera: InterfaceKeys | None = None
    operator_present: InterfaceKeys | None = None
    teleop_PSMs: Rows[TeleopPsmKeys] = ()
    teleop_ECMs: Rows[TeleopEcmKeys] = ()


@keys_of(SystemConfig, "settings")
class SettingsKeys(Section):
    """Miscellaneous settings."""

    chatty: bool = False
    path: Rows[str] = ()


class SystemFile(Section):
    """The whole file."""

    id: Literal["dvrk-system.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(alias="$version")
    IOs: Rows[IoKeys] = ()
    arms: Rows[ArmKeys] = ()
    consoles: Rows[ConsoleKeys] = ()
    ISI_focus_controller: IoDeviceKeys | None = None
    settings: SettingsKeys = SettingsKeys()
    component_manager: object = None  # of any form: it is not used, see third_parties.py
    trocar: dict[str, object] | None = None  # checked separately: unknown keys are errors there
