"""The `trocar:` section of a system file: what the original files have no key for. Unknown keys are errors here."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.loading.tasks import TaskKeys
from trocar.procs.config.models.addresses import Addresses
from trocar.procs.config.models.bridge_section import FoxgloveKeys, GuiKeys, SocketKeys
from trocar.procs.config.models.emulation_section import Cpu, EmulationOptions, Period, Priority
from trocar.procs.config.models.user_section import CommandKeys, PropertyKeys, TopicKeys
from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document.recorder import MAX_RATE_HZ

Account = Annotated[str, Field(pattern=r"^[a-z_][a-z0-9_-]{0,31}$|^$",
                               description="lower-case letters, digits, _ and -, a letter or _ first, at most 32")]
OnExit = Annotated[Literal["restart", "stay-down"], Field()]


class ProcessKeys(Section):
    """One instance, by its name; what is absent comes from its kind. With a module it is a process of one's own."""

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
    host: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_-]{1,40}$",
                             description="the process that calls its update, with those of others: letters, digits, _ "
                             "and -, at most 40")


class IoOptions(Section):
    """All buses."""

    period_s: Period | None = None
    priority: Priority = 80
    cpu: Cpu | None = None
    setpoint_timeout_s: float = Field(default=0.03, ge=0.001, le=1.0, description="s of an old setpoint, then hold")
    arm_lost_s: float = Field(default=3.0, ge=0.01, le=3600.0, description="s without the arm, then an error")
    arm_lost_power_off_s: float = Field(default=0.0, ge=0.0, le=3600.0, description="s without the arm; 0: never")
    current_error_a: float = Field(default=0.0, ge=0.0, le=20.0,
                                   description="A between measured and requested current; 0: not compared")
    current_error_s: float = Field(default=0.05, ge=0.0, le=10.0, description="s of that, then power off")
    spin_us: float = Field(default=50.0, ge=0.0, le=50.0, description="µs of busy waiting before a cycle and a reply")
    query_wait_us: float = Field(default=0.0, ge=0.0, le=1000.0,
                                 description="µs from a query of all boards to the read; 0: as long as they need")
    tasks: Rows[TaskKeys] = ()


class ArmOptions(Section):
    """All arms."""

    period_s: Period | None = None
    priority: Priority = 60
    cpu: Cpu | None = None
    use_setpoint_v: bool = True
    jerk_time_s: float = Field(default=0.0, ge=0.0, le=2.0,
                               description="s in which moves come up to their acceleration; 0: no jerk limit")
    client_timeout_s: float = Field(default=0.0, ge=0.0, le=10.0,
                                    description="s after the last servo command of a stream, then hold; 0: never")
    effort_timeout_s: float = Field(default=0.1, ge=0.0, le=10.0,
                                    description="s that efforts last that are not asked for again; 0: for ever")
    effort_speed_ratio: float = Field(default=1.0, ge=0.0, le=5.0,
                                      description="times the usual limits of speed in effort mode; 0: none")
    effort_zone_ratio: float = Field(default=1.0, ge=0.0, le=5.0,
                                     description="times the usual zones of the soft walls at joint limits; 0: none")


class LogOptions(Section):
    """The output of each process."""

    size_mb: float = Field(default=10.0, ge=0.01, le=10000.0, description="MB, then a new file begins")
    days: float = Field(default=7.0, ge=0.001, le=3650.0, description="days, then a new file begins")
    keep: int = Field(default=5, ge=0, le=100, description="old files of each process")


class RosOptions(Section):
    """The ROS bridge."""

    counts_when_empty = True
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID of its clients")
    interface: str = Field(default="lo", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:-]{0,39}$",
                           description="network interface by name or address (letters, digits and _ . : -, at most "
                           "40); lo: this machine alone")
    period_s: float = Field(default=0.01, ge=0.001, le=1.0, description="s between two messages of a topic")
    namespace: str = Field(default="", pattern=r"^[A-Za-z][A-Za-z0-9_/]{0,39}$|^$",
                           description="in front of all names: letters, digits, _ and /, a letter first, at most 40")
    may_power: bool | None = Field(default=None, description="people there may power and home; usually on lo only")
    pid: Literal["off", "ro", "rw"] = "off"
    io: Literal["off", "ro", "rw"] = "off"
    tf: bool = True
    stats: bool = True


class RecorderKeys(Section):
    """The recorder, see docs/operating.md; `on` false: there is none."""

    on: bool | None = None
    folder: str = Field(default="", max_length=200, description="a folder with one for each system, or none")
    rate_hz: float = Field(default=50.0, ge=1.0, le=MAX_RATE_HZ, description="Hz")
    minutes: float = Field(default=10.0, ge=0.1, le=1440.0, description="min that the black box goes back")
    size_mb: float = Field(default=500.0, ge=1.0, le=1e6, description="MB of the black box's files together")
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    faults: int = Field(default=10, ge=1, le=1000, description="recordings of faults that are kept")


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
