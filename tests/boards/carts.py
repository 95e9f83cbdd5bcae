"""A patient cart's setup joints from the site's files, and a host that steps their multiplexer."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from tests import stock
from tests.boards.rails import MS, START, Rails
from tests.fpga import board_side
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.setup_joints import SetupJointsPlant
from trocar.procs.config import load_system
from trocar.procs.document.emulated import EmulatedSetupArm
from trocar.procs.document.emulated import EmulatedSetupJoints as Described
from trocar.procs.document.system import Controller, SystemConfig
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

RESET, INCREMENT, PWM, DISABLE = range(4)  # bits of the digital outputs
ONE_SHOT_S = 1e-4
V_PER_BIT = 6.8664600000000007e-05
JOINTS, CHANNELS, PLUGS = 6, 16, 4
CURRENT_SCALE = 5242.88
BOARD = Controller(12)
PLACES = {
    "ECM": (0.41, -0.3, 0.2, 3.3, 0.0, 0.0),
    "PSM1": (0.52, 0.4, -1.1, 0.3, 0.2, -0.7),
    "PSM2": (0.33, -0.5, 0.9, -0.2, -0.4, 0.6),
    "PSM3": (0.21, 0.1, 0.15, 0.25, -0.35, 0.45),
}


@cache
def cart(board: Controller = BOARD, noise: float = 0.0) -> SystemConfig:
    """The setup joints of the site's files on a controller."""
    loaded = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")],
                         boards="emulated")
    assert loaded.system is not None and loaded.system.emulation is not None
    emulation = loaded.system.emulation
    bus = dataclasses.replace(emulation.buses[0], controllers=(board,))
    emulation = dataclasses.replace(emulation, buses=(bus,), pot_noise_v=noise)
    return dataclasses.replace(loaded.system, emulation=emulation).emulated()


class CartHost:
    """Steps the multiplexer as the original software does: looks every millisecond, and never knows more."""

    def __init__(self, system: SystemConfig, settle_ms: int = 30, samples: int = 3) -> None:
        self.world = Emulation(system, Rails(4), START)
        self.now = START
        self._settle_ms, self._samples = settle_ms, samples
        self.outputs = 0  # as last read, 1: high
        self.volts = np.zeros((PLUGS, CHANNELS))
        self.write(reg.WATCHDOG, 0)
        self.one_shot(RESET, low_s=ONE_SHOT_S)
        self.one_shot(INCREMENT, high_s=ONE_SHOT_S)
        self.wait(1)

    @property
    def joints(self) -> SetupJointsPlant:
        return self.world.setup_joints["SUJ"]

    def wait(self, ms: float) -> None:
        self.now += round(ms * MS)
        self.world.advance(self.now)

    def write(self, address: int, value: int) -> None:
        assert self.world.answer(0, wire.quadlet_write(0, address, value, 1, 1), self.now) is None

    def read(self, address: int) -> int:
        reply = self.world.answer(0, wire.quadlet_read(0, address, 1, 1), self.now)
        response = board_side.decode_response(reply or b"")
        assert isinstance(response, board_side.WireResponse)
        return response.value

    # -- outputs, as the original library writes them ------------------------------------------------------------------

    def one_shot(self, output: int, high_s: float = 0.0, low_s: float = 0.0) -> None:
        high, low = (round(span * reg.CLOCK_HZ) for span in (high_s, low_s))
        self.write(reg.axis_register(output, reg.PWM), low << 16 | high)

    def pwm(self, duty: float) -> None:
        self.one_shot(PWM, duty / 40_000, (1.0 - duty) / 40_000)

    def set(self, output: int, high: bool) -> None:
        """All four outputs are written at once, as they were last read but for this one."""
        levels = self.outputs & ~(1 << output) | high << output
        self.write(reg.DIGITAL_OUTPUT, 0xF00 | ~levels & 0xF)

    # -- inputs --------------------------------------------------------------------------------------------------------

    def look(self) -> tuple[int, list[float]]:
        """The channel the lines show, and the volts of the four analog inputs."""
        inputs = self.read(reg.DIGITAL_INPUT)
        self.outputs = ~inputs >> reg.INPUT_DOUT_SHIFT & 0xF
        volts = [(self.read(reg.axis_register(axis, reg.ADC)) >> 16) * V_PER_BIT for axis in range(PLUGS)]
        return inputs >> reg.INPUT_ENCODER_A_SHIFT & 0xF, volts

    def reset(self) -> None:
        self.look()
        self.set(INCREMENT, False)
        self.set(RESET, False)
        self.wait(self._settle_ms)

    def sweep(self) -> None:
        """Read all channels; the counter is at 0 before and after."""
        for channel in range(CHANNELS):
            seen = []
            for _ in range(self._samples):
                self.wait(1)
                shown, volts = self.look()
                assert shown == channel
                seen.append(volts)
            self.volts[:, channel] = np.mean(seen, axis=0)
            if channel < CHANNELS - 1:
                self.set(INCREMENT, True)
            else:
                self.set(RESET, False)
            self.wait(self._settle_ms)

    def joints_of(self, described: Described, secondary: bool) -> dict[str, list[float]]:
        """What the file's conversions make of the voltages."""
        first = JOINTS if secondary else 0
        return {arm.name: [scale * volts + offset for volts, (scale, offset) in zip(
            self.volts[arm.plug - 1, first : first + JOINTS], arm.secondary if secondary else arm.primary, strict=True)]
            for arm in described.arms}

    # -- brakes --------------------------------------------------------------------------------------------------------

    def power_on(self) -> None:
        self.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
        self.wait(100)
        self.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
        self.wait(1)

    def current(self, plug: int, amps: float) -> None:
        offsets = (32649.999274371472, 33286.737543953452, 33251.849428783353, 33084.239057369567)
        word = reg.DAC_VALID | round(CURRENT_SCALE * amps + offsets[plug - 1])
        self.write(reg.axis_register(plug - 1, reg.DAC), word)
        self.wait(3)


def described(system: SystemConfig) -> Described:
    assert system.emulation is not None
    return system.emulation.setup_joints[0]


def with_arms(system: SystemConfig, *arms: EmulatedSetupArm) -> SystemConfig:
    """The same with other arms."""
    assert system.emulation is not None
    joints = dataclasses.replace(described(system), arms=arms)
    return dataclasses.replace(system, emulation=dataclasses.replace(system.emulation, setup_joints=(joints,)))
