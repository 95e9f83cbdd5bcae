"""A PSM as its files would have it, with a fixed large needle driver or bare."""

from __future__ import annotations

from typing import Any

from trocar.procs.document.system import ArmConfig, Chain, DhLink, JawConfig, Tool

EYE = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))


def link(name: str, kind: str, alpha: float, a: float, d: float, offset: float, lower: float, upper: float) -> DhLink:
    return DhLink(name, kind, alpha, a, 0.0, d, offset, lower, upper, 1.0)


CHAIN = Chain(
    "modified",
    (
        link("yaw", "revolute", 1.5708, 0.0, 0.0, 1.5708, -1.588, 1.588),
        link("pitch", "revolute", -1.5708, 0.0, 0.0, -1.5708, -0.925025, 0.925025),
        link("insertion", "prismatic", 1.5708, 0.0, 0.0, -0.4318, 0.0, 0.24),
    ),
    source="PSM.json",
)
TOOL = Tool(
    "LARGE_NEEDLE_DRIVER_400006",
    (
        link("roll", "revolute", 0.0, 0.0, 0.4162, 0.0, -4.53786, 4.53786),
        link("wrist_pitch", "revolute", -1.5708, 0.0, 0.0, -1.5708, -1.39626, 1.39626),
        link("wrist_yaw", "revolute", -1.5708, 0.0091, 0.0, -1.5708, -1.39626, 1.39626),
    ),
    JawConfig(-0.698132, 1.39626, 0.16),
    ((0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    ((-1.5632, 0.0, 0.0, 0.0), (0.0, 1.0186, 0.0, 0.0), (0.0, -0.8306, 0.6089, 0.6089), (0.0, 0.0, -1.2177, 1.2177)),
    (-4.5378, -0.2618, -0.2618, 0.0),
    (4.5378, 0.2618, 0.2618, 0.0),
    names=("LARGE_NEEDLE_DRIVER",),
    model="400006",
)


def bare_arm(**changes: Any) -> ArmConfig:
    """A PSM with manual tool detection and nothing on it."""
    values: dict[str, Any] = {"tools": (TOOL,), **changes}
    return ArmConfig("PSM1", "PSM", "Classic", "28007", "IO1", "PSM1", "NONE", 1 / 1500, CHAIN, **values)


def fixed_arm(**changes: Any) -> ArmConfig:
    """A PSM with a fixed large needle driver."""
    return bare_arm(tool_detection="FIXED", tool=TOOL, **changes)
