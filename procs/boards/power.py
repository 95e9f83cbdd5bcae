"""Motor power, amplifiers, watchdog and current check of all boards of a bus.

What happens by itself at a known tick (a watchdog fires, the supply is up, the hold-off ends, the relay closes, a
current check trips) is not polled for: `until(tick)` plays these moments in order, each at its exact tick, before
anything else looks at or changes the state.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procs.lib import registers as reg

Flags = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]
Quads = npt.NDArray[np.uint32]

NEVER = 1 << 62
MILLISECOND = reg.CLOCK_HZ // 1000
SUPPLY_RAMP = 20 * MILLISECOND  # motor supply good after power is switched on; 10 to 200 ms on real ones
WAKING = np.uint32(~(reg.CONTROL_POWER_OFF | reg.CONTROL_AMPS_OFF) & 0xFFFFFFFF)  # control bits beyond switching off
AMP_HOLD = 7680 * reg.WATCHDOG_TICKS  # output stages stay off for 40 ms after the supply is good
RELAY_TRAVEL = 5 * MILLISECOND  # to close; it falls off quicker: the original test looks after 1 ms
RELAY_FALL = MILLISECOND // 2
CURRENT_TRIP = 2_457_600  # 50 ms of too much current
CURRENT_SMALL = 0x300  # below this from zero nothing is compared
CURRENT_EXCESS = 0x0900
CURRENT_NEAR_FULL = 0xF6FF


class Power:
    """State of `boards` boards with four axes each; arrays (boards,) and (boards, 4)."""

    def __init__(self, ids: npt.ArrayLike, on: Flags) -> None:
        """Everything off as after power-up at tick 0; `on` (boards, 4) is where the amplifier feedback is kept."""
        self.ids = np.asarray(ids, dtype=np.int64)
        n, width = on.shape
        self.on = on
        self.on[...] = False
        self.wanted = np.zeros(n, dtype=np.bool_)
        self.relay = np.zeros(n, dtype=np.bool_)
        self.relay_feedback = np.zeros(n, dtype=np.bool_)
        self.supply_lost = np.zeros(n, dtype=np.bool_)
        self.chain_open = np.zeros(n, dtype=np.bool_)  # the safety chain: an emergency stop is pressed
        self.watchdog = np.zeros(n, dtype=np.bool_)
        self.watchdog_counts = np.full(n, reg.WATCHDOG_POWER_UP, dtype=np.int64)
        self.refreshed = np.zeros(n, dtype=np.int64)  # tick of the last register write
        self.watchdog_tick = np.full(n, -1, dtype=np.int64)  # when it last fired, -1: never
        self.cut_tick = np.full(n, -1, dtype=np.int64)  # when amplifiers last went off, -1: never
        self.enabled = np.zeros((n, width), dtype=np.bool_)
        self.safety = np.zeros((n, width), dtype=np.bool_)
        self.amp_fault = np.zeros((n, width), dtype=np.bool_)
        self.status: Quads = np.zeros(n, dtype=np.uint32)
        self.motor_flags: Quads = np.zeros((n, width), dtype=np.uint32)  # motor status without the last command
        self.changes = 0  # counts changes of `status` and `motor_flags`
        self.next_event = 0  # nothing happens by itself before this tick
        self._relay_at = np.full(n, NEVER, dtype=np.int64)
        self._good_at = np.full(n, NEVER, dtype=np.int64)
        self._over_since = np.full((n, width), NEVER, dtype=np.int64)
        self._trip_at = np.full((n, width), NEVER, dtype=np.int64)
        self._bits = 1 << np.arange(width, dtype=np.int64)
        self._shifts = np.arange(width, dtype=np.uint32)
        self._event(0)

    # -- time ----------------------------------------------------------------------------------------------------------

    def until(self, tick: int) -> None:
        """Let everything happen that happens by itself up to and including `tick`."""
        while self.next_event <= tick:
            self._event(self.next_event)

    def _event(self, tick: int) -> None:
        fire = self._watchdog_at()
        fired = fire <= tick
        if fired.any():
            self.watchdog[fired] = True
            self.watchdog_tick[fired] = fire[fired]
        tripped = self._trip_at <= tick
        if tripped.any():
            self.safety |= tripped
            self._trip_at[tripped] = NEVER
        self.relay_feedback = np.where(self._relay_at <= tick, self.relay, self.relay_feedback)
        self._relay_at[self._relay_at <= tick] = NEVER
        self._settle(tick)

    def _watchdog_at(self) -> Ints:
        live = ~self.watchdog & (self.watchdog_counts > 0)
        return np.where(live, self.refreshed + self.watchdog_counts * reg.WATCHDOG_TICKS + 1, NEVER)

    def _settle(self, tick: int) -> None:
        """Follow what changed at `tick`: latches, output stages, status words, the next event."""
        self.enabled &= ~(self.safety | self.watchdog[:, None])
        good = self._good_at <= tick
        out = self.enabled & ~self.amp_fault & (self._good_at + AMP_HOLD <= tick)[:, None]
        cut = (self.on & ~out).any(axis=1)
        self.cut_tick[cut] = tick
        self.on[...] = out
        self._show(good)
        ahead = np.concatenate((self._watchdog_at(), self._good_at, self._good_at + AMP_HOLD, self._relay_at,
                                self._trip_at.ravel()))
        # A watchdog time in the past belongs to a board that was just refreshed or latched; never step back.
        self.next_event = int(min(NEVER, ahead[ahead > tick].min(initial=NEVER)))

    def _show(self, good: Flags) -> None:
        feedback = (self.on * self._bits).sum(axis=1)
        status = (reg.AXES << reg.STATUS_AXES_SHIFT) | (self.ids << reg.STATUS_BOARD_SHIFT)
        status |= reg.STATUS_DOUT_CONFIGURED | reg.STATUS_DOUT_BIDIRECTIONAL
        closed = self.relay_feedback & ~self.chain_open
        for flag, bit in ((self.watchdog, reg.STATUS_WATCHDOG), (good, reg.STATUS_MV_GOOD),
                          (self.wanted, reg.STATUS_POWER), (closed, reg.STATUS_RELAY_FEEDBACK),
                          (self.relay, reg.STATUS_RELAY), (self.supply_lost, reg.STATUS_MV_FAULT)):
            status |= flag * bit
        status |= feedback << reg.STATUS_AMP_ON_SHIFT
        status |= (self.safety * self._bits).sum(axis=1) << reg.STATUS_SAFETY_SHIFT
        self.status[:] = status | feedback << reg.STATUS_AMP_LOW_SHIFT  # Rev 7 has the requests in the low bits
        self.motor_flags[...] = (reg.MOTOR_STATUS_CURRENT_CONTROL
                                 | self.on * reg.MOTOR_STATUS_AMP_ON | self.enabled * reg.MOTOR_STATUS_AMP_REQUESTED
                                 | self.safety * reg.MOTOR_STATUS_SAFETY
                                 | (self.enabled & ~self.on) * reg.MOTOR_STATUS_AMP_FAULT)
        self.changes += 1

    # -- what the host does (call `until` first) -----------------------------------------------------------------------

    def refresh(self, row: int, tick: int) -> None:
        """A register of board `row` is written: its watchdog starts anew."""
        self.refreshed[row] = tick

    def refresh_all(self, tick: int) -> None:
        """A register of every board is written."""
        self.refreshed.fill(tick)

    def set_watchdog(self, row: int, counts: int, tick: int) -> None:
        """Write the period register; 0 switches the watchdog off."""
        self.watchdog_counts[row] = counts & 0xFFFF
        self._settle(tick)

    def enable(self, mask: Flags, value: Flags, tick: int) -> None:
        """Amplifier enables in motor command words; arrays (boards, 4)."""
        self._enable(mask, value)
        self._settle(tick)

    def _enable(self, mask: Flags, value: Flags) -> None:
        ask = mask & value
        # The enabling command itself clears what had tripped, before the enable is judged.
        self.watchdog &= ~ask.any(axis=1)
        self.safety &= ~ask
        self.enabled = np.where(mask, value, self.enabled)
        self.enabled &= ~(self.safety | self.watchdog[:, None]) & self.wanted[:, None]

    def heeds(self, words: Quads) -> bool:
        """Whether control words would change anything: switching off what is off, as an idle host does, does not."""
        if not words.any():
            return False
        return bool((words & WAKING).any() or self.wanted.any() or self.enabled.any())

    def control(self, words: Quads, tick: int) -> None:
        """Control words (boards,), 0 for a board that is not addressed; bits 19:0 only."""
        self._switch_power((words & reg.CONTROL_POWER_MASK) != 0, (words >> 18 & 1) != 0, tick)
        relay = np.where((words & reg.CONTROL_RELAY_MASK) != 0, (words >> 16 & 1) != 0, self.relay)
        self._relay_at = np.where(relay != self.relay, tick + np.where(relay, RELAY_TRAVEL, RELAY_FALL), self._relay_at)
        self.relay = relay
        bits = np.asarray(words)[:, None] >> self._shifts
        first = self._shifts < reg.AXES  # no hardware has more of them in its control word
        self._enable(((bits >> 8 & 1) != 0) & first, (bits & 1) != 0)
        self._settle(tick)

    def _switch_power(self, mask: Flags, value: Flags, tick: int) -> None:
        asked = mask & value
        self.watchdog &= ~asked
        self.safety[asked] = False
        self._good_at[asked & ~self.wanted & ~self.supply_lost & ~self.chain_open] = tick + SUPPLY_RAMP
        self._good_at[mask & ~value] = NEVER
        self.wanted = np.where(mask, value, self.wanted)

    def power_up(self, row: int, tick: int) -> None:
        """Board `row` starts again as after power-up (its FPGA was reconfigured)."""
        for flags in (self.wanted, self.relay, self.watchdog, self.enabled, self.safety):
            flags[row] = False
        self._relay_at[row] = tick + RELAY_TRAVEL
        self._good_at[row] = NEVER
        self._over_since[row] = self._trip_at[row] = NEVER
        self.watchdog_counts[row] = reg.WATCHDOG_POWER_UP
        self.refreshed[row] = tick
        self._settle(tick)

    def cut(self, row: int, tick: int) -> None:
        """Board `row` is without power: nothing is on."""
        self.wanted[row] = self.relay[row] = False
        self.enabled[row] = False
        self._relay_at[row] = tick + RELAY_TRAVEL
        self._good_at[row] = NEVER
        self._settle(tick)

    # -- what happens to the boards ------------------------------------------------------------------------------------

    def lose_supply(self, row: int, lost: bool, tick: int) -> None:
        """Take the motor supply of a board away, or give it back."""
        self.supply_lost[row] = lost
        self._feed(row, tick)

    def open_chain(self, row: int, opened: bool, tick: int) -> None:
        """Open the safety chain of a board, or close it: motor supply and relay feedback come and go with it."""
        self.chain_open[row] = opened
        self._feed(row, tick)

    def _feed(self, row: int, tick: int) -> None:
        """The motor supply of a board goes, or ramps up again, with what stands in its way."""
        if not self.wanted[row] or self.supply_lost[row] or self.chain_open[row]:
            self._good_at[row] = NEVER
        elif self._good_at[row] == NEVER:
            self._good_at[row] = tick + SUPPLY_RAMP
        self._settle(tick)

    def fail_amplifier(self, row: int, axis: int, failed: bool, tick: int) -> None:
        """Make an amplifier fail: it goes off and says so, its enable stays."""
        self.amp_fault[row, axis] = failed
        self._settle(tick)

    def check_currents(self, tick: int, asked: Ints, measured: Ints, unchecked: Flags) -> None:
        """Compare measured with commanded currents (offset binary, (boards, 4)) that hold from `tick` on."""
        mirrored = np.maximum(asked, 0xFFFF - asked)
        over = np.maximum(measured, 0xFFFF - measured) > mirrored + CURRENT_EXCESS
        if not over.any():
            if self._over_since[0, 0] != NEVER or (self._over_since != NEVER).any():
                self._over_since.fill(NEVER)
                self._trip_at.fill(NEVER)
            return
        over &= np.abs(measured - reg.CURRENT_ZERO) >= CURRENT_SMALL
        over &= (mirrored < CURRENT_NEAR_FULL) & ~unchecked
        self._over_since = np.where(over, np.minimum(self._over_since, tick), NEVER)
        due = np.maximum(self._over_since + CURRENT_TRIP, tick + 1)
        self._trip_at = np.where(over & ~self.safety, due, NEVER)
        self.next_event = min(self.next_event, int(self._trip_at.min()))
