"""Bridges to ROS and to programs that are not on this machine, and the web console, as the document says them."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Final, Literal

from trocar.procs.document.keys import Key
from trocar.procs.document.process import host_and_port

VIEW: Final = "view"
COMMAND: Final = "command"


@dataclass(frozen=True, slots=True)
class RosBridge:
    """Domain and network interface it is seen on, and what of the robot."""

    domain: Annotated[int, Key(0, 232, "ROS_DOMAIN_ID of its clients")] = 0
    interface: Annotated[str, Key(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:-]{0,39}$",
        text="network interface by name or address (letters, digits and _ . : -, at most 40); lo: this machine alone",
    )] = "lo"
    period_s: Annotated[float, Key(0.001, 1.0, "s between two messages of a topic")] = 0.01
    namespace: Annotated[str, Key(
        pattern=r"^[A-Za-z][A-Za-z0-9_/]{0,39}$|^$",
        text="in front of all names: letters, digits, _ and /, a letter first, at most 40")] = ""
    may_power: Annotated[bool, Key(text="people there may power and home; usually on lo only", is_optional=True)] = True
    pid: Annotated[Literal["off", "ro", "rw"], Key()] = "off"  # joint controllers: ro: seen, rw: also commanded
    io: Annotated[Literal["off", "ro", "rw"], Key()] = "off"  # the same
    tf: Annotated[bool, Key()] = True
    stats: Annotated[bool, Key()] = True


@dataclass(frozen=True, slots=True)
class SocketBridge:
    """The socket bridge. What is None goes by the address that a client came to: see `rights_at`."""

    listen: tuple[str, ...]
    token_file: str = ""  # has the words that clients from elsewhere show first
    certificate: str = ""  # of TLS, with its key; empty: no TLS
    key: str = ""
    authorities: str = ""  # whose certificates clients have to show
    grants: str | None = None  # VIEW or COMMAND
    may_power: bool | None = None
    max_clients: int = 64

    def rights_at(self, address: str) -> Rights:
        """What clients may do that come to this address: by default all on loopback, look elsewhere."""
        local = is_loopback(address)
        commands = local if self.grants is None else self.grants == COMMAND
        powers = local if self.may_power is None else self.may_power
        return Rights(local, commands, commands and powers)


@dataclass(frozen=True, slots=True)
class FoxgloveServer:
    """Foxglove and Lichtblick: topics and the robot in 3D, to look at."""

    listen: str
    rate_hz: float
    certificate: str = ""  # of TLS, with its key; empty: no TLS
    key: str = ""


@dataclass(frozen=True, slots=True)
class WebConsole:
    """The web console: where it is served, and who may see it; the fields are those of the socket bridge."""

    listen: tuple[str, ...]
    token_file: str = ""
    certificate: str = ""
    key: str = ""
    authorities: str = ""
    max_clients: int = 16
    makes_token: bool = False  # at each start: other machines may come, and nothing else says who

    def links(self, token: str = "", here: str = "") -> list[str]:
        """Addresses for browsers; `token`: with it where one is asked for.

        `here`: the name of this machine, where it listens at all of its addresses; then its own browsers have one more.
        """
        found = []
        for address in self.listen:
            (host, port), scheme = host_and_port(address), "https" if self.certificate else "http"
            name = here if here and ip_address(host).is_unspecified else f"[{host}]" if ":" in host else host
            shown = f"/?token={token}" if token and not is_loopback(address) else ""
            found.append(f"{scheme}://{name}:{port}{shown}")
            if here and ip_address(host).is_unspecified:
                found.append(f"{scheme}://{'[::1]' if ':' in host else '127.0.0.1'}:{port}")
        return found


@dataclass(frozen=True, slots=True)
class Rights:
    """What a client may do; `local`: who runs on this machine as the user of this system needs no token."""

    local: bool
    commands: bool
    powers: bool


def is_loopback(address: str) -> bool:
    """Whether an address of `listen` is reached from this machine only."""
    return ip_address(host_and_port(address)[0]).is_loopback
