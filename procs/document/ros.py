"""The ROS bridge as the document has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from trocar.procs.document.keys import Key


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
