"""The frozen document: one system as plain values, parsed and checked once and passed to every process.

The supervisor makes it from the users' files (`procs/config`); every other process decodes it from JSON with the
standard library alone, so that `io` starts fast and needs no configuration library. All numbers are SI (m, rad, s, N,
N·m, A, V); matrices are row-major nested tuples.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Annotated, Final, TypeVar

from trocar.procs.document.arms import ArmConfig as ArmConfig
from trocar.procs.document.arms import ArmInputs as ArmInputs
from trocar.procs.document.arms import Chain as Chain
from trocar.procs.document.arms import DhLink as DhLink
from trocar.procs.document.arms import JawConfig as JawConfig
from trocar.procs.document.arms import Matrix as Matrix
from trocar.procs.document.arms import ThirdParty as ThirdParty
from trocar.procs.document.arms import Tool as Tool
from trocar.procs.document.bridges import FoxgloveServer as FoxgloveServer
from trocar.procs.document.bridges import RosBridge as RosBridge
from trocar.procs.document.bridges import SocketBridge as SocketBridge
from trocar.procs.document.bridges import WebConsole as WebConsole
from trocar.procs.document.cart import Cart as Cart
from trocar.procs.document.cart import CartArm as CartArm
from trocar.procs.document.consoles import Console as Console
from trocar.procs.document.consoles import Focus as Focus
from trocar.procs.document.consoles import TeleopEcmConfig as TeleopEcmConfig
from trocar.procs.document.consoles import TeleopPsmConfig as TeleopPsmConfig
from trocar.procs.document.consoles import WiredInput as WiredInput
from trocar.procs.document.decoding import decode
from trocar.procs.document.emulated import BusConfig as BusConfig
from trocar.procs.document.emulated import Controller as Controller
from trocar.procs.document.emulated import EmulatedSetupJoints as EmulatedSetupJoints
from trocar.procs.document.emulated import ModelVariation as ModelVariation
from trocar.procs.document.emulated import Quirks as Quirks
from trocar.procs.document.emulated_names import with_names_on_boards
from trocar.procs.document.gains import PidAxis as PidAxis
from trocar.procs.document.keys import AXIS_ID, BIT_ID, BOARD_ID, MADE, NAME, Key
from trocar.procs.document.process import Process as Process
from trocar.procs.document.recorder import NAME as RECORDER
from trocar.procs.document.recorder import Recorder as Recorder
from trocar.procs.document.tasks import TaskRow as TaskRow
from trocar.procs.document.user_process import UserProcess as UserProcess

T = TypeVar("T")

WALL = "wall"  # real time
PACED = "paced"  # simulated time, never faster than real time
LOCKSTEP = "lockstep"  # simulated time, as fast as the machine allows


@dataclass(frozen=True, slots=True)
class Logs:
    """Size and age at which a process's log is rotated, and the number of old files kept."""

    max_bytes: int = 10_000_000
    max_age_s: float = 7 * 86400.0
    keep: Annotated[int, Key(0, 100, "old files of each process")] = 5


@dataclass(frozen=True, slots=True)
class Linear:
    """scale · x + offset; both are 0 by default."""

    scale: float = 0.0
    offset: float = 0.0


_DRIVE: Final = Key(inside=("drive",))
_LIMIT: Final = Key(inside=("position_limits_soft",))
_MOST_A: Final = Key(0.0, 20.0, "A", inside=("drive",), default=0.0)


@dataclass(frozen=True, slots=True)
class Encoder:
    """Counts to joint position (rad or m), soft limits, and the source of velocity (FIRMWARE or SOFTWARE)."""

    bits_to_position: Linear
    lower: Annotated[float, _LIMIT]
    upper: Annotated[float, _LIMIT]
    velocity_source: Annotated[str, Key(choices=("FIRMWARE", "SOFTWARE"))]


@dataclass(frozen=True, slots=True)
class Potentiometer:
    """ADC bits to V to rad or m."""

    bits_to_voltage: Linear
    voltage_to_position: Linear = Linear()


