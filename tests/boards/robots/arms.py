"""Robots and arms for tests of the plant, from the stock files."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests import stock
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import (
    Actuator,
    ArmConfig,
    EmulationConfig,
    Encoder,
    IoConfig,
    Linear,
    ModelVariation,
    Robot,
    SystemConfig,
)

PERIOD = 1e-3
LND = "LARGE_NEEDLE_DRIVER_400006"
LND_SI = "LARGE_NEEDLE_DRIVER_420006"
SNAKE = "NEEDLE_DRIVER_400117"


def robot(name: str, types: str) -> Robot:
    one = Linear(1.0, 0.0)
    actuators = tuple(
        Actuator(
            board_id=6 + i // 4,
            axis_id=i % 4,
            joint_type="PRISMATIC" if kind == "P" else "REVOLUTE",
            effort_to_current=0.5,
            current_to_bits=one,
            bits_to_current=one,
            maximum_current=1.0,
            encoder=Encoder(one, -1.0, 1.0, "FIRMWARE"),
        )
        for i, kind in enumerate(types)
    )
    return Robot(name, "0", "QLA1", actuators)


def arm(name: str, kind: str, file: str, tool: str = "") -> ArmConfig:
    return ArmConfig(
        name=name,
        type=kind,
        generation="Classic",
        serial="0",
        io="IO1",
        robot=name,
        simulation="NONE",
        period_s=1 / 1500,
        chain=stock.chain(file),
        tool=stock.tool(tool) if tool else None,
    )


def system(robots: tuple[Robot, ...], arms: tuple[ArmConfig, ...], seed: int = 1,
           *like: ModelVariation) -> SystemConfig:
    io = IoConfig("IO1", "udp:127.1.0.16", "broadcast-query-read-write", 1 / 1500, 0.03, True, robots, (), ())
    return SystemConfig("test", "", "lockstep", (io,), arms,
                        EmulationConfig(PERIOD, (), seed=seed, model_variations=like),
                        ())


def psm(tool: str = LND, count: int = 1, seed: int = 1, *like: ModelVariation) -> Plant:
    names = [f"PSM{i + 1}" for i in range(count)]
    robots = tuple(robot(name, "RRPRRRR") for name in names)
    return Plant(system(robots, tuple(arm(name, "PSM", "PSM", tool) for name in names), seed, *like))


def si(kind: str, pitch: float = 0.0, tool: str = "", endoscope: float = 0.0,
       like: ModelVariation | None = None) -> Plant:
    """A PSM or ECM Si with the links and masses of its physical file, an ECM with an endoscope of so many kg."""
    file = f"{kind}_Si"
    links = stock.chain(f"{file}_physical")
    if kind == "ECM":
        last = dataclasses.replace(links.links[-1], mass=endoscope)
        links = dataclasses.replace(links, links=(*links.links[:-1], last))
    one = dataclasses.replace(arm(kind, kind, file, tool), generation="Si", mounting_pitch=pitch)
    likes = (like,) if like is not None else ()
    return Plant(system((robot(kind, "RRPRRRR" if kind == "PSM" else "RRPR"),), (one,), 1, *likes), {kind: links})


def run(plant: Plant, effort: np.ndarray, steps: int) -> None:
    """So many steps under constant efforts."""
    for _ in range(steps):
        plant.step(effort)


def holding(plant: Plant, name: str, position: np.ndarray) -> np.ndarray:
    """Motor efforts that hold the plant's only arm still, from how it starts to move without and under unit efforts."""
    starts = []
    for effort in (np.zeros(plant.axes), *np.eye(plant.axes)):
        plant.place(name, position)
        plant.step(effort)
        starts.append(plant.velocity.copy())
    return -np.linalg.solve((np.array(starts[1:]) - starts[0]).T, starts[0])
