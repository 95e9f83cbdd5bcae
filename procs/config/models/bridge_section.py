"""The sections `trocar.socket`, `trocar.foxglove` and `trocar.gui`: socket bridge, Foxglove server and web console."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document.process import host_and_port


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


class TlsKeys(Section):
    """Files in PEM format."""

    certificate: str = Field(min_length=1, description="a file")
    key: str = Field(min_length=1, description="a file")
    clients: str = Field(default="", description="a file: whose certificates clients have to show")


class SocketKeys(Section):
    """JSON over TCP and WebSocket, see docs/socket.md."""

    counts_when_empty = True
    listen: Addresses = Field(default=("127.0.0.1:7380",), min_length=1, max_length=8)
    token_file: str = Field(default="", description="a file of mode 0600")
    tls: TlsKeys | None = None
    grants: Literal["view", "command"] | None = None
    may_power: bool | None = None
    max_clients: int = Field(default=64, ge=1, le=1000)


class CertificateKeys(Section):
    """Files in PEM format."""

    certificate: str = Field(min_length=1, description="a file")
    key: str = Field(min_length=1, description="a file")


class FoxgloveKeys(Section):
    """Foxglove's WebSocket protocol, see docs/foxglove.md."""

    counts_when_empty = True
    listen: Address = "127.0.0.1:8765"
    rate_hz: float = Field(default=30.0, ge=1.0, le=200.0, description="Hz")
    tls: CertificateKeys | None = None


class GuiKeys(Section):
    """The web console, see docs/gui.md."""

    counts_when_empty = True
    listen: Addresses = Field(default=("127.0.0.1:8080",), min_length=1, max_length=8)
    token_file: str = Field(default="", description="a file of mode 0600")
    tls: TlsKeys | None = None
    max_clients: int = Field(default=16, ge=1, le=100)