@dataclass(frozen=True, slots=True)
class Actuator:
    """One motor axis of a board: `axis_id` 0-3 on a QLA1; currents in A, efforts in N·m or N. Negative id: no board."""

    board_id: Annotated[int, BOARD_ID]
    axis_id: Annotated[int, AXIS_ID]
    joint_type: Annotated[str, Key(choices=("UNDEFINED", "REVOLUTE", "PRISMATIC"), default="UNDEFINED")]
    effort_to_current: Annotated[  # A per N·m (or N)
        float, Key(name="scale", inside=("drive", "effort_to_current"), default=0.0)]
    current_to_bits: Annotated[Linear, _DRIVE]
    bits_to_current: Annotated[Linear, _DRIVE]
    maximum_current: Annotated[float, _MOST_A]
    encoder: Encoder | None = None
    potentiometer: Potentiometer | None = None


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Check of potentiometer against encoder: |difference| > distance for latency_s is a fault; distance 0: off."""

    distance: Annotated[float, Key(0.0)]
    latency_s: Annotated[float, Key(0.0, name="latency")]


@dataclass(frozen=True, slots=True)
class Brake:
    """A brake on a motor channel of a board; current releases it. Currents in A."""

    board_id: Annotated[int, BOARD_ID]
    axis_id: Annotated[int, AXIS_ID]
    current_to_bits: Annotated[Linear, _DRIVE]
    bits_to_current: Annotated[Linear, _DRIVE]
    maximum_current: Annotated[float, _MOST_A]
    release_current: float
    release_s: Annotated[float, Key(0.0, 60.0, name="release_time")]  # duration of the release current
    released_current: float
    engaged_current: float


@dataclass(frozen=True, slots=True)
class Robot:
    """One robot of an IO file."""

    name: str
    serial: str
    hardware: str  # QLA1, DQLA, dRA1, HARDWARE_UNDEFINED or, without boards, KINEMATIC
    actuators: tuple[Actuator, ...]
    potentiometers: str = "UNDEFINED"  # UNDEFINED, NONE, ANALOG or DIGITAL
    tolerances: tuple[Tolerance, ...] = ()
    only_io: bool = False
    joint_to_actuator_position: Matrix | None = None
    brakes: tuple[Brake, ...] = ()
    lookup: str = ""  # DIGITAL potentiometers: their table, packed by `trocar.procs.fpga.lookup`
    source: str = ""


@dataclass(frozen=True, slots=True)
class DigitalInput:
    """One button or switch; times in s."""

    name: Annotated[str, NAME]
    board_id: Annotated[int, BOARD_ID]
    bit_id: Annotated[int, BIT_ID]
    pressed_value: bool
    trigger_when_pressed: bool
    trigger_when_released: bool
    skip_first_run: bool = False
    debounce_s: Annotated[float, Key(0.0, 60.0, "s", name="debounce_time")] = 0.0
    debounce_click_s: Annotated[float, Key(0.0, 60.0, "s", name="debounce_time_click")] = 0.0


@dataclass(frozen=True, slots=True)
class DigitalOutput:
    """One output; times in s, frequency in Hz."""

    name: Annotated[str, NAME]
    board_id: Annotated[int, BOARD_ID]
    bit_id: Annotated[int, BIT_ID]
    high_s: Annotated[float, Key(0.0, name="high_duration")] = 0.0  # then it switches by itself; 0: never
    low_s: Annotated[float, Key(0.0, name="low_duration")] = 0.0
    is_pwm: Annotated[bool, Key(name="is_PWM")] = False
    pwm_hz: Annotated[float, Key(0.0, name="PWM_frequency")] = 0.0
    set_by: Annotated[str, MADE] = ""  # io's only command that sets it, for `robot`; empty: set_output and set_pwm
    robot: Annotated[str, MADE] = ""


@dataclass(frozen=True, slots=True)
class InstrumentReader:
    """A `dallas_chips` entry: the board that reads the memory of an arm's instrument."""

    name: Annotated[str, NAME]
    board_id: Annotated[int, BOARD_ID]


@dataclass(frozen=True, slots=True)
class PidConfig:
    """The joint controller of one robot, which follows the setpoints of the instance `arm`."""

    robot: str
    arm: str
    axes: tuple[PidAxis, ...]
    source: str = ""
    max_speeds: tuple[float, ...] = ()  # of the setpoints of each actuator, rad/s or m/s; empty: no bound


@dataclass(frozen=True, slots=True)
class RecordPlace:
    """Where the values of a robot are in io's records: among the robots, the axes of all, and all drives."""

    row: int
    robot: Robot
    axes: slice
    brakes: slice
    """Drives are all actuators, then all brakes."""

    @property
    def drives(self) -> list[int]:
        """Its actuators, then its brakes."""
        return [*range(self.axes.start, self.axes.stop), *range(self.brakes.start, self.brakes.stop)]


