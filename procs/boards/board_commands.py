"""What a person or a test may do to the emulated boards and robots: the rows of the command table, carried out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procs.boards.board_faults import BoardFaults
from procs.boards.emulation import Emulation
from procs.boards.instruments import EmulatedInstruments
from procs.boards.packet_faults import DROPPED_REPLY, DUPLICATED, KINDS, LATE, LOST, MISLABELLED, PacketFaults
from procs.boards.robots.hand import Grip, Hands
from procs.boards.robots.plant import Plant
from procs.document.system import SystemConfig
from procs.kinematics.poses import POSE
from shm.commands import COMMANDS
from shm.received import Received

MAX_TIMES = 1_000_000
MAX_DELAY_S = 60.0
ENCODER_HALF = 1 << 23
BOARDS = 16


@dataclass(frozen=True, slots=True)
class CommandValues:
    """The numbers and the text of a command; ValueError says what is wrong with them."""

    values: npt.NDArray[np.float64]
    text: str

    def number(self, at: int, low: float = -np.inf, high: float = np.inf) -> float:
        """A finite number within limits."""
        value = float(self.values[at])
        if not (np.isfinite(value) and low <= value <= high):
            limits = f"{low:g} to {high:g}" if np.isfinite((low, high)).any() else "finite ones"
            raise ValueError(f"number {at + 1} is {value:g}; allowed: {limits}")
        return value

    def whole(self, at: int, low: int, high: int) -> int:
        """A whole number within limits."""
        value = self.number(at, low, high)
        if value != int(value):
            raise ValueError(f"number {at + 1} is {value:g}; allowed: whole ones")
        return int(value)

    def on(self, at: int) -> bool:
        """1: on, 0: off."""
        return bool(self.whole(at, 0, 1))

    def axis(self) -> int:
        """The first number, an actuator; which ones there are is looked up."""
        return self.whole(0, 0, 255)

    def board(self) -> int:
        """The first number, a board id."""
        return self.whole(0, 0, BOARDS - 1)

    def times(self, at: int) -> int:
        """How often."""
        return self.whole(at, 0, MAX_TIMES)


Order = Callable[[CommandValues], None]


class BoardCommands:
    """Carries out commands at once."""

    def __init__(self, board_faults: BoardFaults, instruments: EmulatedInstruments, hands: Hands,
                 packet_faults: PacketFaults) -> None:
        """All of one world."""
        self._board_faults, self._packet_faults = board_faults, packet_faults
        self._instruments, self._hands = instruments, hands
        self._rows = {row.name: row for row in COMMANDS["boards"]}
        # how many numbers a command takes, and what it does
        self._table: dict[str, tuple[tuple[int, ...], Order]] = {
            **self._for_people(), **self._for_robots(), **self._for_boards(), **self._for_replies()}

    @classmethod
    def of(cls, system: SystemConfig, world: Emulation, plant: Plant) -> BoardCommands:
        """For the boards and robots of a system; `plant` is the world's own."""
        board_faults = BoardFaults(world, plant)
        hands = Hands(plant, tuple(arm.robot for arm in system.arms if arm.robot in world.wiring.robots))
        return cls(board_faults, EmulatedInstruments(system, world, board_faults, plant), hands, world.packet_faults)

    def carry_out(self, command: Received) -> None:
        """Do it and answer; a wrong argument refuses it with the reason."""
        counts, order = self._table.get(command.name, ((), None))
        if order is None:
            command.refuse(f"{command.name} is not possible here")
            return
        try:
            if counts and len(command.values) not in counts:
                allowed = " or ".join(map(str, counts))
                takes = self._rows[command.name].values or "none"
                raise ValueError(f"{len(command.values)} numbers; allowed: {allowed} ({takes})")
            order(CommandValues(command.values, command.text))
        except (KeyError, ValueError) as error:
            command.refuse(str(error.args[0] if error.args else error))
            return
        command.done()

    def _for_people(self) -> dict[str, tuple[tuple[int, ...], Order]]:
        """What hands do."""
        board_faults, instruments = self._board_faults, self._instruments
        return {
            "press": ((1,), lambda w: board_faults.press(w.text, w.on(0))),
            "emergency_stop": ((1,), lambda w: board_faults.stop(w.on(0), w.text)),
            "insert_instrument": ((0,), lambda w: instruments.insert(*_arm_and_name(w.text))),
            "remove_instrument": ((0,), lambda w: instruments.remove(w.text)),
            "apply_effort": ((), lambda w: board_faults.push(w.text, w.values.copy())),
            "set_position": ((), lambda w: board_faults.place(w.text, w.values.copy())),
            "pull_tip": ((POSE, POSE + 2, POSE + 4, POSE + 6), self._hold),
            "release_tip": ((0,), lambda w: self._hands.release(w.text)),
        }

    def _for_robots(self) -> dict[str, tuple[tuple[int, ...], Order]]:
        """Faults of a robot and its sensors."""
        board_faults = self._board_faults
        return {
            "power_loss": ((1,), lambda w: board_faults.lose_supply(w.text, w.on(0))),
            "amp_fault": ((2,), lambda w: board_faults.fail_amplifier(w.text, w.axis(), w.on(1))),
            "encoder_jump": ((2,), lambda w: board_faults.jump_encoder(
                w.text, w.axis(), w.whole(1, -ENCODER_HALF, ENCODER_HALF))),
            "current_error": ((2,), lambda w: board_faults.shift_current(w.text, w.axis(), w.number(1))),
            "pot_drift": ((2, 3), lambda w: board_faults.drift(
                w.text, w.axis(), w.number(1), w.number(2) if len(w.values) > 2 else None)),
            "pot_dead": ((2,), lambda w: board_faults.kill_pot(w.text, w.axis(), w.on(1))),
            "encoder_scale": ((2,), lambda w: board_faults.scale_encoder(w.text, w.axis(), w.number(1))),
            "swap_motors": ((2,), lambda w: board_faults.swap_motors(w.text, w.axis(), w.whole(1, 0, 255))),
            "jam": ((2,), lambda w: board_faults.jam(w.text, w.axis(), w.on(1))),
        }

    def _for_boards(self) -> dict[str, tuple[tuple[int, ...], Order]]:
        """Faults of a board or its bus."""
        board_faults = self._board_faults
        return {
            "unplug_board": ((1,), lambda w: board_faults.take_away(w.board(), True, w.text)),
            "plug_board": ((1,), lambda w: board_faults.take_away(w.board(), False, w.text)),
            "bus_reset": ((0,), lambda w: board_faults.reset_bus(w.text)),
            "drop_block": ((2,), lambda w: board_faults.withhold(w.board(), w.times(1), w.text)),
            "spoil_sequence": ((2,), lambda w: board_faults.spoil_sequence(w.board(), w.times(1), w.text)),
            "temperature": ((2, 3), lambda w: board_faults.heat(
                w.board(), w.number(1), w.number(len(w.values) - 1), w.text)),
        }

    def _for_replies(self) -> dict[str, tuple[tuple[int, ...], Order]]:
        """Faults on the way."""
        packet_faults, buses = self._packet_faults, self._board_faults.buses

        def next_ones(kind: str) -> tuple[tuple[int, ...], Order]:
            return (1,), lambda w: packet_faults.strike(kind, w.times(0), buses(w.text))

        return {
            "lose_replies": next_ones(LOST),
            "duplicate_replies": next_ones(DUPLICATED),
            "drop_replies": next_ones(DROPPED_REPLY),
            "corrupt_tl": next_ones(MISLABELLED),
            "delay_replies": ((2,), lambda w: packet_faults.strike(LATE, w.times(0), buses(w.text), _delay_ns(w, 1))),
            "reply_rate": ((1, 2), self._set_rate),
            "packet_loss": ((1,), lambda w: packet_faults.lose_packets(w.number(0, 0.0, 1.0), buses(w.text))),
            "clear_packet_faults": ((0,), lambda w: packet_faults.end()),
        }

    def _hold(self, words: CommandValues) -> None:
        grip = Grip.of(*words.values[POSE:].tolist()) if len(words.values) > POSE else None
        self._hands.hold(words.text, words.values[:POSE], grip)

    def _set_rate(self, words: CommandValues) -> None:
        kind, _, bus = words.text.partition(" ")
        if kind not in KINDS:
            raise KeyError(f"{kind or 'no kind'}: no such fault of replies; there are {', '.join(KINDS)}")
        if (len(words.values) == 2) != (kind == LATE):
            raise ValueError(f"{kind}: {len(words.values)} numbers; allowed: rate, and delay_s of {LATE} ones")
        delay_ns = _delay_ns(words, 1) if kind == LATE else 0
        self._packet_faults.strike_often(kind, words.number(0, 0.0, 1.0), self._board_faults.buses(bus.strip()),
                                         delay_ns)


def _delay_ns(words: CommandValues, at: int) -> int:
    return round(words.number(at, 0.0, MAX_DELAY_S) * 1e9)


def _arm_and_name(text: str) -> tuple[str, str]:
    arm, _, name = text.partition(" ")
    return arm, name.strip()
