"""The `trocar:` section of a system file: settings that dVRK files have no keys for. Unknown keys are errors."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from trocar.procs.config.read.sections import Keys, Rows, Section, keys_of
from trocar.procs.document.emulated import MADE_FOR, ModelVariation, Quirks
from trocar.procs.document.keys import NAME
from trocar.procs.document.process import host_and_port
from trocar.procs.document.system import (
    ArmConfig,
    EmulationConfig,
    FoxgloveServer,
    IoConfig,
    Logs,
    Process,
    Recorder,
    RosBridge,
    SocketBridge,
    SystemConfig,
    TaskRow,
    WebConsole,
)
from trocar.procs.document.user_process import WORD, UserCommand, UserTopic
from trocar.procs.document.walls import Wall


def _as_addresses(value: object) -> object:
    """A single address as a list of one."""
    return (value,) if isinstance(value, str) else value


def _known_address(address: str) -> str:
    try:
        host_and_port(address)
    except ValueError:
        raise ValueError("not an address with a port") from None
    return address


Address = Annotated[str, AfterValidator(_known_address), Field(description="IP address and port: 127.0.0.1:8080")]
Addresses = Annotated[Rows[Address], BeforeValidator(_as_addresses)]


class CertificateKeys(Section):
    """Files in PEM format."""

    certificate: str = Field(min_length=1, description="a file")
    key: str = Field(min_length=1, description="a file")


class TlsKeys(CertificateKeys):
    """Files in PEM format."""

    clients: str = Field(default="", description="a file: whose certificates clients have to show")


@keys_of(SocketBridge)
class SocketKeys(Section):
    """JSON over TCP and WebSocket, see docs/socket.md."""

    counts_when_empty = True
    listen: Addresses = Field(default=("127.0.0.1:7380",), min_length=1, max_length=8)
    token_file: str = Field(default="", description="a file of mode 0600")
    tls: TlsKeys | None = None


@keys_of(FoxgloveServer)
class FoxgloveKeys(Section):
    """Foxglove's WebSocket protocol, see docs/foxglove.md."""

    counts_when_empty = True
    listen: Address = "127.0.0.1:8765"
    tls: CertificateKeys | None = None


@keys_of(WebConsole)
class GuiKeys(Section):
    """The web console, see docs/gui.md."""

    counts_when_empty = True
    listen: Addresses = Field(default=("127.0.0.1:8080",), min_length=1, max_length=8)
    token_file: str = Field(default="", description="a file of mode 0600")
    tls: TlsKeys | None = None


EVERYWHERE = "0.0.0.0"  # every address of this machine
RAW = "eth:"  # followed by an interface: raw Ethernet instead of UDP
_RAW_INTERFACE = re.compile(r"eth:[^\s/:]{1,15}\Z")
_LOOPBACK = re.compile(r"127(?:\.(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)){3}\Z")


_ADDRESSES = "127.x.y.z, z from 1 to 254, 0.0.0.0, or eth:INTERFACE"


def _board_address(address: str) -> str:
    last = address.rpartition(".")[2]
    if address == EVERYWHERE or _RAW_INTERFACE.match(address):
        return address
    if not (_LOOPBACK.match(address) and 1 <= int(last) <= 254):
        raise ValueError("not an address for emulated boards")
    return address


def _as_text(value: object) -> object:
    """A version as text: without quotes it is read as a number."""
    return str(value) if isinstance(value, float) else value


Period = Annotated[float, Field(ge=0.0001, le=0.1, description="s")]
Priority = Annotated[int, Field(ge=0, le=98, description="SCHED_FIFO priority, 0 for none")]
Cpu = Annotated[int, Field(ge=0, le=1023, description="number of a processor")]
_FIRMWARE = tuple(sorted({firmware for made in MADE_FOR.values() for firmware in made}))
_FPGAS = tuple(sorted({fpga for made in MADE_FOR.values() for fpgas in made.values() for fpga in fpgas}))
Hardware = Annotated[Literal["QLA1", "DQLA", "dRA1"], Field()]
BoardAddress = Annotated[str, AfterValidator(_board_address), Field(description=_ADDRESSES)]
Serial = Annotated[str, Field(pattern=r"^[0-9]{4}-[0-9]{2,3}$", description="dddd-dd")]
QlaVersion = Annotated[Literal["1.4", "1.5"], BeforeValidator(_as_text)]


@keys_of(Quirks)
class QuirkKeys(Section):
    """Oddities of the real firmware, by their names in the document; default: as on real boards."""


class BoardKeys(Section):
    """Keys for a single controller, all on a bus, or all."""

    firmware: Literal[_FIRMWARE] | None = None  # type: ignore[valid-type]  # of the table
    fpga: Literal[_FPGAS] | None = None  # type: ignore[valid-type]  # of the table
    qla: QlaVersion | None = None
    quirks: QuirkKeys = QuirkKeys()


class ControllerKeys(BoardKeys):
    """One controller, by its board id."""

    hardware: Hardware | None = None
    serial: Serial | None = None


class NetworkKeys(BoardKeys):
    """Keys for one bus or all."""

    network: Literal["bridge", "ethernet"] | None = None
    testboard: bool | None = None


