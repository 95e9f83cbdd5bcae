"""Long plays of robots, arms and people around io's core: what it does in each cycle of them; see tests.traces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from tests.io.harness import POT_AT_ZERO, FakeCommand, IoHarness, actuator, gains, robot
from tests.traces import Mishaps, Trace, shown
from trocar.procs.document.system import Brake, Linear, PidConfig, Tolerance
from trocar.procs.fpga import blocks, lookup, registers
from trocar.procs.io.cycle import RobotIo
from trocar.procs.native.io_fields import LIMIT, MISSED, STATUS, TRACKING

FOLDER = Path(__file__).parent / "traces"
STEPS = 1800
MS = 1_000_000
TICKS_MS = 49152
PAUSES_MS = (10, 20, 29, 30, 31, 50, 51, 100, 200, 201, 500, 1000, 2000, 3000, 3001)
FIELDS = (
    "valid", "robot_valid", "power_requested", "powered", "amps_on", "watchdog", "power_fault", "relay", "biased",
    "biasing", "bias_generation", "brakes_released", "pot_check", "pid_enabled", "pid_generation", "limits_enforced",
    "tracking_check", "use_setpoint_velocity", "holding", "fault", "effort_mode", "at_limit", "setpoint_position",
    "setpoint_velocity", "setpoint_effort", "position_error", "amp_enabled", "desired_void", "desired_refused",
)
ASKED: tuple[tuple[str, tuple[float, ...]], ...] = (
    *((("power_on", ()), ("pid_enable", (1.0,))) * 4), ("power_off", (0.0,)), ("power_off", (1.0,)),
    ("pid_enable", (0.0,)), ("enforce_limits", (1.0,)), ("enforce_limits", (1.0,)), ("enforce_limits", (0.0,)),
    ("tracking_check", (1.0,)), ("tracking_check", (0.0,)), ("use_setpoint_v", (1.0,)), ("use_setpoint_v", (0.0,)),
    ("pot_check", (1.0,)), ("pot_check", (1.0,)), ("pot_check", (0.0,)), ("clear_fault", ()), ("servo_zero", ()),
    ("brake_release", ()), ("brake_release", ()), ("brake_engage", ()), ("supply_on", (0.05,)), ("supply_on", (2.0,)),
)
Pair = tuple[Callable[[], object], Callable[[], object]]


def braked() -> IoHarness:
    """A PSM with a brake, a gripper on one of its boards, and another PSM; measured current is compared."""
    brake = Brake(1, 3, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.5, 0.4, 0.05, 0.1, 0.0)
    gripper = robot("gripper", 1, 1, actuators=(actuator(1, 2, joint_type="PRISMATIC"),))
    axes = tuple(gains(d_gain=0.1, i_gain=0.01, i_limit=1.0, offset=0.01 * axis) for axis in range(6))
    return IoHarness(robots=(robot("PSM1", 0, 6, brakes=(brake,)), gripper, robot("PSM2", 2)),
                     pids=(PidConfig("PSM2", "PSM2", tuple(gains(p_deadband=0.01) for _ in range(7))),
                           PidConfig("PSM1", "PSM1", axes)), watchdog_s=0.03, period_s=0.001,
                     current_error_a=0.5, current_error_s=0.01, arm_lost_s=1.0, arm_lost_power_off_s=2.0)


def calibrated() -> IoHarness:
    """In calibration mode, with digital potentiometers of which one reading is nowhere, and axes without encoders."""
    table = [[(reading - 2048) / 1000 for reading in range(4095)] + [31.4159]] * 7
    bare = robot("bench", 2, actuators=(actuator(2, 0, encoder=None), actuator(2, 1, potentiometer=None)),
                 only_io=True, tolerances=(Tolerance(0.0, 0.01),))
    return IoHarness(robots=(robot("PSM1", 0, lookup=lookup.pack(table)), bare), calibration_mode=True,
                     period_s=0.001,                     current_error_a=0.3, current_error_s=0.005)


def guarded() -> IoHarness:
    """Digital potentiometers that are compared, and an arm that is never powered off for being away."""
    table = [[(reading - 2048) / 1000 for reading in range(4095)] + [31.4159]] * 7
    return IoHarness(robots=(robot("PSM1", 0, lookup=lookup.pack(table)), robot("PSM2", 2)),
                     arm_lost_power_off_s=0.0, period_s=0.001)


class IoPlay:
    """A core, and what happens around it."""

    def __init__(self, harness: IoHarness, seed: str) -> None:
        self.harness, self.chance, self.trace = harness, Random(seed), Trace()
        self.lag_ns = 100_000
        for source in harness.arms:
            source.mode[...] = 1
        for axis in np.flatnonzero(harness.core.robots.has_table).tolist():
            self.reading(axis, 2048)
        self.mishaps = Mishaps(self.chance, self.all_mishaps(), often=0.06, longest=150)

    def reading(self, axis: int, value: int) -> None:
        """Of a potentiometer."""
        robots, live = self.harness.core.robots, self.harness.port.live
        row, column = robots.board_row[axis], blocks.ADC.start + int(robots.channel[axis])
        live[row, column] = value << 16 | int(live[row, column]) & 0xFFFF

    def word(self, axis: int, column: int, value: int) -> Pair:
        """Another word of a board for an axis."""
        robots, live = self.harness.core.robots, self.harness.port.live
        place = robots.board_row[axis], column + int(robots.channel[axis])
        before = int(live[place])
        return lambda: live.__setitem__(place, value), lambda: live.__setitem__(place, before)

    def all_mishaps(self) -> list[Pair]:
        harness, port = self.harness, self.harness.port
        live, robots = port.live, harness.core.robots

        def status(row: int, bits: int) -> Pair:
            return (lambda: live.__setitem__((row, blocks.STATUS), int(live[row, blocks.STATUS]) | bits),
                    lambda: live.__setitem__((row, blocks.STATUS), int(live[row, blocks.STATUS]) & ~bits))

        def heat(celsius: float) -> Pair:
            return (lambda: live.__setitem__((0, blocks.TEMPERATURE), 60 << 8 | round(celsius * 2)),
                    lambda: live.__setitem__((0, blocks.TEMPERATURE), 60 << 8 | 60))

        def pair(owner: Any, name: str, value: object) -> Pair:
            before = getattr(owner, name)
            return lambda: setattr(owner, name, value), lambda: setattr(owner, name, before)

        def adc(axis: int, amperes: float, by: int = 0) -> Pair:
            digital = robots.has_table[axis]
            volts = min(2048 + by // 8, 4095) if digital else POT_AT_ZERO + by
            return self.word(axis, blocks.ADC.start, volts << 16 | round((amperes + 6.25) / 12.5 * 65536))

        def arm(place: int, **values: Any) -> Pair:
            source = harness.arms[place]
            before = {name: getattr(source, name).copy() for name in values}

            def put(all_of: dict[str, Any]) -> None:
                for name, value in all_of.items():
                    getattr(source, name)[...] = value

            return lambda: put(values), lambda: put(before)

        some = np.array([True, False] * 4)
        arms = [mishap for place in range(len(harness.arms)) for mishap in (
            arm(place, mode=0), arm(place, position=np.linspace(0.0, 0.12, 8)), arm(place, position=2.0),
            arm(place, position=np.full(8, 0.25)), arm(place, in_effort=True, effort=0.4),
            arm(place, in_effort=some, effort=-0.3, position=0.05, feed_forward=0.02),
            arm(place, velocity=0.5, has_velocity=True), arm(place, velocity=0.2, has_velocity=True, in_effort=some),
            arm(place, feed_forward=0.1), arm(place, count=3), arm(place, in_effort=some, effort=9.0),
            arm(place, position=np.array([0.0] * 5 + [math.nan] * 3)), arm(place, in_effort=some, effort=math.nan))]
        last = robots.axes - 1
        boards = [status(row, bits) for row in range(len(port.board_ids)) for bits in (
            registers.STATUS_WATCHDOG, registers.STATUS_MV_FAULT, 1 << registers.STATUS_SAFETY_SHIFT + 1)]
        axes = [mishap for axis in (0, 4, last) for mishap in (
            adc(axis, 0.15), adc(axis, 0.25), adc(axis, -0.55), adc(axis, 1.2), adc(axis, 0.0, 600),
            adc(axis, 0.0, -900), adc(axis, 0.0, 20000), adc(axis, 0.0, 730),
            self.word(axis, blocks.POSITION.start, 0x800000 + 7000),
            self.word(axis, blocks.POSITION.start, 0x800000 | registers.ENCODER_OVERFLOW))]
        return [
            *arms, *arms, *boards, *axes, heat(59.5), heat(60.0), heat(60.5), heat(65.0), heat(65.5),
            pair(port, "has_supply", False), pair(port, "good", False), pair(port, "good", False),
            (lambda: port.dead_amps.add((0, 1)), port.dead_amps.clear),
            (lambda: port.dead_amps.add((1, 2)), port.dead_amps.clear),
            pair(harness, "arms_alive", False), pair(self, "lag_ns", 30 * MS), pair(self, "lag_ns", 30 * MS + 1),
            pair(self, "lag_ns", -30 * MS), pair(self, "lag_ns", -31 * MS)]

    def step(self) -> None:
        harness, chance = self.harness, self.chance
        self.mishaps.step()
        pause_ms = chance.choice(PAUSES_MS) if chance.random() < 0.012 else 1
        commands = []
        if chance.random() < 0.06:
            name, values = chance.choice(ASKED)
            commands.append(FakeCommand(name, chance.choice((*harness.core.robots.names, "PSM1")), *values))
        for place, robot_name in enumerate(harness.core.robots.names):  # somebody wants to work
            if chance.random() < 0.06 and not harness.record.pid_enabled[place]:
                word = ("pid_enable", 1.0) if harness.record.amps_on[place] else ("power_on",)
                commands.append(FakeCommand(word[0], robot_name, *word[1:]))  # type: ignore[arg-type]
        harness.clock.ns += pause_ms * MS
        harness.port.live[:, blocks.TIMESTAMP] = pause_ms * TICKS_MS - 1
        for source, pid in zip(harness.arms, harness.io.pids, strict=True):
            place = harness.core.robots.names.index(pid.robot)
            if harness.arms_alive:
                source.stamp_ns = harness.clock.ns - self.lag_ns
            if harness.arms_alive and chance.random() < 0.99:
                source.bias_generation[...] = harness.record.bias_generation[place]
                source.pid_generation[...] = harness.record.pid_generation[place]
        harness.core.cycle(commands)
        self.look(commands)

    def look(self, commands: list[FakeCommand]) -> None:
        harness, events = self.harness, self.harness.core.reports.events
        did = [f"{c.name} {c.text}{shown(c.values)}: {', '.join(map(' '.join, c.answers))}" for c in commands]
        did += [f"{e.kind} {e.code} {e.component}: {e.text} ({e.axis} {e.value:.4g} {e.limit:.4g} {e.board})"
                for e in events]
        did += [f"write {board} {address:x} {value:x}" for board, address, value in harness.port.quadlets]
        events.clear()
        harness.port.quadlets.clear()
        sent = [" ".join(f"{word:x}" for word in row) for row in harness.port.sent[-1].tolist()]
        harness.port.sent.clear()
        names: list[tuple[str, Any]] = [(name, getattr(harness.record, name)) for name in FIELDS]
        self.trace.look(did, [*names, *((f"out {row}", words) for row, words in enumerate(sent))])


@pytest.mark.parametrize("made", [braked, calibrated, guarded], ids=lambda made: made.__name__)
def test_io_does_in_a_long_play_what_it_did(made: Callable[[], IoHarness]) -> None:
    play = IoPlay(made(), made.__name__)
    for _ in range(STEPS):
        play.step()
    play.trace.compare(FOLDER / f"{made.__name__}.txt")


@pytest.mark.slow
def test_a_calm_cycle_decides_nothing_and_would_do_the_same_if_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    harness = braked()
    decided: list[int] = []
    decide = harness.core._decide

    def deciding(bits: int, *given: Any) -> None:
        decided.append(bits)
        decide(bits, *given)

    monkeypatch.setattr(harness.core, "_decide", deciding)
    play = IoPlay(harness, "braked")
    for _ in range(STEPS):
        play.step()
    assert set(decided) >= {0, MISSED, STATUS, LIMIT} and any(bits & TRACKING for bits in decided)
    assert len(decided) < STEPS // 2
    monkeypatch.setattr(RobotIo, "_is_busy", lambda core: True)
    patient = IoPlay(braked(), "braked")
    for _ in range(STEPS):
        patient.step()
    assert patient.trace.lines == play.trace.lines
