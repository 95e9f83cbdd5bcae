"""One healthy robot on a stepped clock, all that may break on it, and what io does about each: see the matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.io.harness import IoHarness, robot
from trocar.procs.document.system import Brake, Linear
from trocar.procs.fpga import blocks, lookup, registers
from trocar.procs.tables.codes import FAULTS

RELEASED_A, ENGAGED_A = 0.1, 0.0
EFFORT = 0.4  # what the robot is asked for, 0.2 A on every actuator
NOWHERE = 4095  # the reading of a digital potentiometer that has no position
BUTTON = np.uint32(1)


def braked(**changes) -> IoHarness:
    brake = Brake(1, 3, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.5, 0.4, 0.05, RELEASED_A, ENGAGED_A)
    return IoHarness(robots=(robot("PSM1", 0, brakes=(brake,), **changes),), period_s=1 / 1024)


def working(harness: IoHarness, grace_over: bool = True) -> IoHarness:
    """Power, joint controller, brakes, all checks; then nothing more is told. Power has been on for long, or not."""
    harness.control()
    harness.ask("brake_release")
    harness.ask("tracking_check", 1)
    harness.ask("pot_check", 1)
    harness.send(1, in_effort=True, effort=EFFORT)
    harness.run_s(0.07)
    harness.pass_s(4.0 * grace_over)
    harness.run_s(0.02)
    assert harness.codes == [] and harness.record.pid_enabled[0] and harness.record.brakes_released[0]
    assert (harness.record.current_request[:7] == EFFORT / 2).all()
    harness.core.reports.events.clear()
    return harness


def digital() -> IoHarness:
    """An arm whose potentiometers are a table, as on an Si: reading 2048 is 0, the last reading is nowhere."""
    table = [[(reading - 2048) / 1000 for reading in range(NOWHERE)] + [31.4159]] * 7
    harness = braked(lookup=lookup.pack(table))
    read_pots(harness, 2048)
    return harness


def read_pots(harness: IoHarness, reading: int, axis: int | None = None) -> None:
    for row, channel in [(a // 4, a % 4) for a in (range(7) if axis is None else [axis])]:
        word = int(harness.port.live[row, blocks.ADC.start + channel]) & 0xFFFF
        harness.port.live[row, blocks.ADC.start + channel] = reading << 16 | word


def status(bits: int) -> Callable[[IoHarness], None]:
    return lambda harness: harness.port.set_status(bits)


def nan_effort(harness: IoHarness) -> None:
    harness.arms[0].effort[3] = np.nan


def hot(harness: IoHarness) -> None:
    harness.port.live[0, blocks.TEMPERATURE] = 60 << 8 | 66 * 2


def overflow(harness: IoHarness) -> None:
    harness.port.live[0, blocks.POSITION.start + 2] |= np.uint32(registers.ENCODER_OVERFLOW)


def lose_supply(harness: IoHarness) -> None:
    harness.port.has_supply = False
    harness.port.set_status(registers.STATUS_MV_GOOD, on=False)


def lose_packets(harness: IoHarness) -> None:
    harness.port.good = False


def cut_amplifier(harness: IoHarness) -> None:
    harness.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)


def kill_amplifier(harness: IoHarness) -> None:
    harness.port.dead_amps.add((0, 1))
    harness.port.live[0, blocks.STATUS] &= np.uint32(0xFFFFFFFF ^ (1 << registers.STATUS_AMP_ON_SHIFT + 1))


def heal(harness: IoHarness) -> None:
    """What a person does: the cause is removed."""
    port = harness.port
    port.good = port.has_supply = True
    port.dead_amps.clear()
    port.set_status(registers.STATUS_WATCHDOG | registers.STATUS_MV_FAULT | 0xF << registers.STATUS_SAFETY_SHIFT,
                    on=False)
    port.live[:, blocks.TEMPERATURE] = 60 << 8 | 60
    port.live[:, blocks.POSITION] = 0x800000
    for axis in range(7):
        port.current(axis, 0.0)
        port.pot(axis, 0.0)
    if harness.io.robots[0].lookup:
        read_pots(harness, 2048)
    harness.arms[0].effort[...] = EFFORT


@dataclass(frozen=True)
class FaultRow:
    """One fault: what breaks, the cycle in which io acts, and what is told of it."""

    name: str
    breaks: Callable[[IoHarness], None]
    cycle: int
    code: str
    axis: int = -1
    powered: bool = False  # still, afterwards
    relay: bool = True  # still closed
    before: tuple[str, ...] = ()  # events ahead of the error
    after: tuple[str, ...] = ("power off",)
    needs_bias: bool = False
    made: Callable[[], IoHarness] = braked

    def __str__(self) -> str:
        return self.name


ROWS = (
    # the encoders of fake boards are set to exactly mid-range, where they are after power-up, too
    FaultRow("bad-packets", lose_packets, 31, "bad-reads", before=("read-missed",), needs_bias=True),
    FaultRow("nan-effort", nan_effort, 1, "not-finite", 3, powered=True, after=()),
    FaultRow("over-current", lambda harness: harness.port.current(4, 1.3), 101, "current", 4),
    FaultRow("board-cut-off", cut_amplifier, 1, "safety-amp-disable", 5),
    FaultRow("over-65-degrees", hot, 1, "temperature", 2),
    FaultRow("pot-off", lambda harness: harness.port.pot(6, 0.06), 11, "potentiometer", 6),
    FaultRow("encoder-overflow", overflow, 1, "encoder-overflow", 2, needs_bias=True),
    FaultRow("watchdog", status(registers.STATUS_WATCHDOG), 1, "watchdog", before=("power lost",)),
    FaultRow("supply-fault", status(registers.STATUS_MV_FAULT), 1, "power-fault", before=("power lost",)),
    FaultRow("power-loss-after-3-s", lose_supply, 1, "power-lost", before=("power lost",)),
    FaultRow("dead-amplifier", kill_amplifier, 53, "amplifier", 1),
    FaultRow("si-missing-pot", lambda harness: read_pots(harness, NOWHERE, 5), 1, "pot-missing", 5, relay=False,
             made=digital),
)
NUMBERS = {row.code: row.number for row in FAULTS}


def reported(harness: IoHarness) -> list[str]:
    """Events in their order: codes of warnings and errors, texts of the others."""
    return [event.code or event.text for event in harness.core.reports.events]


def brake_a(harness: IoHarness) -> float:
    return round((int(harness.port.sent[-1][1, 3] & 0xFFFF) - 32768.0) / 5242.88, 3)


def is_off(harness: IoHarness) -> bool:
    """Whether the last write asks for motor power off, amplifiers disabled and no current on every board."""
    sent = harness.port.sent[-1]
    power = (sent[:, 4] & 0x000C0000 == registers.CONTROL_POWER_OFF).all()
    return bool(power and (sent[:, :4] & 0x3000FFFF == 0x20008000).all())


def zero_current(harness: IoHarness) -> bool:
    return bool((harness.currents[:7] == 0x8000).all())


def relays_open(harness: IoHarness) -> bool:
    """Whether the last write opens the safety relays of all boards."""
    return bool((harness.port.sent[-1][:, 4] & registers.CONTROL_RELAY_MASK == registers.CONTROL_RELAY_OFF).all())
