"""Classic setup joints: passive arms whose joints have two potentiometers each, brakes, and one of them a lift.

They move only by hand, and only while a current holds their brakes off. A host sees them through the interface board:
six primary potentiometers of every arm, six secondary ones, and four other voltages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.boards.controllers.interface_board import CHANNELS, EmulatedInterfaceBoard
from trocar.procs.boards.controllers.lines import Flags, Floats
from trocar.procs.boards.wiring import BRAKE_HOLDS_OFF, BRAKE_LETS_GO, Wiring
from trocar.procs.document.emulated import EmulatedSetupArm, Linear
from trocar.procs.document.emulated import EmulatedSetupJoints as Described
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga import registers as reg

JOINTS: Final = 6
PLUGS: Final = 4
POT_V: Final = 4.5  # across the potentiometers
LIFT_M_S: Final = 0.1  # at full power; the original software uses a fifth
SUPPLY_V, BRAKE_OHM, BRAKE_DIVIDER = 48.0, 16.0, 11.0  # half the supply is at either end of a brake without current
LIFT_BIAS_V: Final = 2.5  # and both currents of the lift at rest
_SECONDARY, _SPARE, _BRAKE, _LAST = JOINTS, 12, 14, 15  # channels


class SetupJointsPlant:
    """The arms of one patient cart, by their names; `released` (plugs,): brakes of this plug's arm let it go."""

    def __init__(self, described: Described, board: EmulatedInterfaceBoard, slots: npt.NDArray[np.intp],
                 status: npt.NDArray[np.uint32]) -> None:
        """At the positions of the document; `slots` are those of plugs 1 to 4 in currents and voltages.

        `status` (1,) is the status word of their board.
        """
        self.slots = slots
        self._board, self._status = board, status
        self.arms = {arm.name: arm for arm in described.arms}
        self._voltages = np.zeros((PLUGS, CHANNELS))
        self._voltages[PLUGS - 1, _SPARE : _LAST] = LIFT_BIAS_V
        self.positions = {arm.name: tuple(_middle(arm)) for arm in described.arms}  # of six joints, m and rad
        for name, arm in self.arms.items():
            self.settle(name, arm.position or self.positions[name])
        release = np.zeros(PLUGS)
        for arm in described.arms:
            release[arm.plug - 1] = abs(arm.release_current)
        self._lets_go = np.where(release > 0.0, BRAKE_LETS_GO * release, np.inf)
        self._holds_off = np.where(release > 0.0, BRAKE_HOLDS_OFF * release, np.inf)
        self.released = np.zeros(PLUGS, dtype=np.bool_)
        self._lifted = [arm for arm in described.arms if arm.lifts]
        self._driven = board.driven

    def place(self, arm: str, positions: Sequence[float]) -> None:
        """Move an arm's six joints to a position, m and rad. ValueError while its brakes hold."""
        if arm not in self.arms:
            raise KeyError(f"{arm or 'no name'}: no such setup arm; there are {', '.join(self.arms)}")
        if len(positions) != JOINTS or not all(math.isfinite(value) for value in positions):
            raise ValueError(f"{arm}: {len(positions)} positions; allowed: {JOINTS} finite numbers")
        if not self.released[self.arms[arm].plug - 1]:
            raise ValueError(f"{arm}: its brakes are engaged; release them first")
        self.settle(arm, positions)

    def settle(self, name: str, positions: Sequence[float]) -> None:
        """Set the six joint positions of an arm, whatever holds them."""
        arm = self.arms[name]
        self.positions[name] = tuple(map(float, positions))
        row = self._voltages[arm.plug - 1]
        for first, pots in ((0, arm.primary), (_SECONDARY, arm.secondary)):
            row[first : first + JOINTS] = [(position - offset) / scale if scale else 0.0
                                           for position, (scale, offset) in zip(positions, pots, strict=True)]

    # -- outputs and inputs of the board, once a physics step ----------------------------------------------------------

    def step(self, flowing: Floats, on: Flags) -> Floats:
        """Voltages at the analog inputs of plugs 1 to 4 from now on, while these currents flow in these amplifiers."""
        current, on = flowing[self.slots], on[self.slots]
        size = np.abs(current)
        self.released = size >= np.where(self.released, self._holds_off, self._lets_go)
        self._show_brakes(np.where(on, (SUPPLY_V + BRAKE_OHM * current) / (2.0 * BRAKE_DIVIDER), 0.0))
        driven, self._driven = self._board.driven - self._driven, self._board.driven
        if driven and self._status[0] & reg.STATUS_MV_GOOD:
            self._lift(driven * LIFT_M_S * reg.TICK_S)
        return self._voltages[:, self._board.channel]

    def _show_brakes(self, volts: Floats) -> None:
        """The interface board takes plugs the other way round here, and the last one's input has them elsewhere."""
        self._voltages[: PLUGS - 1, _BRAKE] = volts[:0:-1]
        self._voltages[PLUGS - 1, _LAST] = volts[0]

    def _lift(self, way: float) -> None:
        for arm in self._lifted:
            first, *others = self.positions[arm.name]
            lower, upper = _reach(arm, 0)
            self.settle(arm.name, (min(max(first + way, lower), upper), *others))


def _reach(arm: EmulatedSetupArm, joint: int) -> tuple[float, float]:
    """Between which positions both potentiometers of a joint show where it is."""
    ranges = [_range(pots[joint]) for pots in (arm.primary, arm.secondary)]
    return max(low for low, _ in ranges), min(high for _, high in ranges)


def _range(pot: Linear) -> tuple[float, float]:
    scale, offset = pot
    return min(offset, offset + scale * POT_V), max(offset, offset + scale * POT_V)


def _middle(arm: EmulatedSetupArm) -> list[float]:
    return [sum(_reach(arm, joint)) / 2.0 for joint in range(JOINTS)]


def fit(system: SystemConfig, wiring: Wiring, buses: Sequence[EmulatedBus]) -> dict[str, SetupJointsPlant]:
    """Hang the setup joints of a system on their boards; by the name of their robot."""
    fitted: dict[str, SetupJointsPlant] = {}
    if system.emulation is None:
        return fitted
    number = {described.io: index for index, described in enumerate(system.emulation.buses)}
    for described in system.emulation.setup_joints:
        bus, row = buses[number[described.io]], wiring.rows[described.io, described.board_id]
        local = bus.ids.index(described.board_id)
        board = bus.firmware.fit(local, described)
        if board is None:
            continue  # the test board is there instead
        slots = np.array([wiring.width * row + axis for axis in described.axes], dtype=np.intp)
        status = bus.power.status[local : local + 1]
        fitted[described.name] = SetupJointsPlant(described, board, slots, status)
        for arm in described.arms:
            _plug_in(described, arm, row, wiring, bus, local)
    return fitted


def _plug_in(described: Described, arm: EmulatedSetupArm, row: int, wiring: Wiring, bus: EmulatedBus,
             local: int) -> None:
    """A plug pulls the negative limit of its axis low, unless the files have another use for that input."""
    far, axis = divmod(described.axes[arm.plug - 1], reg.AXES)  # a DQLA's second QLA has its inputs 16 bits up
    bit = reg.INPUT_NEGATIVE_LIMIT_SHIFT + axis + 16 * far
    if not any((button.row, button.bit) == (row, bit) for button in wiring.inputs.values()):
        bus.lines.inputs[local] &= np.uint32(~(1 << bit) & 0xFFFF_FFFF)
