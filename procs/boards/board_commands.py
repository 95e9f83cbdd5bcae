"""What a person or a test may do to the emulated boards and robots: the rows of the command table, carried out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.instruments import EmulatedInstruments
from trocar.procs.boards.packet_faults import DROPPED_REPLY, DUPLICATED, KINDS, LATE, LOST, MISLABELLED, PacketFaults
from trocar.procs.boards.robots.hand import Grip, Hands
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import SystemConfig
from trocar.procs.kinematics.poses import POSE
from trocar.shm.mailbox.received import Received


@dataclass(frozen=True, slots=True)
class CommandValues:
    """The numbers of a command, as its row allows them, and its text."""

    values: npt.NDArray[np.float64]
    text: str

    def number(self, at: int) -> float:
        """One of the numbers; the row of the command has its bounds."""
        return float(self.values[at])

    def whole(self, at: int) -> int:
        """One that is whole by its row: an axis, a board, how often."""
        return int(self.values[at])

    def on(self, at: int) -> bool:
        """1: on, 0: off."""
        return bool(self.values[at])


Order = Callable[[CommandValues], None]


class BoardCommands:
    """Carries out commands at once."""

    def __init__(self, board_faults: BoardFaults, instruments: EmulatedInstruments, hands: Hands,
                 packet_faults: PacketFaults) -> None:
        """All of one world."""
        self._board_faults, self._packet_faults = board_faults, packet_faults
        self._instruments, self._hands = instruments, hands
        self._table: dict[str, Order] = {
            **self._for_people(), **self._for_robots(), **self._for_boards(), **self._for_replies()}

    @classmethod
    def of(cls, system: SystemConfig, world: Emulation, plant: Plant) -> BoardCommands:
        """For the boards and robots of a system; `plant` is the world's own."""
        board_faults = BoardFaults(world, plant)
        hands = Hands(plant, tuple(arm.robot for arm in system.arms if arm.robot in world.wiring.robots))
        return cls(board_faults, EmulatedInstruments(system, world, board_faults, plant), hands, world.packet_faults)

    def carry_out(self, command: Received) -> None:
        """Do it and answer; a wrong argument refuses it with the reason."""
        order = self._table.get(command.name)
        if order is None:
            command.refuse(f"{command.name} is not possible here")
            return
        try:
            if why := command.command.objection(command.values):
                raise ValueError(why)
            order(CommandValues(command.values, command.text))
        except (KeyError, ValueError) as error:
            command.refuse(str(error.args[0] if error.args else error))
            return
        command.done()

    def _for_people(self) -> dict[str, Order]:
        """What hands do."""
        board_faults, instruments = self._board_faults, self._instruments
        return {
            "press": lambda w: board_faults.press(w.text, w.on(0)),
            "emergency_stop": lambda w: board_faults.stop(w.on(0), w.text),
            "insert_instrument": lambda w: instruments.insert(*_arm_and_name(w.text)),
            "remove_instrument": lambda w: instruments.remove(w.text),
            "apply_effort": lambda w: board_faults.push(w.text, w.values.copy()),
            "set_position": lambda w: board_faults.place(w.text, w.values.copy()),
            "support": lambda w: board_faults.support(w.text, w.on(0)),
            "pull_tip": self._hold,
            "release_tip": lambda w: self._hands.release(w.text),
        }

    def _for_robots(self) -> dict[str, Order]:
        """Faults of a robot and its sensors."""
        board_faults = self._board_faults
        return {
            "power_loss": lambda w: board_faults.lose_supply(w.text, w.on(0)),
            "amp_fault": lambda w: board_faults.fail_amplifier(w.text, w.whole(0), w.on(1)),
            "encoder_jump": lambda w: board_faults.jump_encoder(
                w.text, w.whole(0), w.whole(1)),
            "current_error": lambda w: board_faults.shift_current(w.text, w.whole(0), w.number(1)),
            "pot_drift": lambda w: board_faults.drift(
                w.text, w.whole(0), w.number(1), w.number(2) if len(w.values) > 2 else None),
            "pot_dead": lambda w: board_faults.kill_pot(w.text, w.whole(0), w.on(1)),
            "encoder_scale": lambda w: board_faults.scale_encoder(w.text, w.whole(0), w.number(1)),
            "swap_motors": lambda w: board_faults.swap_motors(w.text, w.whole(0), w.whole(1)),
            "jam": lambda w: board_faults.jam(w.text, w.whole(0), w.on(1)),
        }

    def _for_boards(self) -> dict[str, Order]:
        """Faults of a board or its bus."""
        board_faults = self._board_faults
        return {
            "unplug_board": lambda w: board_faults.take_away(w.whole(0), True, w.text),
            "plug_board": lambda w: board_faults.take_away(w.whole(0), False, w.text),
            "bus_reset": lambda w: board_faults.reset_bus(w.text),
            "drop_block": lambda w: board_faults.withhold(w.whole(0), w.whole(1), w.text),
            "spoil_sequence": lambda w: board_faults.spoil_sequence(w.whole(0), w.whole(1), w.text),
            "temperature": lambda w: board_faults.heat(
                w.whole(0), w.number(1), w.number(len(w.values) - 1), w.text),
        }

    def _for_replies(self) -> dict[str, Order]:
        """Faults on the way."""
        packet_faults, buses = self._packet_faults, self._board_faults.buses

        def next_ones(kind: str) -> Order:
            return lambda w: packet_faults.strike(kind, w.whole(0), buses(w.text))

        return {
            "lose_replies": next_ones(LOST),
            "duplicate_replies": next_ones(DUPLICATED),
            "drop_replies": next_ones(DROPPED_REPLY),
            "corrupt_tl": next_ones(MISLABELLED),
            "delay_replies": lambda w: packet_faults.strike(LATE, w.whole(0), buses(w.text), _delay_ns(w, 1)),
            "reply_rate": self._set_rate,
            "packet_loss": lambda w: packet_faults.lose_packets(w.number(0), buses(w.text)),
            "clear_packet_faults": lambda w: packet_faults.end(),
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
        self._packet_faults.strike_often(kind, words.number(0), self._board_faults.buses(bus.strip()),
                                         delay_ns)


def _delay_ns(words: CommandValues, at: int) -> int:
    return round(words.number(at) * 1e9)


def _arm_and_name(text: str) -> tuple[str, str]:
    arm, _, name = text.partition(" ")
    return arm, name.strip()