class EmulatedBusKeys(NetworkKeys):
    """One bus, by the name of its IO, or by any name if the system has no IOs."""

    address: BoardAddress | None = None
    hub: int | None = Field(default=None, ge=0, le=15, description="the board the network cable is plugged into")
    controllers: dict[str, ControllerKeys] = Field(default_factory=dict)


@keys_of(ModelVariation)
class ModelVariationKeys(Section):
    """Differences of one robot from its files, by its name on the emulated boards."""


@keys_of(EmulationConfig)
class EmulationOptions(NetworkKeys):
    """The emulated boards."""

    period_s: Period = 0.001
    priority: Priority = 90
    cpu: Cpu | None = None
    instruments: dict[str, str] = Field(default_factory=dict, description="arm: NAME:MODEL")
    buses: dict[str, EmulatedBusKeys] = Field(default_factory=dict)
    robots: dict[str, ModelVariationKeys] = Field(default_factory=dict)


class PropertyKeys(Section):
    """A number or text that can be set at run time."""

    name: Annotated[str, Field(pattern=WORD.pattern, description=WORD.text)]
    type: Annotated[str, Field(pattern=r"^(float|int|bool|text\[[1-9][0-9]?\])$",
                               description="float, int, bool, or text[24]: at most this many bytes")] = "float"
    default: float | bool | str | None = None
    min: float | None = None
    max: float | None = None
    unit: str = Field(default="", max_length=40)
    text: str = Field(default="", max_length=400)


def _plain(options: dict[str, object]) -> dict[str, object]:
    for name, value in options.items():
        if not _is_plain(value):
            raise ValueError(f"{name} is no plain value")
    return options


def _is_plain(value: object) -> bool:
    """Whether JSON can carry a value to io; pydantic checks fields for inf and nan, but not these values."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(isinstance(name, str) and _is_plain(item) for name, item in value.items())
    if isinstance(value, float):
        return value - value == 0.0
    return isinstance(value, (bool, int, str))


_OPTIONS = "numbers (no inf, no nan), texts, true, false, lists and objects of these"
Options = Annotated[dict[str, object], AfterValidator(_plain), Field(description=_OPTIONS)]
Maker = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$", description="the name of a class or function")]


@keys_of(TaskRow)
class TaskKeys(Section):
    """One task; default for `robots`: all with a joint controller."""

    module: Annotated[str, Field(min_length=1, description="a .py file, or an importable module")]
    name: Maker
    robots: Rows[str] = ()
    budget_us: float = Field(default=50.0, ge=1.0, le=1000.0, description="µs")
    options: Options = Field(default_factory=dict, description=_OPTIONS)


Account = Annotated[str, Field(pattern=r"^[a-z_][a-z0-9_-]{0,31}$|^$",
                               description="lower-case letters, digits, _ and -, a letter or _ first, at most 32")]


@keys_of(Process)
class ProcessKeys(Section):
    """One instance, by its name; its kind has the defaults. With a module it is a user's process."""

    period_s: Period | None = None
    priority: Priority | None = None
    cpu: Cpu | None = None
    start: Literal["always", "on-demand"] | None = None
    listen: Addresses = Field(default=(), max_length=8)
    module: str | None = Field(default=None, min_length=1, description="a .py file, or an importable module")
    topics: Rows[Keys[UserTopic]] = ()
    commands: Rows[Keys[UserCommand]] = ()
    properties: Rows[PropertyKeys] = ()
    host: str | None = Field(default=None, pattern=NAME.pattern,
                             description=f"the process that calls its update, with those of others: {NAME.text}")


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
        wall_force: float = 0.0


@keys_of(Logs)
class LogOptions(Section):
    """Log files of processes."""

    size_mb: float = Field(default=10.0, ge=0.01, le=10000.0, description="MB, then a new file begins")
    days: float = Field(default=7.0, ge=0.001, le=3650.0, description="days, then a new file begins")


@keys_of(RosBridge)
class RosOptions(Section):
    """The ROS bridge."""

    counts_when_empty = True
    if TYPE_CHECKING:
        domain: int = 0
        interface: str = ""
        namespace: str = ""
        may_power: bool | None = None


@keys_of(Recorder)
class RecorderKeys(Section):
    """The recorder, see docs/recordings.md; `on` false: no recorder."""

    on: bool | None = None
    if TYPE_CHECKING:
        folder: str = ""


@keys_of(SystemConfig)
class TrocarSection(Section):
    """The whole section."""

    clock: Literal["wall", "paced", "lockstep"] | None = None
    boards: Literal["real", "emulated"] = "real"
    calibration_mode: bool = Field(default=False, description="checks that calibration needs off are off")
    group: Account = Field(default="", description="a group of this machine")
    service_user: Account = Field(default="", description="a user of this machine")
    placement: Literal["auto", "none"] = "auto"
    io: IoOptions = IoOptions()
    arm: ArmOptions = ArmOptions()
    walls: Rows[Keys[Wall]] = ()
    emulation: EmulationOptions = EmulationOptions()
    logs: LogOptions = LogOptions()
    ros: RosOptions | None = None
    socket: SocketKeys | None = None
    foxglove: FoxgloveKeys | None = None
    gui: GuiKeys | None = None
    recorder: RecorderKeys = RecorderKeys()
    processes: dict[str, ProcessKeys] = Field(default_factory=dict)