@dataclass(frozen=True, slots=True)
class IoConfig:
    """One `IOs[]` entry: a bus with its robots, controllers and inputs."""

    name: str
    port: str  # the port to open; with emulated boards "udp:127.x.y.z"; empty: KINEMATIC robots, no boards
    protocol: str  # sequential-read-write, sequential-read-broadcast-write or broadcast-query-read-write
    period_s: float
    watchdog_s: float  # 0: off
    close_all_relays: bool
    robots: tuple[Robot, ...]
    pids: tuple[PidConfig, ...]
    digital_inputs: tuple[DigitalInput, ...]
    setpoint_timeout_s: Annotated[float, Key(0.001, 1.0, "s of an old setpoint, then hold")] = 0.03
    arm_lost_s: Annotated[float, Key(0.01, 3600.0, "s without the arm, then an error")] = 3.0
    arm_lost_power_off_s: Annotated[float, Key(0.0, 3600.0, "s without the arm; 0: never")] = 0.0
    current_error_a: Annotated[float, Key(0.0, 20.0, "A between measured and requested current; 0: not compared")] = 0.0
    current_error_s: Annotated[float, Key(0.0, 10.0, "s of that, then power off")] = 0.05
    spin_us: Annotated[float, Key(0.0, 50.0, "µs of busy waiting before a cycle and a reply")] = 50.0
    query_wait_us: Annotated[
        float, Key(0.0, 1000.0, "µs from a query of all boards to the read; 0: as long as they need")] = 0.0
    unknown_firmware: Annotated[bool, Key(text="power controllers with unknown firmware, too")] = False
    instrument_readers: tuple[InstrumentReader, ...] = ()
    digital_outputs: tuple[DigitalOutput, ...] = ()
    calibration_mode: bool = False  # potentiometers and currents are being calibrated: checks that compare them are off
    tasks: tuple[TaskRow, ...] = ()

    @property
    def places(self) -> list[RecordPlace]:
        """Those of all its robots, in order."""
        first, brake, found = 0, sum(len(robot.actuators) for robot in self.robots), []
        for row, robot in enumerate(self.robots):
            last, end = first + len(robot.actuators), brake + len(robot.brakes)
            found.append(RecordPlace(row, robot, slice(first, last), slice(brake, end)))
            first, brake = last, end
        return found

    def place(self, name: str) -> RecordPlace:
        """That of the robot `name`; KeyError when there is none."""
        return self.places[self.robots.index(_named(self.robots, name))]


@dataclass(frozen=True, slots=True)
class EmulationConfig:
    """All that the `boards` process emulates; `SystemConfig.emulated` has the robots on these boards."""

    period_s: float
    buses: tuple[BusConfig, ...]
    seed: Annotated[int, Key(0, 2**32 - 1)] = 1
    pot_noise_v: Annotated[float, Key(0.0, 1.0, "V")] = 0.0
    instruments: tuple[tuple[str, str], ...] = ()  # (arm, tool name) inserted at start
    model_variations: tuple[ModelVariation, ...] = ()
    setup_joints: tuple[EmulatedSetupJoints, ...] = ()
    # All robots and arms on these buses, if they differ from those that the system's own processes drive.
    ios: tuple[IoConfig, ...] | None = None
    arms: tuple[ArmConfig, ...] = ()


