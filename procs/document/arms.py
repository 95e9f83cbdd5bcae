"""Arms in the document: kinematic chains, instruments, and their robots and inputs on an io."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

from trocar.procs.document.bridges import RosArm
from trocar.procs.document.keys import Key
from trocar.procs.document.user_process import UserCommand
from trocar.procs.document.walls import Wall

Matrix = tuple[tuple[float, ...], ...]
MASTER_JOINTS: Final = 7
MODELLED_JOINTS: Final = 6  # all but the roll
MASS_TERMS: Final = 10  # of the masses
CABLE_ORDERS: Final = 5  # of a polynomial: 0 to 4
GRAVITY_PARAMETERS: Final = MASS_TERMS + MODELLED_JOINTS * CABLE_ORDERS


@dataclass(frozen=True, slots=True)
class DhLink:
    """One Denavit-Hartenberg row with limits and, if the file has them, inertial values."""

    name: Annotated[str, Key(default="")]
    joint_type: Annotated[str, Key(name="type", choices=("revolute", "prismatic"))]
    alpha: Annotated[float, Key()]
    a: Annotated[float, Key(name="A")]
    theta: Annotated[float, Key()]
    d: Annotated[float, Key(name="D")]
    offset: Annotated[float, Key(default=0.0)]
    lower: Annotated[float, Key(name="qmin", default=0.0)]
    upper: Annotated[float, Key(name="qmax", default=0.0)]
    effort_max: Annotated[float, Key(0.0, name="ftmax", default=0.0)]
    mass: Annotated[float, Key(0.0)] = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: Matrix = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    passive: bool = False


@dataclass(frozen=True, slots=True)
class Chain:
    """A kinematic file: convention "standard" or "modified", rows from base to tip."""

    convention: str
    links: tuple[DhLink, ...]
    base: Matrix | None = None  # base-offset, 4×4
    actuator_to_joint: Matrix | None = None
    source: str = ""


@dataclass(frozen=True, slots=True)
class JawConfig:
    """Range in rad, effort limit in N·m."""

    lower: Annotated[float, Key(name="qmin")]
    upper: Annotated[float, Key(name="qmax")]
    effort_max: Annotated[float, Key(0.0, name="ftmax")]


@dataclass(frozen=True, slots=True)
class Tool:
    """An instrument: rows appended to the arm's chain, its tip transform and the 4×4 actuator coupling."""

    name: str
    links: tuple[DhLink, ...]
    jaw: JawConfig
    tip: Matrix
    actuator_to_joint: Matrix
    engage_lower: tuple[float, ...]
    engage_upper: tuple[float, ...]
    snake: bool = False
    source: str = ""
    names: tuple[str, ...] = ()  # all its names: see `trocar.procs.document.catalogue`
    model: str = ""
    generation: str = ""  # of the instrument: Classic or S
    description: str = ""
    version_min: int | None = None
    version_max: int | None = None

    def needs_depth(self, generation: str) -> str:
        """Why an arm of `generation` needs the depth of its cannula in its file; "": it does not."""
        if not self.generation or (self.generation == "S") is (generation == "Si"):
            return ""
        return (f"an instrument of generation {self.generation} on an arm of generation {generation}: cannula_depth "
                "of the arm file must be that of the cannula in use, for engaging")


@dataclass(frozen=True, slots=True)
class MasterGravityParameters:
    """Measured on one master: (40,) for motion up and down, (7,) each: torques [N·m], velocities [rad/s], friction."""

    positive: Annotated[tuple[float, ...], Key(name="gc_dynamic_params_pos", length=GRAVITY_PARAMETERS)]
    negative: Annotated[tuple[float, ...], Key(name="gc_dynamic_params_neg", length=GRAVITY_PARAMETERS)]
    lower: Annotated[tuple[float, ...], Key(name="safe_lower_torque_limit", length=MASTER_JOINTS)]
    upper: Annotated[tuple[float, ...], Key(name="safe_upper_torque_limit", length=MASTER_JOINTS)]
    dead_band: Annotated[tuple[float, ...], Key(name="db_vel_vec", length=MASTER_JOINTS)]
    saturation: Annotated[tuple[float, ...], Key(name="sat_vec_vec", length=MASTER_JOINTS)]
    friction: Annotated[tuple[float, ...], Key(name="fric_comp_ratio_vec", length=MASTER_JOINTS)]


@dataclass(frozen=True, slots=True)
class ArmInputs:
    """Names of the arm's digital inputs on its io; "" if it has none."""

    clutch: str = ""  # on the arm itself
    adapter: str = ""
    tool: str = ""
    suj_clutch: str = ""
    suj_clutch_2: str = ""


