"""The bridges to ROS and other programs, and the web console, in the document."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Final, Literal

from trocar.procs.document.keys import Key
from trocar.procs.document.process import host_and_port

VIEW: Final = "view"
COMMAND: Final = "command"


_DOMAIN: Final = Key(0, 232, "ROS_DOMAIN_ID of its clients")
_INTERFACE: Final = Key(
    pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:-]{0,39}$",
    text="network interface by name or address (letters, digits and _ . : -, at most 40); lo: this machine alone")


@dataclass(frozen=True, slots=True)
class RosBridge:
    """The ROS bridge: domain, network interface, and the parts of the robot that it exposes."""

    domain: Annotated[int, _DOMAIN] = 0
    interface: Annotated[str, _INTERFACE] = "lo"
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
class RosArm:
    """Where a CRTK arm is on ROS; domain and interface are by default those of the ROS bridge."""

    namespace: Annotated[str, Key(
        pattern=r"^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$", max_length=80, is_optional=True,
        text="in front of its topics, as /PSM1: letters, digits, _ and /")] = ""
    domain: Annotated[int, dataclasses.replace(_DOMAIN, text="ROS_DOMAIN_ID of the arm", is_optional=True)] = 0
    interface: Annotated[str, dataclasses.replace(_INTERFACE, is_optional=True)] = "lo"
    check_names: Annotated[bool, Key(text="joint names in its messages count; false: they are ignored")] = True

    @property
    def where(self) -> str:
        """Namespace, domain and interface in words."""
        return f"{self.namespace} in ROS domain {self.domain} on {self.interface}"


@dataclass(frozen=True, slots=True)
class SocketBridge:
    """The socket bridge. Values that are None depend on the address that a client connects to: see `rights_at`."""

    listen: tuple[str, ...]
    token_file: str = ""  # with the token that clients on other machines must send first
    certificate: str = ""  # of TLS, with its key; empty: no TLS
    key: str = ""
    authorities: str = ""  # clients must have a certificate of these
    grants: Annotated[Literal["view", "command"] | None, Key()] = None
    may_power: Annotated[bool | None, Key()] = None
    max_clients: Annotated[int, Key(1, 1000)] = 64

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
    rate_hz: Annotated[float, Key(1.0, 200.0, "Hz")] = 30.0
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
    max_clients: Annotated[int, Key(1, 100)] = 16
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


def reached_at(data: bytes) -> dict[str, tuple[str, ...]]:
    """Where clients reach the bridges that open their sockets themselves, by the process's name; `data`: a document."""
    document = json.loads(data)
    ros, foxglove = document.get("ros"), document.get("foxglove")
    return {"foxglove": (foxglove["listen"],) if foxglove else (),
            "ros_bridge": (f"ROS domain {ros['domain']} on {ros['interface']}",) if ros else ()}


def is_here(interface: str) -> bool:
    """Whether only programs of this machine reach a network interface of the ROS bridge."""
    return interface == "lo" or interface.startswith("127.")


def is_loopback(address: str) -> bool:
    """Whether an address of `listen` can be reached from this machine only."""
    return ip_address(host_and_port(address)[0]).is_loopback
