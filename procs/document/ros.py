"""The ROS bridge as the document has it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RosBridge:
    """Domain and network interface it is seen on, and what of the robot."""

    domain: int
    interface: str
    period_s: float
    namespace: str = ""
    may_power: bool = True  # people on the network may power and home
    pid: str = "off"  # joint controllers: ro: seen, rw: also commanded
    io: str = "off"  # the same
    tf: bool = True
    stats: bool = True
