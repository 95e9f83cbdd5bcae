"""The bridges to ROS and other programs, and the web console, in the document."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Final, Literal

from trocar.procs.document.keys import Key
from trocar.procs.document.process import host_and_port

VIEW: Final = "view"
COMMAND: Final = "command"
NO_FOXGLOVE: Final = "foxglove-sdk is not installed: pip install foxglove-sdk in the environment of Trocar"


@dataclass(frozen=True, slots=True)
class RosBridge:
    """The ROS bridge: domain, network interface, and the parts of the robot that it exposes."""

    domain: Annotated[int, Key(0, 232, "ROS_DOMAIN_ID of its clients")] = 0
    interface: Annotated[str, Key(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:-]{0,39}$",
        text="network interface by name or address (letters, digits and _ . : -, at most 40); lo: this machine alone",
    )] = "lo"
    period_s: Annotated[float, Key(0.001, 1.0, "s between two messages of a topic")] = 0.01
    namespace: Annotated[str, Key(
        pattern=r"^[A-Za-z][A-Za-z0-9_/]{0,39}$|^$",
        text="in front of all names: letters, digits, _ and /, a letter first, at most 40")] = ""
    may_power: Annotated[bool, Key(text="its clients may power and home; usually on lo only", is_optional=True)] = True
    check_names: Annotated[bool, Key(text="joint names in messages give the order; false: they are ignored")] = True
    check_frames: Annotated[bool, Key(text="frames in headers count; false: they are ignored")] = True
    pid: Annotated[Literal["off", "ro", "rw"], Key()] = "off"  # joint controllers: ro: seen, rw: also commanded
    io: Annotated[Literal["off", "ro", "rw"], Key()] = "off"  # the same
    tf: Annotated[bool, Key()] = True
    stats: Annotated[bool, Key()] = True


@dataclass(frozen=True, slots=True)
class SocketBridge:
    """The socket bridge. Values that are None depend on the address that a client connects to: see `rights_at`."""

    listen: tuple[str, ...]
    token_file: str = ""  # with the token that clients on other machines must send first
    certificate: str = ""  # of TLS, with its key; empty: no TLS
    key: str = ""
    authorities: str = ""  # clients must have a certificate of these
    grants: str | None = None  # VIEW or COMMAND
    may_power: bool | None = None
    max_clients: int = 64

    def rights_at(self, address: str) -> Rights:
        """Rights of clients that connect to this address: by default everything on loopback, else view only."""
        local = is_loopback(address)
        commands = local if self.grants is None else self.grants == COMMAND
        powers = local if self.may_power is None else self.may_power
        return Rights(local, commands, commands and powers)


@dataclass(frozen=True, slots=True)
class FoxgloveServer:
    """The server for Foxglove and Lichtblick: topics and the robot in 3D, view only."""

    listen: str
    rate_hz: float
    certificate: str = ""  # of TLS, with its key; empty: no TLS
    key: str = ""


@dataclass(frozen=True, slots=True)
class WebConsole:
    """The web console: its addresses and access rules; fields have the meaning of the socket bridge's."""

    listen: tuple[str, ...]
    token_file: str = ""
    certificate: str = ""
    key: str = ""
    authorities: str = ""
    max_clients: int = 16
    makes_token: bool = False  # at each start, as other machines may connect, and no other access rule is configured

    def links(self, token: str = "", here: str = "") -> list[str]:
        """Addresses for browsers; `token` is appended where the console asks for it.

        `here`: the name of this machine, used if the console listens at all addresses, with one more link for loopback.
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
    """Rights of a client; `local`: programs of this system's user on this machine need no token."""

    local: bool
    commands: bool
    powers: bool


def is_loopback(address: str) -> bool:
    """Whether an address of `listen` can be reached from this machine only."""
    return ip_address(host_and_port(address)[0]).is_loopback
