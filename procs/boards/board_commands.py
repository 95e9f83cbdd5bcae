"""Actions of a person or a test on the emulated boards and robots: the rows of the command table, executed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.instruments import EmulatedInstruments
from trocar.procs.boards.packet_faults import DROPPED_REPLY, DUPLICATED, KINDS, LATE, LOST, MISLABELLED, PacketFaults
from trocar.procs.boards.robots.hand import Grip, Hands
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import SystemConfig
from trocar.procs.kinematics.poses import POSE
from trocar.shm.mailbox.received import Received

Order = Callable[[str, list[float]], None]
"""From the text of a command and its numbers, as its row allows them: axes, boards and counts are whole, 1 is on."""


class BoardCommands:
    """Executes commands at once."""

    def __init__(self, board_faults: BoardFaults, instruments: EmulatedInstruments, hands: Hands,
                 packet_faults: PacketFaults) -> None:
        """All of one world."""
        self._table: dict[str, Order] = {
            **_for_people(board_faults, instruments, hands), **_for_robots(board_faults), **_for_boards(board_faults),
            **_for_replies(packet_faults, board_faults)}

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
            order(command.text, command.values.tolist())
        except (KeyError, ValueError) as error:
            command.refuse(str(error.args[0] if error.args else error))
            return
        command.done()


def _for_people(faults: BoardFaults, instruments: EmulatedInstruments, hands: Hands) -> dict[str, Order]:
    """Actions that a person would do by hand."""

    def insert(text: str, v: list[float]) -> None:
        arm, _, name = text.partition(" ")
        instruments.insert(arm, name.strip())

    return {
        "press": lambda text, v: faults.press(text, bool(v[0])),
        "emergency_stop": lambda text, v: faults.stop(bool(v[0]), text),
        "insert_instrument": insert,
        "remove_instrument": lambda text, v: instruments.remove(text),
        "apply_effort": lambda text, v: faults.push(text, np.array(v)),
        "set_position": lambda text, v: faults.place(text, np.array(v)),
        "move_by_hand": lambda text, v: faults.place(text, np.array(v), by_hand=True),
        "support": lambda text, v: faults.support(text, bool(v[0])),
        "pull_tip": lambda text, v: hands.hold(text, np.array(v[:POSE]), Grip.of(*v[POSE:]) if v[POSE:] else None),
        "release_tip": lambda text, v: hands.release(text),
    }


def _for_robots(faults: BoardFaults) -> dict[str, Order]:
    """Faults of a robot and its sensors."""
    return {
        "power_loss": lambda text, v: faults.lose_supply(text, bool(v[0])),
        "amp_fault": lambda text, v: faults.fail_amplifier(text, int(v[0]), bool(v[1])),
        "encoder_jump": lambda text, v: faults.jump_encoder(text, int(v[0]), int(v[1])),
        "current_error": lambda text, v: faults.shift_current(text, int(v[0]), v[1]),
        "pot_drift": lambda text, v: faults.drift(text, int(v[0]), v[1], v[2] if len(v) > 2 else None),
        "pot_dead": lambda text, v: faults.kill_pot(text, int(v[0]), bool(v[1])),
        "encoder_scale": lambda text, v: faults.scale_encoder(text, int(v[0]), v[1]),
        "swap_motors": lambda text, v: faults.swap_motors(text, int(v[0]), int(v[1])),
        "jam": lambda text, v: faults.jam(text, int(v[0]), bool(v[1])),
    }


def _for_boards(faults: BoardFaults) -> dict[str, Order]:
    """Faults of a board or its bus."""
    return {
        "unplug_board": lambda text, v: faults.take_away(int(v[0]), True, text),
        "plug_board": lambda text, v: faults.take_away(int(v[0]), False, text),
        "bus_reset": lambda text, v: faults.reset_bus(text),
        "drop_block": lambda text, v: faults.withhold(int(v[0]), int(v[1]), text),
        "spoil_sequence": lambda text, v: faults.spoil_sequence(int(v[0]), int(v[1]), text),
        "temperature": lambda text, v: faults.heat(int(v[0]), v[1], v[-1], text),
    }


def _for_replies(packets: PacketFaults, faults: BoardFaults) -> dict[str, Order]:
    """Faults on the way."""

    def next_ones(kind: str) -> Order:
        return lambda text, v: packets.strike(kind, faults.buses(text), count=int(v[0]))

    def rate(text: str, v: list[float]) -> None:
        kind, _, bus = text.partition(" ")
        if kind not in KINDS:
            raise KeyError(f"{kind or 'no kind'}: no such fault of replies; there are {', '.join(KINDS)}")
        if (len(v) == 2) != (kind == LATE):
            raise ValueError(f"{kind}: {len(v)} numbers; allowed: rate, and delay_s of {LATE} ones")
        packets.strike(kind, faults.buses(bus.strip()), rate=v[0], delay_ns=_ns(v[1]) if kind == LATE else 0)

    return {
        "lose_replies": next_ones(LOST),
        "duplicate_replies": next_ones(DUPLICATED),
        "drop_replies": next_ones(DROPPED_REPLY),
        "corrupt_tl": next_ones(MISLABELLED),
        "delay_replies": lambda text, v: packets.strike(LATE, faults.buses(text), count=int(v[0]), delay_ns=_ns(v[1])),
        "reply_rate": rate,
        "packet_loss": lambda text, v: packets.lose_packets(v[0], faults.buses(text)),
        "clear_packet_faults": lambda text, v: packets.end(),
    }


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
