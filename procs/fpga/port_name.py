"""Names of ports in configuration files, and their meaning."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Final

UDP: Final = "udp"
ETHERNET: Final = "eth"
FIREWIRE: Final = "fw"
DEFAULT_ADDRESS: Final = "169.254.0.100"
PORTS: Final = "udp[:IP], udpfw[:IP], eth[:N or interface], ethfw[:N or interface], fw[:N], or a number N for fw:N"

_KINDS: Final = {"udp": (UDP, False), "udpfw": (UDP, True), "eth": (ETHERNET, False), "ethfw": (ETHERNET, True),
                 "fw": (FIREWIRE, True)}
_INTERFACE: Final = re.compile(r"[^\s/:]{1,15}\Z")
_LARGEST: Final = 99


class PortNameError(ValueError):
    """Not the name of a port we can open: the problem, and the allowed names."""

    def __init__(self, what: str, allowed: str = PORTS) -> None:
        super().__init__(f"{what}; allowed: {allowed}")
        self.what = what
        self.allowed = allowed


@dataclass(frozen=True, slots=True)
class PortName:
    """A port: its kind (`UDP`, `ETHERNET`, `FIREWIRE`), its place, and whether a hub must bridge to FireWire in any
    case.

    `where` is an IPv4 address (UDP), an Ethernet interface or its index (0 is the first), or the index of a FireWire
    card.
    """

    kind: str
    where: str
    bridge: bool

    @classmethod
    def parse(cls, text: str) -> PortName:
        """The parts of a port's name; PortNameError for names of ports that cannot be opened."""
        text = text.strip()
        if text.isascii() and text.isdecimal():
            text = f"fw:{text}"
        word, _, where = text.partition(":")
        if word == "emio":
            raise PortNameError("emio runs on the processor of a controller, not on a computer beside it")
        if word not in _KINDS:
            raise PortNameError("no such port")
        kind, bridge = _KINDS[word]
        return cls(kind, _where(kind, where), bridge)

    @property
    def owned(self) -> str:
        """The resource with one owner at a time: the same for all names of one bus."""
        return f"{self.kind}:{self.where}"


def _where(kind: str, where: str) -> str:
    if kind == UDP:
        try:
            return str(ipaddress.IPv4Address(where or DEFAULT_ADDRESS))
        except ValueError as error:
            raise PortNameError("no IPv4 address after the colon", "udp[:a.b.c.d], udpfw[:a.b.c.d]") from error
    where = where or "0"
    if where.isascii() and where.isdecimal():
        if int(where) > _LARGEST:
            raise PortNameError("the number after the colon is out of range", f"0 to {_LARGEST}")
        return str(int(where))
    if kind == ETHERNET and _INTERFACE.match(where):
        return where
    raise PortNameError("neither a number nor an interface after the colon")
