"""A test stand for io's core: robots on fake boards with a fake clock; nothing here needs shared memory or a bus."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np

from tests.command_rows import row_named
from tests.guarded import objection
from trocar.procs.document.system import (
    Actuator,
    DigitalInput,
    Encoder,
    IoConfig,
    Linear,
    PidAxis,
    PidConfig,
    Potentiometer,
    Robot,
    Tolerance,
)
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.bus.discovery import BoardInfo
from trocar.procs.io.bus.link import Counters
from trocar.procs.io.cycle import RobotIo
from trocar.procs.io.halves import Halves
from trocar.procs.io.pid import Pid
from trocar.procs.io.record import IoRecord, private
from trocar.procs.io.setpoint_rings import DesiredFields, RingSource
from trocar.procs.tables.desired_state import DESIRED_STATES
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.topics import SETPOINT

PERIOD_NS = 1_000_000_000 // 1024  # 976562 ns and a half: steps are counted in the boards' own ticks
TICKS = 48000  # 1/1024 s
COUNT = 1e-5
AMP_PER_BIT = 12.5 / 65536
POT_AT_ZERO = 32768


def actuator(board: int, axis: int, **changes) -> Actuator:
    values = {
        "board_id": board, "axis_id": axis, "joint_type": "REVOLUTE", "effort_to_current": 0.5,
        "current_to_bits": Linear(5242.88, 32768.0), "bits_to_current": Linear(AMP_PER_BIT, -6.25),
        "maximum_current": 1.0, "encoder": Encoder(Linear(COUNT, 0.0), -1.5, 1.5, "FIRMWARE"),
        "potentiometer": Potentiometer(Linear(4.5 / 65536, 0.0), Linear(1.0, -2.25)),
    }
    return Actuator(**(values | changes))


def gains(**changes) -> PidAxis:
    values = {"name": "a", "joint_type": "REVOLUTE", "p_gain": 1.0, "d_gain": 0.0, "i_gain": 0.0,
              "pid_max_output": -1.0, "tolerance": 0.2}
    return PidAxis(**(values | changes))


def robot(name: str, first_board: int, axes: int = 7, **changes) -> Robot:
    actuators = tuple(actuator(first_board + i // 4, i % 4) for i in range(axes))
    values = {"name": name, "serial": "1", "hardware": "QLA1", "actuators": actuators, "potentiometers": "ANALOG",
              "tolerances": tuple(Tolerance(0.05, 10 / 1024) for _ in range(axes))}
    return Robot(**(values | changes))


def document(robot_count: int = 1, **changes) -> IoConfig:
    names = [f"PSM{i + 1}" for i in range(robot_count)]
    values = {
        "name": "IO1", "port": "udp:127.1.2.3", "protocol": "broadcast-query-read-write", "period_s": 1 / 1500,
        "watchdog_s": 0.03, "close_all_relays": True,
        "robots": tuple(robot(n, 2 * i) for i, n in enumerate(names)),
        "pids": tuple(PidConfig(n, n, tuple(gains() for _ in range(7))) for n in names),
        "digital_inputs": (DigitalInput("clutch", 0, 0, False, True, True, debounce_s=0.0),),
    }
    return IoConfig(**(values | changes))


def pid_step(pid: Pid, position: np.ndarray, velocity: np.ndarray, exempt: np.ndarray) -> np.ndarray | None:
    """One cycle of joint controllers; the actuators whose tracking error is too large, or None."""
    tripped = pid.beyond(exempt) if pid.compare(position) else None
    pid.control(position, velocity)
    return tripped


class SteppedClock:
    """Time in ns that moves when told."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000

    def __call__(self) -> int:
        return self.ns


