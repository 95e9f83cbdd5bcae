"""Brakes on motor channels: what current lets them go, and that the host sees it flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.boards.rails import MS, START, Rails, two_buses, write
from trocar.procs.boards.emulation import Emulation
from trocar.procs.document.system import Brake, Linear, SystemConfig
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

SCALE, OFFSET = 16000.0, -32768.0  # an offset as in real files: right in the 16 bits of a command


class BrakedRails(Rails):
    """Notes what its brakes hold."""

    def __init__(self, axes: int) -> None:
        super().__init__(axes)
        self.held: dict[str, np.ndarray] = {}

    def brake(self, robot: str, actuators: np.ndarray, engaged: bool) -> None:
        held = self.held.setdefault(robot, np.zeros(len(actuators), dtype=bool))
        held[actuators] = engaged


def braked() -> SystemConfig:
    """PSM1 of the first bus with a brake for its first two actuators, on axes 1 and 3 of board 3."""
    system = two_buses()
    brakes = tuple(Brake(3, axis, Linear(SCALE, OFFSET), Linear(1 / SCALE, -2.048), 0.3, sign * 0.25, 0.5, sign * 0.08,
                         0.0) for axis, sign in ((1, 1.0), (3, -1.0)))
    first = replace(system.ios[0], robots=(replace(system.ios[0].robots[0], brakes=brakes),))
    return replace(system, ios=(first, system.ios[1]))


class BrakeBench:
    def __init__(self) -> None:
        self.world = BrakedRails(7)
        self.boards = Emulation(braked(), self.world, START)
        self.now = START

    def wait(self, ms: int) -> None:
        self.now += ms * MS
        self.boards.advance(self.now)

    def command(self, axis: int, amps: float) -> None:
        word = 0xB000_0000 | int(OFFSET + SCALE * amps) & 0xFFFF
        write(self.boards, 0, 1, reg.axis_register(axis, reg.DAC), word, self.now)
        self.wait(3)

    @property
    def held(self) -> list[bool]:
        return [bool(flag) for flag in self.world.held["PSM1"][:3]]


@pytest.fixture
def bench() -> BrakeBench:
    made = BrakeBench()
    write(made.boards, 0, wire.BROADCAST, reg.WATCHDOG, 0, made.now)
    write(made.boards, 0, wire.BROADCAST, reg.STATUS, reg.CONTROL_POWER_ON, made.now)
    made.wait(100)
    return made


def test_brakes_hold_until_their_current_lets_them_go(bench: BrakeBench) -> None:
    assert bench.held == [True, True, False]
    bench.command(1, 0.25)
    assert bench.held == [False, True, False]
    bench.command(3, -0.25)
    assert bench.held == [False, False, False]


def test_a_brake_that_let_go_needs_less_to_stay_so_and_none_to_hold(bench: BrakeBench) -> None:
    bench.command(1, 0.08)
    assert bench.held[0], "not enough to let go"
    bench.command(1, 0.25)
    bench.command(1, 0.08)
    assert not bench.held[0]
    bench.command(1, 0.0)
    assert bench.held[0]


def test_brakes_hold_when_the_amplifiers_are_cut(bench: BrakeBench) -> None:
    bench.command(1, 0.25)
    write(bench.boards, 0, wire.BROADCAST, reg.STATUS, reg.CONTROL_POWER_OFF, bench.now)
    bench.wait(3)
    assert bench.held[:2] == [True, True]


def test_the_current_of_a_brake_is_measured_as_its_file_says(bench: BrakeBench) -> None:
    bench.command(3, -0.25)
    adc = int(bench.boards.lines.adc[0, 3]) & 0xFFFF
    assert adc / SCALE - 2.048 == pytest.approx(-0.25, abs=1e-4)
