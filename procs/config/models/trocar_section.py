"""The `trocar:` section of a system file: settings that dVRK's files have no keys for. Unknown keys are errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from trocar.procs.config.models.bridge_section import Addresses, FoxgloveKeys, GuiKeys, SocketKeys
from trocar.procs.config.models.emulation_section import Cpu, EmulationOptions, Period, Priority
from trocar.procs.config.models.user_section import CommandKeys, PropertyKeys, TaskKeys, TopicKeys
from trocar.procs.config.read.validate import NAME, Rows, Section, keys_of
from trocar.procs.document.system import ArmConfig, IoConfig, Recorder, RosBridge

Account = Annotated[str, Field(pattern=r"^[a-z_][a-z0-9_-]{0,31}$|^$",
                               description="lower-case letters, digits, _ and -, a letter or _ first, at most 32")]
OnExit = Annotated[Literal["restart", "stay-down"], Field()]


class ProcessKeys(Section):
    """One instance, by its name; its kind has the defaults. With a module it is a user's process."""

    period_s: Period | None = None
    priority: Priority | None = None
    cpu: Cpu | None = None
    on_exit: OnExit | None = None
    restart_limit: int | None = Field(default=None, ge=0, le=1000)
    backoff_s: float | None = Field(default=None, ge=0.0, le=60.0, description="s")
    late_s: float | None = Field(default=None, ge=0.01, le=60.0, description="s of silence, then it is reported")
    hung_s: float | None = Field(default=None, ge=0.1, le=86400.0, description="s of silence, then it is killed")
    start: Literal["always", "on-demand"] | None = None
    linger_s: float | None = Field(default=None, ge=0.0, le=3600.0, description="s after the last subscriber left")
    listen: Addresses = Field(default=(), max_length=8)
    module: str | None = Field(default=None, min_length=1, description="a .py file, or an importable module")
    topics: Rows[TopicKeys] = ()
    commands: Rows[CommandKeys] = ()
    properties: Rows[PropertyKeys] = ()
    host: str | None = Field(default=None, pattern=NAME,
                             description="the process that calls its update, with those of others: letters, digits, _ "
                             "and -, at most 40")


@keys_of(IoConfig)
class IoOptions(Section):
    """Settings for all buses."""

    period_s: Period | None = None
    priority: Priority = 80
    cpu: Cpu | None = None
    tasks: Rows[TaskKeys] = ()


@keys_of(ArmConfig)
class ArmOptions(Section):
    """Settings for all arms."""

    period_s: Period | None = None
    priority: Priority = 60
    cpu: Cpu | None = None
    if TYPE_CHECKING:
        effort_timeout_s: float = 0.1


class LogOptions(Section):
    """Log files of processes."""

    size_mb: float = Field(default=10.0, ge=0.01, le=10000.0, description="MB, then a new file begins")
    days: float = Field(default=7.0, ge=0.001, le=3650.0, description="days, then a new file begins")
    keep: int = Field(default=5, ge=0, le=100, description="old files of each process")


@keys_of(RosBridge)
class RosOptions(Section):
    """The ROS bridge."""

    counts_when_empty = True
    if TYPE_CHECKING:
        interface: str = ""
        may_power: bool | None = None


@keys_of(Recorder)
class RecorderKeys(Section):
    """The recorder, see docs/operating.md; `on` false: no recorder."""

    on: bool | None = None
    if TYPE_CHECKING:
        folder: str = ""


class TrocarSection(Section):
    """The whole section."""

    clock: Literal["wall", "paced", "lockstep"] | None = None
    boards: Literal["real", "emulated"] = "real"
    calibration_mode: bool = Field(default=False, description="checks that calibration needs off are off")
    group: Account = Field(default="", description="a group of this machine")
    service_user: Account = Field(default="", description="a user of this machine")
    placement: Literal["auto", "none"] = "auto"
    supervisor_lost_s: float = Field(default=1.0, ge=0.1, le=60.0, description="s")
    io: IoOptions = IoOptions()
    arm: ArmOptions = ArmOptions()
    emulation: EmulationOptions = EmulationOptions()
    logs: LogOptions = LogOptions()
    ros: RosOptions | None = None
    socket: SocketKeys | None = None
    foxglove: FoxgloveKeys | None = None
    gui: GuiKeys | None = None
    recorder: RecorderKeys = RecorderKeys()
    processes: dict[str, ProcessKeys] = Field(default_factory=dict)