class FakePort:
    """Boards as arrays: power, relay and amplifiers obey at once, encoders take preloads."""

    def __init__(self, board_ids: tuple[int, ...]) -> None:
        self.board_ids = board_ids
        n = len(board_ids)
        self.blocks = np.zeros((n, 32), dtype=np.uint32)
        self.out = np.zeros((n, 5), dtype=np.uint32)
        self.hardware, self.columns = ("QLA1",) * n, blocks.Columns(4)
        self.live = np.zeros((n, 32), dtype=np.uint32)
        self.counters, self.stranger, self.read_only, self.assumed = Counters(n), "", "", ()
        self.recv_ns = self.send_ns = 0
        self.now_ns = SteppedClock()
        self.good = True
        self.has_supply = True
        self.dead_amps: set[tuple[int, int]] = set()
        self.sent: list[np.ndarray] = []
        self.quadlets: list[tuple[int, int, int]] = []
        self.registers: dict[tuple[int, int], int] = {}
        self.lost_writes = 0
        self.away = np.zeros(len(self.board_ids), dtype=bool)
        for row, board in enumerate(board_ids):
            self.live[row, blocks.STATUS] = 4 << 28 | board << 24
        self.live[:, blocks.TIMESTAMP] = TICKS - 1
        self.live[:, blocks.TEMPERATURE] = 60 << 8 | 60
        self.live[:, blocks.ADC] = POT_AT_ZERO << 16 | 0x8000
        self.live[:, blocks.POSITION] = 0x800000
        self.live[:, blocks.PERIOD] = registers.PERIOD_POWER_UP
        self.live[:, blocks.QUARTER_1] = self.live[:, blocks.QUARTER_5] = registers.QUARTER_POWER_UP
        self.live[:, blocks.RUNNING] = registers.RUNNING_POWER_UP

    def open(self) -> None: ...

    def close(self) -> None: ...

    def discover(self) -> tuple[BoardInfo, ...]:
        return tuple(BoardInfo(b, i, "QLA1", 8, 2, 0, i == 0) for i, b in enumerate(self.board_ids))

    def read_quadlet(self, board: int, address: int) -> int:
        return self.registers.get((board, address), 0x800000)

    def peek(self, board: int, address: int, quads: int = 1) -> np.ndarray:
        return np.array([self.read_quadlet(board, address)], np.uint32)

    def power_cycle(self, board: int) -> None:
        """Registers are as after power-up."""
        self.registers = {key: value for key, value in self.registers.items() if key[0] != board}

    def write_quadlet(self, board: int, address: int, value: int) -> None:
        self.quadlets.append((board, address, value))
        if self.lost_writes:
            self.lost_writes -= 1
            return
        self.registers[board, address] = value
        if address == registers.DIGITAL_OUTPUT:  # 1 is a low pin, and shown so
            mask, shown = value >> 8, blocks.DIGITAL_INPUT
            word, bits = int(self.live[self.board_ids.index(board), shown]), value & 0xFF
            shift = registers.INPUT_DOUT_SHIFT
            self.live[self.board_ids.index(board), shown] = word & ~(mask << shift) | (bits & mask) << shift
        if address >> 4 and address & 0xF == registers.ENCODER_PRELOAD:
            self.live[self.board_ids.index(board), blocks.POSITION.start + (address >> 4) - 1] = value

    def ask_all(self) -> None: ...

    def read_all(self) -> bool:
        self.counters.reads += 1
        if not self.good:
            self.counters.bad_reads += 1
            self.counters.board_bad_reads += 1
            return False
        self.blocks[~self.away] = self.live[~self.away]
        self.recv_ns = self.now_ns()
        return True

    exchange = None

    def set_exchange(self, halves) -> None: ...

    def write_all(self) -> bool:
        self.sent.append(self.out.copy())
        self.send_ns = self.now_ns()
        for row in range(len(self.board_ids)):
            self._obey(row)
        self.out[:, 4] = 0
        return True

    def _obey(self, row: int) -> None:
        status, control = int(self.live[row, blocks.STATUS]), int(self.out[row, 4])
        if control & registers.CONTROL_POWER_MASK:
            on = control & (1 << 18)
            status = status | registers.STATUS_POWER if on else status & ~registers.STATUS_POWER
            if on:
                status &= ~registers.STATUS_WATCHDOG
        if control & registers.CONTROL_RELAY_MASK:
            both = registers.STATUS_RELAY | registers.STATUS_RELAY_FEEDBACK
            status = status | both if control & (1 << 16) else status & ~both
        powered = status & registers.STATUS_POWER and self.has_supply
        status = status | registers.STATUS_MV_GOOD if powered else status & ~registers.STATUS_MV_GOOD
        for axis in range(4):
            word, bit = int(self.out[row, axis]), 1 << registers.STATUS_AMP_ON_SHIFT + axis
            if word & registers.DAC_AMP_MASK:
                status = status | bit if word & registers.DAC_AMP_ENABLE else status & ~bit
            if not powered or (row, axis) in self.dead_amps:
                status &= ~bit
        self.live[row, blocks.STATUS] = status

    def lose_power_on(self, times: int) -> None:
        """So many writes that switch motor power on do not arrive."""
        write, lost = self.write_all, [times]

        def lossy() -> bool:
            if lost[0] and (self.out[:, 4] & (registers.CONTROL_POWER_ON & ~registers.CONTROL_POWER_OFF)).any():
                lost[0] -= 1
                self.out[:, 4] = 0
                return True
            return write()

        self.write_all = lossy  # type: ignore[method-assign]

    def set_status(self, bits: int, on: bool = True) -> None:
        if on:
            self.live[:, blocks.STATUS] |= np.uint32(bits)
        else:
            self.live[:, blocks.STATUS] &= np.uint32(~bits & 0xFFFFFFFF)

    def place(self, axis: int, position: float) -> None:
        """Encoder and potentiometer of a flat axis of seven-axis robots on two boards each."""
        row, channel = 2 * (axis // 7) + axis % 7 // 4, axis % 7 % 4
        self.live[row, blocks.POSITION.start + channel] = round(position / COUNT) + 0x800000
        self.pot(axis, position)

    def pot(self, axis: int, position: float) -> None:
        row, channel = 2 * (axis // 7) + axis % 7 // 4, axis % 7 % 4
        word = int(self.live[row, blocks.ADC.start + channel]) & 0xFFFF
        self.live[row, blocks.ADC.start + channel] = round((position + 2.25) / 4.5 * 65536) << 16 | word

    def current(self, axis: int, amperes: float) -> None:
        row, channel = 2 * (axis // 7) + axis % 7 // 4, axis % 7 % 4
        word = int(self.live[row, blocks.ADC.start + channel]) & 0xFFFF0000
        self.live[row, blocks.ADC.start + channel] = word | round((amperes + 6.25) / AMP_PER_BIT)


class FakeSource:
    """Setpoints as an arm would send them."""

    def __init__(self) -> None:
        self.stamp_ns = 0
        self.mode, self.count = np.array(0), np.array(7)
        self.has_velocity, self.in_effort = np.array(False), np.zeros(8, dtype=bool)
        self.bias_generation, self.pid_generation = np.array(0), np.array(0)
        self.position, self.velocity, self.effort, self.feed_forward = (np.zeros(8) for _ in range(4))
        self.wished = private(SETPOINT, {})
        self.desired = DesiredFields(self.wished)

    def want(self, origin: Origin | None = None, **wanted: int) -> None:
        """Another generation: 0 none, 1 off, 2 on of the table's names; those not named are none."""
        for desired in DESIRED_STATES:
            self.wished(desired.field)[...] = wanted.get(desired.name, 0)
        self.wished("desired_generation")[...] += 1
        origin = origin or PERSON
        self.wished("desired_origin")[...], self.wished("desired_since")[...] = origin.id, origin.generation
        self.wished("desired_program")[...] = origin.program.encode()

    def newest(self) -> bool:
        return self.stamp_ns != 0


PERSON = Origin(1, 1 << 60, "test")


class FakeCommand:
    """A command that remembers its answers; a person's, unless it is given another origin."""

    def __init__(self, name: str, text: str = "PSM1", *values: float, origin: Origin = PERSON) -> None:
        self.name, self.text, self.values = name, text, np.array(values, dtype=float)
        self.answers: list[tuple[str, str]] = []
        self.origin, self.sender, self.command = origin, SenderId(0), row_named(name)
        self.pid, self.has_client = 4711, True

    def reaches_io(self) -> bool:
        """Whether io's mailbox lets it through."""
        reason = objection("io", self.name, self.values, self.text, self.origin)
        if reason:
            self.refuse(reason)
        return not reason

    def accept(self, text: str = "") -> None:
        self.answers.append(("accepted", text))

    def refuse(self, reason: str) -> None:
        self.answers.append(("refused", reason))

    def done(self, text: str = "") -> None:
        self.answers.append(("done", text))

    def fail(self, reason: str) -> None:
        self.answers.append(("failed", reason))

    @property
    def outcome(self) -> str:
        return self.answers[-1][0] if self.answers else ""


class IoHarness:
    """Core, boards, clock and arms; the arms are alive and ask for nothing unless told."""

    def __init__(self, robot_count: int = 1, preset: bool = True, sources: Sequence[RingSource] = (),
                 **changes) -> None:
        """`sources`: where setpoints really come from, in place of `arms`."""
        self.io = document(robot_count, **changes)
        boards = sorted({d.board_id for r in self.io.robots for d in (*r.actuators, *r.brakes)}
                        | {i.board_id for i in self.io.digital_inputs})
        self.clock, self.port = SteppedClock(), FakePort(tuple(boards))
        self.arms = [FakeSource() for _ in self.io.pids]
        axes = sum(len(r.actuators) for r in self.io.robots)
        self.record = IoRecord.private(axes, len(self.io.robots), len(self.io.digital_inputs),
                                       sum(len(r.brakes) for r in self.io.robots), len(self.io.digital_outputs))
        self.port.now_ns = self.clock
        self.arms_alive, self.held_up = True, False
        self.context = IoContext(self.io, self.clock, self.record, sources or self.arms, is_over=lambda: self.held_up)
        self.core = RobotIo(self.context, self.port, np.full(axes, preset))
        self.port.quadlets.clear()

    def by_numpy(self) -> IoHarness:
        """From now on without native code, whose insides no test can change."""
        self.core.halves = Halves(self.core.parts, self.context, (0, 1.0, 1.0), native=False)
        return self

    def run(self, cycles: int = 1, *commands: FakeCommand) -> None:
        for _ in range(cycles):
            self.clock.ns += PERIOD_NS
            if self.arms_alive:
                for arm, pid in zip(self.arms, self.io.pids, strict=True):
                    place = self.core.robots.names.index(pid.robot)
                    arm.stamp_ns = self.clock.ns - 100_000
                    arm.bias_generation[...] = self.record.bias_generation[place]
                    arm.pid_generation[...] = self.record.pid_generation[place]
            with np.errstate(all="ignore"):
                self.core.cycle([command for command in commands if command.reaches_io()])
            commands = ()

    def run_s(self, seconds: float) -> None:
        self.run(round(seconds * 1024))

    def pass_s(self, seconds: float) -> None:
        """Time passes in which nothing happens that would show in a cycle; no cycle runs."""
        self.clock.ns += round(seconds * 1e9)

    def ask(self, name: str, *values: float, robot: str = "PSM1") -> FakeCommand:
        command = FakeCommand(name, robot, *values)
        self.run(1, command)
        return command

    def power(self, robot: str = "PSM1") -> Self:
        command = self.ask("power_on", robot=robot)
        self.run(10)
        assert command.outcome == "done", command.answers
        return self

    def control(self, robot: str = "PSM1") -> Self:
        command = self.power(robot).ask("pid_enable", 1, robot=robot)
        assert command.outcome == "done", command.answers
        return self

    def send(self, mode: int, arm: int = 0, **arrays) -> None:
        self.arms[arm].mode[...] = mode
        for name, values in arrays.items():
            getattr(self.arms[arm], name)[...] = values

    @property
    def codes(self) -> list[str]:
        return [e.code for e in self.core.reports.events if e.kind == "error"]

    @property
    def currents(self) -> np.ndarray:
        """Current words last written, 0 in the middle, robots' axes only."""
        return self.core.parts.outputs.words & 0xFFFF

    def dac(self, row: int = 0) -> np.ndarray:
        return self.port.sent[-1][row, :4]


def with_actuators(row: Robot, **changes) -> Robot:
    return dataclasses.replace(row, actuators=tuple(dataclasses.replace(a, **changes) for a in row.actuators))
