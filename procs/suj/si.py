"""Si setup joints: small boards read the potentiometers and send them over Bluetooth; the carried arms' io drives the
brakes.

Each setup arm has a board for all its joints but the first; the first joints of all arms share the board of the base.
In carts of 2026 the controllers of the carried arms read all joints, with 12 bits. A reading is JSON:
`{"timestamp": ms of the board, "pots": [[first potentiometers], [second ones]]}`, in counts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import Cart
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.inputs import Fields
from trocar.procs.suj.buttons import CLUTCH_COMMAND_NS, Flags, SetupButtons
from trocar.procs.suj.machine import SetupState
from trocar.procs.suj.pots import SI_LIMITS, Potentiometers, PotReadings
from trocar.procs.suj.setups import Setups
from trocar.procs.tables import codes
from trocar.shm.system.events import Events

STALE_NS: Final = 5_000_000_000  # boards are read several times a second, and a connection takes seconds
MISSING: Final = -1.0  # count of a potentiometer that the controller of an arm cannot read
MAX_COUNT: Final = 4095.0
SETTLED: Final = 2  # readings after a release: the first may be from before
BRAKE_REPEAT_NS: Final = 10_000_000  # io engages the brakes 30 ms after the last command
MAX_POTS: Final = 8


class PotLink(Protocol):
    """Potentiometer boards."""

    def poll(self, now_ns: int) -> Iterable[tuple[str, bytes]]:
        """(address of a board, its reading), in the order received since the last call."""

    def problem(self, address: str) -> str:
        """Why a board sends no readings, for the operator; "": it does."""

    def close(self) -> None:
        """Close all connections."""


def counts(reading: bytes) -> Array:
    """The counts (2, pots) of a reading; ValueError for a malformed one."""
    try:
        pots = json.loads(reading)["pots"]
        first, second = ([float(value) for value in row] for row in pots)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"not a reading of a potentiometer board: {type(error).__name__}") from None
    if not 0 < len(first) == len(second) <= MAX_POTS or not all(map(math.isfinite, first + second)):
        raise ValueError("not a reading of a potentiometer board: two rows of as many numbers are")
    return np.array((first, second))


class Si:
    """The work of an Si cart in each cycle."""

    def __init__(self, cart: Cart, setups: Setups, link: PotLink, reports: Events, field: Fields,
                 hands: Callable[[int], tuple[Flags, Flags]], let_go: Callable[[int, bool], None]) -> None:
        """`field` gives the record's arrays; `hands(now)` returns for each arm whether a clutch button is pressed, and
        whether its brakes have power.

        `let_go(place, on)` commands io to release the brakes of an arm, which also follow its buttons directly.
        """
        n = len(cart.arms)
        self._name, self._arms, self._base, self._setups, self._link = (
            cart.name, cart.arms, cart.base_board.upper(), setups, link)
        self._is_by_arm = cart.by_arm
        self._reports, self._hands, self.buttons = reports, hands, SetupButtons(cart.arms, reports)
        self._let_go, self._asked_ns = let_go, [0] * n
        self._readings = PotReadings(setups, SI_LIMITS, reports)
        self._place = {arm.board.upper(): place for place, arm in enumerate(cart.arms)}
        self._of_base: Array | None = None
        self._base_ns = self._begun_ns = 0
        self._stamps_ns = [0] * n
        self._settled = [0] * n
        self._reported = [""] * n
        self._primary, self._secondary = field("primary_voltage"), field("secondary_voltage")
        self._rounds = field("rounds")

    def clutch(self, place: int, on: bool, now_ns: int) -> None:
        """Release the brakes of an arm for a minute, or engage them."""
        self.buttons.command(place, now_ns + CLUTCH_COMMAND_NS if on else 0)
        if not on:
            self._let_go(place, False)

    def step(self, now_ns: int, state: SetupState) -> None:
        """One cycle: buttons and readings."""
        self._begun_ns = self._begun_ns or now_ns
        self._clutch(now_ns, state is SetupState.ENABLED)
        for address, reading in self._link.poll(now_ns):
            try:
                values = counts(reading)
            except ValueError as error:
                self._reports.report(codes.SETUP_BOARD, f"{self._name}: {address}: {error}", self._name)
                continue
            if address.upper() == self._base:
                self._of_base, self._base_ns = values, now_ns
            elif address.upper() in self._place:
                self._read(self._place[address.upper()], values, now_ns)
        self._base_ns = now_ns if self._is_by_arm else self._base_ns
        for place in range(len(self._arms)):
            if now_ns - max(self._begun_ns, min(self._stamps_ns[place], self._base_ns)) > STALE_NS:
                self._miss(place)

    def _clutch(self, now_ns: int, enabled: bool) -> None:
        pressed, powered = self._hands(now_ns)
        self.buttons.step(pressed, powered & enabled, now_ns)
        self._setups.clutch(self.buttons.held, self._reports)
        for place in np.flatnonzero(self.buttons.held).tolist():
            self._settled[place] = 0
            self._setups.lose(place, moved=True)
            if self.buttons.by_command[place] and now_ns - self._asked_ns[place] >= BRAKE_REPEAT_NS:
                self._asked_ns[place] = now_ns
                self._let_go(place, True)

    def _read(self, place: int, values: Array, now_ns: int) -> None:
        arm, base, others = self._arms[place], self._of_base, int(not self._is_by_arm)
        if not self._is_by_arm:
            if base is None or base.shape[1] <= arm.base_pot or now_ns - self._base_ns > STALE_NS:
                return  # its first joint is not known
            values = np.column_stack((base[:, arm.base_pot], values))
        if values.shape[1] < arm.joints:
            text = (f"{arm.name}: its board has {values.shape[1] - others} potentiometers, {arm.joints - others} are "
                    "expected")
            self._report(place, text)
            return
        readings = values[:, : arm.joints]
        self._stamps_ns[place] = now_ns
        self._rounds += np.uint64(1)
        self._primary[place, : arm.joints], self._secondary[place, : arm.joints] = readings
        missing = np.flatnonzero((readings == MISSING).any(axis=0) & self._is_by_arm) + 1
        self._report(place, f"{arm.name}: no reading of joint {', '.join(map(str, missing))}" if missing.size else "")
        if missing.size:
            self._setups.lose(place, moved=False)
            return
        self._settled[place] += not self.buttons.held[place]
        if self._settled[place] < SETTLED:
            return
        self._readings.take(place, readings[0], readings[1])

    def _miss(self, place: int) -> None:
        """No reading for too long."""
        self._setups.lose(place, moved=False)
        arm = self._arms[place]
        boards = [("base", self._base, self._base_ns), (arm.name, arm.board.upper(), self._stamps_ns[place])]
        reasons = [f"{who}: {self._link.problem(address) or 'no readings received'}"
                   for who, address, stamp in boards[self._is_by_arm:] if not stamp or self._link.problem(address)]
        self._report(place, f"{arm.name}: its pose is not known ({'; '.join(reasons) or 'its board is silent'})")

    def _report(self, place: int, text: str) -> None:
        """Report every new problem once, and its end."""
        if text == self._reported[place]:
            return
        if text:
            self._reports.report(codes.SETUP_BOARD, text, self._arms[place].name)
        elif self._reported[place]:
            self._reports.status(f"{self._arms[place].name}: its potentiometer board answers", self._arms[place].name)
        self._reported[place] = text


class EmulatedBoards:
    """Emulated boards: every setup arm is at the position in the file (`simulated_position`), or has all joints 0.

    `turn` moves one, like an operator.
    """

    PERIOD_NS: Final = 100_000_000

    def __init__(self, cart: Cart) -> None:
        self._cart = cart
        self._pots = [Potentiometers(arm, SI_LIMITS) for arm in cart.arms]
        self._joints = [np.array(arm.position or (0.0,) * arm.joints) for arm in cart.arms]
        self._next_ns = 0

    def turn(self, place: int, joints: Array) -> None:
        """Set the joints of an arm."""
        self._joints[place] = np.array(joints, dtype=np.float64)

    def poll(self, now_ns: int) -> list[tuple[str, bytes]]:
        """The base's board and all others, ten times a second."""
        if now_ns < self._next_ns:
            return []
        self._next_ns = now_ns + self.PERIOD_NS
        read = [np.stack(pots.volts(joints)) for pots, joints in zip(self._pots, self._joints, strict=True)]
        if self._cart.by_arm:
            return [(arm.board, _reading(now_ns, np.clip(np.round(values), 0.0, MAX_COUNT)))
                    for arm, values in zip(self._cart.arms, read, strict=True)]
        base = np.zeros((2, 4))
        for arm, values in zip(self._cart.arms, read, strict=True):
            base[:, arm.base_pot] = values[:, 0]
        found = [(self._cart.base_board, _reading(now_ns, base))]
        return found + [(arm.board, _reading(now_ns, values[:, 1:]))
                        for arm, values in zip(self._cart.arms, read, strict=True)]

    def problem(self, address: str) -> str:
        """Never a problem."""
        return ""

    def close(self) -> None:
        """No connection to close."""


class UnreadPots:
    """Potentiometers that firmware Rev 10 reads: where it shows them is not public, so they are not read here."""

    def poll(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Nothing."""
        return []

    def problem(self, address: str) -> str:
        """The same for each arm."""
        return "firmware Rev 10 reads its potentiometers, and where it shows them is not known"

    def close(self) -> None:
        """No connection to close."""


def _reading(now_ns: int, values: NDArray[Any]) -> bytes:
    return json.dumps({"timestamp": now_ns // 1_000_000, "pots": values.tolist()}).encode()
