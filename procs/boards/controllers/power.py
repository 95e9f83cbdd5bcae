"""Motor power, amplifiers, watchdog and current check of all boards of a bus.

Automatic events at a known tick (a watchdog fires, the supply is up, the hold-off ends, the relay closes, a current
check trips) are not polled: `until(tick)` processes them in order, each at its exact tick, before the state is read or
changed otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from trocar.procs.boards.controllers.currents import Currents
from trocar.procs.boards.controllers.digital import BRIDGES, Digital
from trocar.procs.boards.controllers.lines import NEVER, Flags, Ints, Quads
from trocar.procs.boards.controllers.models import Model, Traits
from trocar.procs.boards.controllers.status import StatusWords
from trocar.procs.fpga import registers as reg

MILLISECOND = reg.CLOCK_HZ // 1000
SUPPLY_RAMP = 20 * MILLISECOND  # motor supply good after power is switched on; 10 to 200 ms on real ones
WAKING = np.uint32(~(reg.CONTROL_POWER_OFF | reg.CONTROL_AMPS_OFF) & 0xFFFFFFFF)  # control bits beyond switching off
AMP_HOLD = 7680 * reg.WATCHDOG_TICKS  # output stages stay off for 40 ms after the supply is good
RELAY_TRAVEL = 5 * MILLISECOND  # to close; it falls off quicker: the original test looks after 1 ms
RELAY_FALL = MILLISECOND // 2
DIVIDER_PHASE = 129  # Rev 7 counts edges of a free-running clock divided by 256
DELAY_PHASE = 513  # the delay of a QLA with an expander, edges of one divided by 1024
DOUT_TEST_TICKS = 4098  # detection of the hardware behind the digital outputs
EXPANDER_TEST_TICKS = 80  # and whether there is an I/O expander: about two transfers to it
DELAY_POWER_UP = reg.MOTOR_CONFIG_POWER_UP >> reg.MOTOR_CONFIG_DELAY_SHIFT & 0xFF
_DELAY_STEPS = 256  # the counter of the delay has eight bits


def _none(_: Flags) -> None:
    pass


def _first_after(tick: int, times: Ints) -> int:
    return int(times[times > tick].min(initial=NEVER))


class BoardPower:
    """State of all boards; arrays (boards,) and (boards, width)."""

    def __init__(self, models: Sequence[Model], on: Flags) -> None:
        """Everything off as after power-up at tick 0; `on` (boards, width) is where the amplifier feedback is kept."""
        n, width = on.shape
        self.traits = traits = Traits.of(models, width)
        self.on = on
        self.on[...] = False
        self.wanted, self.relay, self.relay_feedback, self.supply_lost, self.watchdog = (
            np.zeros(n, dtype=np.bool_) for _ in range(5))
        self.chain_open = np.zeros(n, dtype=np.bool_)  # the safety chain: an emergency stop is pressed
        self.expander_known = traits.expander.copy()  # an I/O expander is there and has been found
        self.outputs_known = np.ones(n, dtype=np.bool_)  # the kind of the digital outputs' hardware has been found out
        self.watchdog_counts = np.full(n, reg.WATCHDOG_POWER_UP, dtype=np.int64)
        self.refreshed = np.zeros(n, dtype=np.int64)  # tick of the last register write
        self.watchdog_tick = np.full(n, -1, dtype=np.int64)  # when it last fired, -1: never
        self.cut_tick = np.full(n, -1, dtype=np.int64)  # when amplifiers last went off, -1: never
        self.enabled, self.safety, self.amp_fault = (np.zeros((n, width), dtype=np.bool_) for _ in range(3))
        self.mode: Quads = np.zeros((n, width), dtype=np.uint32)  # of control; set by `set_modes`
        self.delay = np.full((n, width), DELAY_POWER_UP, dtype=np.int64)  # of enables, where there is an expander
        self.digital = Digital(traits) if traits.digital.any() else None
        self.when_cut: Callable[[Flags], None] = _none  # notified of dRA1 amplifiers that went off
        self.status: Quads = np.zeros(n, dtype=np.uint32)
        self.motor_flags: Quads = np.zeros((n, width), dtype=np.uint32)  # motor status without the last command
        self.good = np.zeros(n, dtype=np.bool_)  # motor supply
        self.changes = 0  # counts changes of `status` and `motor_flags`
        self.next_event = 0  # no automatic event before this tick
        self._next_other = 0  # nothing but watchdogs
        self.currents = Currents(on.shape)
        self._words = StatusWords(traits)
        self._relay_at, self._good_at, self._outputs_at, self._expander_at = (
            np.full(n, NEVER, dtype=np.int64) for _ in range(4))
        self.awake = np.zeros((n, width), dtype=np.bool_)  # enabled, and the hold-off is over
        self._delayed_until = np.zeros((n, width), dtype=np.int64)
        self._old_any, self._delays = bool(traits.old.any()), bool(traits.expander.any())
        self._shifts = np.arange(width, dtype=np.uint32)
        self._event(0)

    # -- time ----------------------------------------------------------------------------------------------------------

    def until(self, tick: int) -> None:
        """Process all automatic events up to and including `tick`."""
        while self.next_event <= tick:
            self._event(self.next_event)

    def _event(self, tick: int) -> None:
        fire = self._watchdog_at()
        fired = fire <= tick
        if tick < self._next_other and self.digital is None and not fired.any():  # they were refreshed meanwhile
            self.next_event = min(self._next_other, int(fire.min()))
            return
        if fired.any():
            self.watchdog[fired] = True
            self.watchdog_tick[fired] = fire[fired]
        tripped = self.currents.trip_at <= tick
        if tripped.any():
            self.safety |= tripped
            self.currents.trip_at[tripped] = NEVER
        self.relay_feedback = np.where(self._relay_at <= tick, self.relay, self.relay_feedback)
        for at in (self._relay_at, self._outputs_at, self._expander_at):
            at[at <= tick] = NEVER
        if self.digital is not None:
            self.digital.until(tick)
        self._settle(tick)

    def _watchdog_at(self) -> Ints:
        live = ~self.watchdog & (self.watchdog_counts > 0)
        begin = self.refreshed + 1
        if self._old_any:
            begin = np.where(self.traits.old, self._next_edge(begin), begin)
        return np.where(live, begin + self.watchdog_counts * reg.WATCHDOG_TICKS, NEVER)

    def _next_edge(self, tick: Ints) -> Ints:
        """The first edge of Rev 7's divided clock at or after `tick`."""
        return tick + (DIVIDER_PHASE - tick) % reg.WATCHDOG_TICKS

    def _held_until(self) -> Ints:
        """Tick at which the hold-off of the output stages ends."""
        begin = self._good_at
        if self._old_any:
            begin = np.where(self.traits.old & (begin < NEVER), self._next_edge(begin), begin)
        return begin + AMP_HOLD

    def _settle(self, tick: int) -> None:
        """Process a change at `tick`: latches, output stages, status words, the next event."""
        traits, digital = self.traits, self.digital
        latched = self.safety | self.watchdog[:, None]
        self.enabled &= ~latched | traits.digital[:, None]
        np.less_equal(self._good_at, tick, out=self.good)
        held_until = self._held_until()
        awake = self.enabled & (held_until <= tick)[:, None]
        self.expander_known = traits.expander & (self._expander_at == NEVER)
        self.outputs_known = self._outputs_at == NEVER
        out = awake & ~self.amp_fault
        if self._delays:
            out &= self._delay(awake, tick)
        self.awake = awake
        if digital is not None:
            pins = digital.pins(self.on, self.enabled, self.amp_fault, np.array((~self.watchdog, self.good)), tick)
            out = np.where(digital.axes, pins, out)
            digital.regulate(pins, self.mode)
        gone = self.on & ~out
        self.cut_tick[gone.any(axis=1)] = tick
        self.on[...] = out
        if digital is not None and gone.any():
            self.when_cut(gone & digital.axes)
        self.status[:] = self._words.status(self)
        self.motor_flags[...] = self._words.motors(self, awake & ~out)
        self.changes += 1
        self._look_ahead(tick, held_until)

    def _look_ahead(self, tick: int, held_until: Ints) -> None:
        ahead = [self._good_at, held_until, self._relay_at, self._outputs_at, self._expander_at,
                 self.currents.trip_at.ravel()]
        if self._delays:
            ahead.append(self._delayed_until.ravel())
        if self.digital is not None:
            ahead.append(self.digital.times())
        self._next_other = _first_after(tick, np.concatenate(ahead))
        # A past watchdog time means that the board was just refreshed or latched; never step back.
        self.next_event = min(self._next_other, _first_after(tick, self._watchdog_at()))

    def _delay(self, awake: Flags, tick: int) -> Flags:
        """Whether the enable delay of each axis (QLA with an expander) is over."""
        rising = awake & ~self.awake & self.traits.expander[:, None]
        if rising.any():
            self._delayed_until[rising] = self._after(tick, self.delay)[rising]
        return (self._delayed_until <= tick) | ~self.expander_known[:, None]

    def _after(self, tick: int, counts: Ints) -> Ints:
        """Tick after this many edges of the delay's clock."""
        last = tick - (tick - DELAY_PHASE) % reg.MOTOR_CONFIG_DELAY_TICKS
        return np.where(counts > 0, last + counts * reg.MOTOR_CONFIG_DELAY_TICKS, tick)

    # -- host accesses (call `until` first) ----------------------------------------------------------------------------

    def refresh(self, row: int, tick: int) -> None:
        """A register of board `row` is written: restarts its watchdog."""
        self.refreshed[row] = tick

    def refresh_all(self, tick: int) -> None:
        """A register of every board is written."""
        self.refreshed.fill(tick)

    def set_watchdog(self, row: int, counts: int, tick: int) -> None:
        """Write the period register; 0 switches the watchdog off."""
        if self.watchdog_counts[row] == counts & 0xFFFF:
            return  # some hosts write it every cycle
        self.watchdog_counts[row] = counts & 0xFFFF
        self._settle(tick)

    def enable(self, mask: Flags, value: Flags, tick: int, written: Flags | None = None) -> None:
        """Enables in motor command words; `written`: the axes whose word it is, default: all.

        A word without the mask bit keeps an enable, unless power or a latch forbids it. Rev 7 has no enables there.
        """
        self._ask(mask & value, tick)
        latched = (self.safety | self.watchdog[:, None]) & ~self.traits.digital[:, None]
        enabled = np.where(mask, value, self.enabled) & ~latched & self.wanted[:, None]
        if self._old_any:
            written = np.broadcast_to(~self.traits.old[:, None], mask.shape) & (True if written is None else written)
        self.enabled = enabled if written is None else np.where(written, enabled, self.enabled)
        self._settle(tick)

    def _ask(self, axes: Flags, tick: int) -> None:
        """An enabling command first clears earlier trips, before the enable is evaluated."""
        self.watchdog &= ~axes.any(axis=1)
        self.safety &= ~axes
        if self.digital is not None:
            self.digital.ask(axes)
        if axes.any():
            self.currents.arm(tick)

    def heeds(self, words: Quads) -> bool:
        """Whether control words would change anything: an idle host's switching off of disabled outputs does not."""
        if not np.count_nonzero(words):  # a tenth of the price of `any`
            return False
        return bool((words & WAKING).any() or self.wanted.any() or self.enabled.any())

    def control(self, words: Quads, tick: int, executed: Flags | None = None) -> None:
        """Control words (boards,); `executed` are the boards that were sent one, those with one not 0 if left out."""
        before = self.wanted
        self._switch_power((words & reg.CONTROL_POWER_MASK) != 0, (words >> 18 & 1) != 0, tick)
        relay = np.where((words & reg.CONTROL_RELAY_MASK) != 0, (words >> 16 & 1) != 0, self.relay)
        self._relay_at = np.where(relay != self.relay, tick + np.where(relay, RELAY_TRAVEL, RELAY_FALL), self._relay_at)
        self.relay = relay
        self._outputs_at[(words & reg.CONTROL_DOUT_TEST != 0) & ~self.traits.digital] = tick + DOUT_TEST_TICKS
        self._expander_at[(words & reg.CONTROL_EXPANDER_TEST != 0) & self.traits.expander] = tick + EXPANDER_TEST_TICKS
        bits = np.asarray(words)[:, None] >> self._shifts
        mask = ((bits >> 8 & 1) != 0) & self.traits.by_control
        value = (bits & 1) != 0
        self._ask(mask & value, tick)
        # Rev 7 looks at power as it was before this very word.
        allowed = np.where(self.traits.old, before, self.wanted)[:, None] & ~(self.safety | self.watchdog[:, None])
        followed = (words != 0 if executed is None else executed)[:, None] & self.traits.by_control
        self.enabled = np.where(followed, np.where(mask, value, self.enabled) & allowed, self.enabled)
        self._settle(tick)

    def _switch_power(self, mask: Flags, value: Flags, tick: int) -> None:
        asked = mask & value
        self.watchdog &= ~asked
        self.safety[asked] = False
        if asked.any():
            self.currents.arm(tick)
            if self.digital is not None:
                self.digital.forgive(np.broadcast_to(asked[:, None], self.on.shape))
        self._good_at[asked & ~self.wanted & ~self.supply_lost & ~self.chain_open] = tick + SUPPLY_RAMP
        self._good_at[mask & ~value] = NEVER
        self.wanted = np.where(mask, value, self.wanted)

    def set_modes(self, mode: Quads, tick: int) -> None:
        """How each motor is controlled from now on."""
        self.mode = mode.copy()
        self._settle(tick)

    def set_delay(self, row: int, axis: int, counts: int, tick: int) -> None:
        """Change the delay of an enable: the counter continues up to the new value, wrapping around if necessary."""
        until, step = int(self._delayed_until[row, axis]), reg.MOTOR_CONFIG_DELAY_TICKS
        counted = int(self.delay[row, axis]) - max(-((tick - until) // step), 0)
        self.delay[row, axis] = counts
        if self.awake[row, axis] and self.expander_known[row]:
            left = np.array((counts - counted) % _DELAY_STEPS)
            self._delayed_until[row, axis] = self._after(tick, left)
        self._settle(tick)

    def preload(self, row: int, tick: int) -> None:
        """Encoders of a board are preloaded."""
        if self.digital is not None and self.digital.there[row]:
            self.digital.preload(row, tick)
            self._settle(tick)

    def bypass_interlocks(self, row: int, mask: int, tick: int) -> None:
        """Exempt the amplifiers of a dRA1 from some of their interlocks."""
        if self.digital is not None:
            self.digital.bypass[row] = mask & 0x1F
            self._settle(tick)

    def supply_espm(self, row: int, on: bool, tick: int) -> None:
        """Switch the supply of the electronics in the arm of a dRA1."""
        if self.digital is not None:
            self.digital.supply(row, on, tick)
            self._settle(tick)

    def power_up(self, row: int, tick: int) -> None:
        """Board `row` starts again as after power-up (its FPGA was reconfigured)."""
        for flags in (self.wanted, self.relay, self.watchdog, self.enabled, self.safety):
            flags[row] = False
        self.mode[row] = reg.MODE_CURRENT
        self.delay[row] = DELAY_POWER_UP
        self._relay_at[row] = tick + RELAY_FALL
        self._outputs_at[row] = self._expander_at[row] = self._good_at[row] = NEVER
        self.currents.forget(row)
        if self.digital is not None:
            self.digital.power_up(row)
        self.watchdog_counts[row] = reg.WATCHDOG_POWER_UP
        self.refreshed[row] = tick
        self._settle(tick)

    def cut(self, row: int, tick: int) -> None:
        """Board `row` is without power: everything is off."""
        self.wanted[row] = self.relay[row] = False
        self.enabled[row] = False
        self._relay_at[row] = tick + RELAY_FALL
        self._good_at[row] = NEVER
        self._settle(tick)

    # -- board events --------------------------------------------------------------------------------------------------

    def lose_supply(self, row: int, lost: bool, tick: int) -> None:
        """Remove the motor supply of a board, or restore it."""
        self.supply_lost[row] = lost
        self._feed(row, tick)

    def open_chain(self, row: int, opened: bool, tick: int) -> None:
        """Open the safety chain of a board, or close it: motor supply and relay feedback follow it."""
        self.chain_open[row] = opened
        self._feed(row, tick)

    def _feed(self, row: int, tick: int) -> None:
        """The motor supply of a board fails, or ramps up again, as its conditions allow."""
        if not self.wanted[row] or self.supply_lost[row] or self.chain_open[row]:
            self._good_at[row] = NEVER
        elif self._good_at[row] == NEVER:
            self._good_at[row] = tick + SUPPLY_RAMP
        self._settle(tick)

    def fail_amplifier(self, row: int, axis: int, failed: bool, tick: int) -> None:
        """Make an amplifier fail: it goes off and reports it, its enable stays. Two of a dRA1 share a fault line."""
        shared = next((pair for pair in BRIDGES if axis in pair), (axis,)) if self.traits.digital[row] else (axis,)
        self.amp_fault[row, list(shared)] = failed
        self._settle(tick)

    def check_currents(self, tick: int, asked: Ints, measured: Ints, unchecked: Flags,
                       limits: Ints | None = None) -> None:
        """Compare measured with commanded currents (offset binary, (boards, width)) that hold from `tick` on.

        `unchecked` axes are skipped, except those in voltage mode, which have `limits`; the others' are -1.
        """
        traits, digital = self.traits, self.digital
        if digital is not None:
            if digital.compare(tick, asked, measured):
                self._settle(tick)
            unchecked = unchecked | traits.digital[:, None]
        if self.currents.compare(tick, asked, measured, unchecked, limits):
            self.currents.trip_at[self.safety] = NEVER
            self._next_other = min(self._next_other, int(self.currents.trip_at.min()))
            self.next_event = min(self.next_event, self._next_other)
