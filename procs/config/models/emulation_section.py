"""`trocar.emulation`: settings of emulated controllers (all, those of one bus, a single one), and model variations.

A controller's own keys take precedence over those of its bus, and these over those for all.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from trocar.procs.config.read.validate import Section, keys_of
from trocar.procs.document.emulated import ModelVariation, Quirks

EVERYWHERE = "0.0.0.0"  # every address of this machine
RAW = "eth:"  # followed by an interface: raw Ethernet instead of UDP
_RAW_INTERFACE = re.compile(r"eth:[^\s/:]{1,15}\Z")
_LOOPBACK = re.compile(r"127(?:\.(?:25[0-5]|2[0-4]\d|1\d\d|[1-9]?\d)){3}\Z")


_ADDRESSES = "127.x.y.z, z from 1 to 254, 0.0.0.0, or eth:INTERFACE"


def _known_address(address: str) -> str:
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
Hardware = Annotated[Literal["QLA1", "DQLA", "dRA1"], Field()]
Address = Annotated[str, AfterValidator(_known_address), Field(description=_ADDRESSES)]
Serial = Annotated[str, Field(pattern=r"^[0-9]{4}-[0-9]{2,3}$", description="dddd-dd")]
QlaVersion = Annotated[Literal["1.4", "1.5"], BeforeValidator(_as_text)]


@keys_of(Quirks)
class QuirkKeys(Section):
    """Oddities of the real firmware, by their names in the document; default: as on real boards."""


class BoardKeys(Section):
    """Keys for a single controller, all on a bus, or all."""

    firmware: Literal[7, 8, 9] | None = None
    fpga: Literal["V2", "V3"] | None = None
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

    address: Address | None = None
    hub: int | None = Field(default=None, ge=0, le=15, description="the board the network cable is plugged into")
    controllers: dict[str, ControllerKeys] = Field(default_factory=dict)


@keys_of(ModelVariation)
class ModelVariationKeys(Section):
    """Differences of one robot from its files, by its name on the emulated boards."""


class EmulationOptions(NetworkKeys):
    """The emulated boards."""

    period_s: Period = 0.001
    priority: Priority = 90
    cpu: Cpu | None = None
    seed: int = Field(default=1, ge=0, le=2**32 - 1)
    pot_noise_v: float = Field(default=0.0, ge=0.0, le=1.0, description="V")
    instruments: dict[str, str] = Field(default_factory=dict, description="arm: NAME:MODEL")
    buses: dict[str, EmulatedBusKeys] = Field(default_factory=dict)
    robots: dict[str, ModelVariationKeys] = Field(default_factory=dict)
