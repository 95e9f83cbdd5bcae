"""Two buses with robots on a fake world, and what a host asks them."""

from __future__ import annotations

import numpy as np

from tests.fpga import board_side
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import (
    Actuator,
    BusConfig,
    Controller,
    DigitalInput,
    Encoder,
    IoConfig,
    Linear,
    Potentiometer,
    Robot,
    SystemConfig,
)
from trocar.procs.document.system import EmulationConfig as EmulationRow
from trocar.procs.fpga import wire

MS = 1_000_000
START = 77_000_000_123


class Rails(Plant):
    """A world without physics: every actuator runs at a speed of its own; currents are only noted."""

    def __init__(self, axes: int) -> None:
        self.period_s = 1e-3
        self.position = np.linspace(-0.3, 0.4, axes)
        self.velocity = np.zeros(axes)
        self.pot_position = self.position.copy()
        self.acceleration = np.zeros(axes)
        self.currents: list[np.ndarray] = []

    def step_current(self, current: np.ndarray) -> None:
        self.currents.append(current.copy())
        self.velocity += self.acceleration * 1e-3
        self.position += self.velocity * 1e-3
        self.pot_position[:] = self.position

    def brake(self, robot: str, actuators: np.ndarray, engaged: bool) -> None:
        """Nothing here has any."""


def _actuator(board: int, axis: int, sign: float) -> Actuator:
    return Actuator(
        board, axis, "REVOLUTE", 10.0, Linear(sign * 5242.88, 32768.0 + 10 * axis),
        Linear(sign / 5242.88, -sign * 6.25), 1.0, Encoder(Linear(sign * 2.1e-5, 0.01), -1.0, 1.0, "FIRMWARE"),
        Potentiometer(Linear(6.866455e-5, 0.0), Linear(sign * 0.5, -sign * 1.1)))


def _io(name: str, robot: str, actuators: tuple[Actuator, ...], *inputs: DigitalInput) -> IoConfig:
    return IoConfig(name, "udp:127.1.2.16", "broadcast-query-read-write", 1 / 1500, 0.03, False,
                    (Robot(robot, "1", "QLA1", actuators),), (), inputs)


def two_buses(noise: float = 0.0, address: str = "127.91.7.16") -> SystemConfig:
    clutch = DigitalInput("clutch", 9, 4, True, True, True)
    limit = DigitalInput("limit", 3, 0, False, True, True)
    ios = (_io("IO1", "PSM1", tuple(_actuator(b, k, s) for b, k, s in
                                    ((9, 0, 1), (9, 1, -1), (9, 3, 1), (3, 0, -1), (3, 2, 1))), clutch, limit),
           _io("IO2", "ECM", tuple(_actuator(9, k, 1.0) for k in range(2))))
    buses = (BusConfig("IO1", address, (Controller(9), Controller(3))),
             BusConfig("IO2", "127.91.7.32", (Controller(9),)))
    return SystemConfig("t", "", "lockstep", ios, (), EmulationRow(1e-3, buses, pot_noise_v=noise), ())


def real_time(world: Emulation, bus: int, node: int, now: int) -> np.ndarray:
    reply = world.answer(bus, wire.block_read(node, 0, 128, 1, 1), now)
    response = board_side.decode_response(reply or b"")
    assert isinstance(response, board_side.WireResponse)
    return np.frombuffer(response.data, ">u4").astype(np.int64)


def write(world: Emulation, bus: int, node: int, address: int, value: int, now: int) -> None:
    assert world.answer(bus, wire.quadlet_write(node, address, value, 1, 1), now) is None