@dataclass(frozen=True, slots=True)
class Mesh:
    """A file with a mesh, and its pose (4, 4) in the frame of its link."""

    file: str
    pose: Matrix
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class MeshLink:
    """A part of an arm that is shown: at `pose` (4, 4) in the frame of `parent`, a joint of the chain or another part.

    An empty parent is the base. A part that `follows` a joint of the chain turns about its own z, `times` as far.
    """

    name: str
    parent: str
    pose: Matrix
    follows: str = ""
    times: float = 0.0
    meshes: tuple[Mesh, ...] = ()

    def turn(self, positions: Mapping[str, float]) -> float:
        """Its angle (rad) about its own z for these positions of the chain's joints; 0 where they are not known."""
        angle = positions.get(self.follows, 0.0) * self.times
        return angle if math.isfinite(angle) else 0.0


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """One `arms[]` entry with the contents of its files."""

    name: str
    type: str  # PSM, ECM, MTM, ...
    generation: str  # Classic or Si
    serial: str
    io: str  # instance name of the io process that runs its robot
    robot: str  # its robot's name in that io
    simulation: str  # NONE or KINEMATIC
    period_s: float
    chain: Chain
    links: Chain | None = None  # with masses, for gravity compensation (kinematic_gc); None: no compensation
    tool_detection: str = "MANUAL"  # AUTOMATIC, MANUAL or FIXED
    tool: Tool | None = None
    tools: tuple[Tool, ...] = ()  # all instruments of the tool indexes, for MANUAL and AUTOMATIC detection
    homing_zero_position: bool = False
    cannula_depth: float = 0.0  # PSM, m; 0: that of its instrument
    inputs: ArmInputs = ArmInputs()
    instrument_reader: str = ""  # PSM: name of the reader of its instruments' memory
    endoscope: str = ""  # ECM: one of `trocar.procs.kinematics.endoscopes.NAMES`
    master_gravity: MasterGravityParameters | None = None  # MTM, from the file measured on it
    platform_gain: Annotated[float, Key(0.0, 1.0, of="MTM")] = 0.5
    gripper: str = ""  # MTM: the robot of its gripper, on the same io
    gripper_debounce_s: Annotated[  # time after which a closed gripper is reported as closed
        float, Key(0.0, text="s", name="gripper_events_debounce", of="MTM")] = 0.2
    gripper_zero: Annotated[  # rad; largest angle of a closed gripper
        float, Key(name="gripper_events_zero", of="MTM")] = 0.0
    mounting_pitch: float | None = None  # rad
    re_home: Annotated[bool, Key(of="arm file")] = True
    skip_gravity_compensation: bool = False  # then neither `links` nor `master_gravity`
    base_frame: Matrix | None = None
    reference_frame: str = ""
    base_from: str = ""  # the process `suj` that provides its base frame; "": none
    base_setup: str = ""  # the setup arm of that process that carries it
    use_setpoint_v: Annotated[bool, Key()] = True
    calibration_mode: bool = False
    jerk_time_s: Annotated[
        float, Key(0.0, 2.0, "s in which moves come up to their acceleration; 0: no jerk limit")] = 0.0
    client_timeout_s: Annotated[
        float, Key(0.0, 10.0, "s after the last servo command of a stream, then hold; 0: never")] = 0.0
    effort_timeout_s: Annotated[
        float, Key(0.0, 10.0, "s that efforts last unless they are sent again; 0: forever")] = 0.1
    effort_speed_ratio: Annotated[float, Key(0.0, 5.0, "times the usual limits of speed in effort mode; 0: none")] = 1.0
    effort_zone_ratio: Annotated[
        float, Key(0.0, 5.0, "times the usual zones of the soft walls at joint limits; 0: none")] = 1.0
    jaw_length: Annotated[
        float, Key(0.0, 0.1, "m, for walls: of jaws, from their hinge, which is the tip of the kinematics")] = 0.02
    wall_force: Annotated[
        float, Key(0.0, 5.0, "N of a master on the hand when a wall stops its PSM, at most; 0: none")] = 0.0
    walls: tuple[Wall, ...] = ()
    meshes: tuple[MeshLink, ...] = ()  # of a checkout of dvrk_model, parents first
    source: str = ""
    derived: str = ""  # a user's class for its process, module:Class; "": the class of its type
    commands: tuple[UserCommand, ...] = ()  # further commands of that class


@dataclass(frozen=True, slots=True)
class ThirdParty:
    """One place for a third-party program, which writes the record `state` of the kind `third_party` there.

    `inputs`: its buttons for consoles.
    """

    name: str
    type: str  # MTM_GENERIC, PSM_GENERIC or ECM_GENERIC; "": no arm, only buttons
    inputs: tuple[str, ...] = ()
    base_frame: Matrix | None = None  # of the arm's base in the reference frame
    reference_frame: str = ""
    ros: RosArm | None = None  # the arm is on ROS, and the program Trocar's (tools/from_ros)
