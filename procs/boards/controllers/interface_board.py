"""The interface board of Classic setup joints: it lets one board read 64 voltages, and drives the lift.

A counter selects which of the 16 voltages of each passive arm appears at its analog input. It is cleared while the
reset output is low, counts when the increment output rises, and shows its four bits on line A of the encoders. Lines B
are low: the lift's amplifier has no fault. That amplifier is driven by a PWM output, whose middle is rest, while its
disable output is low.
"""

from __future__ import annotations

from typing import Final

from trocar.procs.boards.controllers.lines import NEVER, Quads
from trocar.procs.boards.controllers.quadrature import Quadrature
from trocar.procs.boards.devices.outputs import MAX_CHANGES, BoardOutputs
from trocar.procs.document.emulated import EmulatedSetupJoints
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

CHANNELS: Final = 16
FEW_CHANGES: Final = 128  # recorded between two looks at outputs that keep switching, which no host configures
_FAITHFUL: Final = Quirks()


class EmulatedInterfaceBoard:
    """On the board that owns `outputs`. `before_write` must be called before each write to them, with its tick."""

    def __init__(self, described: EmulatedSetupJoints, outputs: BoardOutputs, quirks: Quirks = _FAITHFUL) -> None:
        """As after power-up of both boards at tick 0."""
        self.axes = described.axes
        self._reset, self._increment = 1 << described.reset, 1 << described.increment
        self._pwm, self._disable = described.pwm, 1 << described.disable
        self._of = self._reset | self._increment | self._disable
        self._quirks = quirks
        self.channel = 0
        self.driven = 0.0  # ticks for which the lift was driven, full power up counting 1, full power down -1
        shown = sum(1 << axis for axis in self.axes if axis < reg.AXES)  # no other axis is in the digital inputs
        self._others = ~(shown << reg.INPUT_ENCODER_A_SHIFT | shown << reg.INPUT_ENCODER_B_SHIFT)
        self._levels = outputs.levels(0) & self._of
        self._start(outputs, 0)

    def _start(self, outputs: BoardOutputs, tick: int) -> None:
        self._outputs, self._at = outputs, tick
        self._power = 0.0
        self._settled = 0  # from this tick on the counter's outputs rest
        self._is_written = True
        self._lines = tuple(Quadrature(tick, self.channel >> k & 1, 0, quirks=self._quirks) for k in range(reg.AXES))

    def power_up(self, outputs: BoardOutputs, tick: int) -> None:
        """The FPGA is reconfigured and has new outputs; the counter keeps its value."""
        self.until(tick)
        self._start(outputs, tick)

    def before_write(self, tick: int) -> None:
        """Something that may be an output is about to be written."""
        self.until(tick)
        self._is_written = True

    def until(self, tick: int) -> None:
        """Process the changes of the outputs up to `tick`."""
        if self._is_written or self._settled > self._at:
            self._follow(tick)
        self._go_on(tick)

    def _follow(self, tick: int) -> None:
        self._settled = self._outputs.settled(self._of)
        limit = MAX_CHANGES if self._settled < NEVER else FEW_CHANGES
        changes = self._outputs.changes(self._at, tick, limit, of=self._of)
        if self._is_written or changes.levels != self._levels:
            self._see(changes.levels)
        for at, levels in changes.items:
            self._go_on(at)
            self._see(levels)
        self._is_written = False

    def _go_on(self, tick: int) -> None:
        """Nothing happens until `tick`."""
        if self._power:
            self.driven += self._power * (tick - self._at)
        self._at = tick

    def _see(self, levels: int) -> None:
        """The outputs have these levels from now on, in register polarity: 1 is a low pin."""
        rises = self._levels & ~levels & self._increment
        self._levels = levels
        self._power = 0.0 if not levels & self._disable else self._lift_power()
        channel = 0 if levels & self._reset else (self.channel + bool(rises)) % CHANNELS
        if channel != self.channel:
            self.channel = channel
            for k, line in enumerate(self._lines):
                line.change(self._at, channel >> k & 1, 0)

    def _lift_power(self) -> float:
        """-1 to 1 by the duty of the PWM output."""
        control = self._outputs.control(self._pwm)
        high, low = control & 0xFFFF, control >> 16  # counts of the pin's levels, the inverse of the register's
        if high and low:
            return (high - low) / (high + low + 4)  # each lasts two ticks longer
        if high == low:
            return -1.0 if self._outputs.levels(self._at) >> self._pwm & 1 else 1.0
        return 1.0 if low else -1.0  # it turns to the level that has no count, and stays

    def preload(self, axis: int, value: int, tick: int) -> None:
        """The preload register of an axis is written."""
        if axis in self.axes:
            self.until(tick)
            line = self._lines[self.axes.index(axis)]
            line.observe(tick)
            line.load(0, value & reg.ENCODER_MASK)

    def fill(self, tick: int, inputs: int, positions: Quads, velocities: Quads) -> int:
        """Put its axes' words at `tick` into `positions` (width,) and `velocities` (4, width); the digital inputs."""
        self.until(tick)
        shown = 0
        for k, (axis, line) in enumerate(zip(self.axes, self._lines, strict=True)):
            line.observe(tick)
            positions[axis] = line.position()
            velocities[:, axis] = line.velocity(tick)
            if axis < reg.AXES:
                shown |= (self.channel >> k & 1) << reg.INPUT_ENCODER_A_SHIFT + axis
        return inputs & self._others | shown