@dataclass(frozen=True, slots=True)
class SystemConfig:
    """The whole document."""

    name: str
    source: str
    clock: str  # WALL, PACED or LOCKSTEP
    ios: tuple[IoConfig, ...]
    arms: tuple[ArmConfig, ...]
    emulation: EmulationConfig | None
    processes: tuple[Process, ...]
    carts: tuple[Cart, ...] = ()
    consoles: tuple[Console, ...] = ()
    teleop_psms: tuple[TeleopPsmConfig, ...] = ()
    teleop_ecms: tuple[TeleopEcmConfig, ...] = ()
    third_parties: tuple[ThirdParty, ...] = ()
    focuses: tuple[Focus, ...] = ()  # one at most
    users: tuple[UserProcess, ...] = ()  # users' processes
    ros: RosBridge | None = None
    socket: SocketBridge | None = None
    foxglove: FoxgloveServer | None = None
    gui: WebConsole | None = None
    recorder: Recorder | None = None
    audio_volume: Annotated[float, Key(0.0, 1.0, of="settings")] = 0.5
    supervisor_lost_s: Annotated[float, Key(0.1, 60.0, "s")] = 1.0
    group: str = ""  # its members may attach, too
    service_user: str = ""  # user whose shared memory is trusted besides our own and root's
    logs: Logs = Logs()
    cpus: tuple[int, ...] = ()  # processors of the supervisor, and default for all processes; empty: any
    history_s: float = 0.0  # time that rings keep, where shared memory is short; 0: the usual one
    shortage: str = ""  # this in words
    notes: tuple[str, ...] = ()  # overrides, e.g. "port fw replaced by emulated boards at 127.…"

    def io(self, name: str) -> IoConfig:
        """The io entry `name`; KeyError when there is none."""
        return _named(self.ios, name)

    def arm(self, name: str) -> ArmConfig:
        """The arm entry `name`; KeyError when there is none."""
        return _named(self.arms, name)

    def cart(self, name: str) -> Cart:
        """The setup joints `name`; KeyError when there are none of that name."""
        return _named(self.carts, name)

    def console(self, name: str) -> Console:
        """The console `name`; KeyError when there is none."""
        return _named(self.consoles, name)

    def teleop(self, name: str) -> TeleopPsmConfig | TeleopEcmConfig:
        """The teleoperation `name`; KeyError when there is none."""
        rows: tuple[TeleopPsmConfig | TeleopEcmConfig, ...] = (*self.teleop_ecms, *self.teleop_psms)
        return _named(rows, name)

    def third_party(self, name: str) -> ThirdParty:
        """The place of a third-party program `name`; KeyError when there is none."""
        return _named(self.third_parties, name)

    def focus_of(self, name: str) -> Focus:
        """The focus controller `name`; KeyError when there is none."""
        return _named(self.focuses, name)

    def user(self, name: str) -> UserProcess | None:
        """The declarations of the process `name` if it is a user's, or the recorder; otherwise None."""
        if name == RECORDER and self.recorder is not None:
            return self.recorder.declared
        return next((row for row in self.users if row.name == name), None)

    def inputs(self, name: str) -> tuple[str, ...]:
        """Digital inputs of the io `name`, or buttons of that third-party program, in the order of its record."""
        if any(row.name == name for row in self.third_parties):
            return self.third_party(name).inputs
        return tuple(row.name for row in self.io(name).digital_inputs)

    def process(self, name: str) -> Process:
        """The process row `name`; KeyError when there is none."""
        return _named(self.processes, name)

    def emulated(self) -> SystemConfig:
        """The system of its emulated boards: every robot and input on them, driven by a process or not.

        Names that several buses have become IO/NAME.
        """
        if self.emulation is None:
            return self
        if self.emulation.ios is None:
            return with_names_on_boards(self)
        return with_names_on_boards(dataclasses.replace(self, ios=self.emulation.ios, arms=self.emulation.arms))


def _named(rows: tuple[T, ...], name: str) -> T:
    for row in rows:
        if getattr(row, "name", None) == name:
            return row
    raise KeyError(f"{name}: not in this system; it has {', '.join(getattr(row, 'name', '?') for row in rows)}")


def to_json(system: SystemConfig) -> bytes:
    """The document as UTF-8 JSON; each instrument is in it once, even if several arms have it."""
    rows = system.arms + (system.emulation.arms if system.emulation is not None else ())
    places: dict[Tool, int] = {}
    known = [[places.setdefault(tool, len(places)) for tool in arm.tools] for arm in rows]
    bare = dataclasses.replace(system, arms=_with_tools(system.arms, ()))
    if bare.emulation is not None:
        bare = dataclasses.replace(
            bare, emulation=dataclasses.replace(bare.emulation, arms=_with_tools(bare.emulation.arms, ())))
    content = dataclasses.asdict(bare)
    content["instruments"], content["known"] = [dataclasses.asdict(tool) for tool in places], known
    return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()


def _with_tools(arms: tuple[ArmConfig, ...], tools: tuple[Tool, ...]) -> tuple[ArmConfig, ...]:
    return tuple(dataclasses.replace(arm, tools=tools) for arm in arms)


def from_json(data: bytes) -> SystemConfig:
    """The document from `to_json`; ValueError when the bytes are not a document (their origin may be unknown)."""
    try:
        content = json.loads(data)
        tools = [decode(Tool, tool) for tool in content.pop("instruments")]
        arms = content["arms"] + (content["emulation"]["arms"] if content["emulation"] else [])
        for arm, known in zip(arms, content.pop("known"), strict=True):
            arm["tools"] = [tools[place] for place in known]
        return decode(SystemConfig, content)
    except (ValueError, TypeError, LookupError, AttributeError, StopIteration, RecursionError, OverflowError) as error:
        raise ValueError(f"the document is not readable: {type(error).__name__}: {error}") from None
