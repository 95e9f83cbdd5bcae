"""Who gets and answers what with firmware Rev 7, 8 and 9, as a bridge and Ethernet-only; boards that go and come."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import GROUP, EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg

STAY = wire.NO_FORWARD


def controllers(firmware: int, *ids: int, fpga: str = "V3") -> tuple[Controller, ...]:
    return tuple(Controller(board, firmware=firmware, fpga=fpga) for board in ids)


class RevisionLine:
    """A host on a clock that moves only when told."""

    def __init__(self, bus: EmulatedBus) -> None:
        self.bus, self.tick = bus, 0

    def ask(self, request: bytes, to: int = GROUP) -> board_side.WireResponse | board_side.Dropped | None:
        reply = self.bus.answer(request, self.tick, to)
        return None if reply is None else board_side.decode_response(reply)

    def read(self, node: int, address: int, flags: int = 0, to: int = GROUP, generation: int | None = None) -> object:
        """What a quadlet read brings: (responder, value), "dropped" or None."""
        known = self.bus.generation if generation is None else generation
        response = self.ask(wire.quadlet_read(node, address, 9, known, flags), to)
        if isinstance(response, board_side.WireResponse):
            return response.node, response.value
        return None if response is None else "dropped"

    def write(self, node: int, address: int, value: int, flags: int = 0, to: int = GROUP) -> None:
        assert self.ask(wire.quadlet_write(node, address, value, 9, self.bus.generation, flags), to) is None

    def boards_with(self, address: int, value: int) -> list[int]:
        """Ids of the boards whose register has a value."""
        firmware = self.bus.firmware
        return [firmware.ids[row] for row in range(firmware.count) if firmware.read(row, address, self.tick) == value]

    def query(self, sequence: int, mask: int, flags: int = 0) -> board_side.WireResponse | board_side.Dropped | None:
        value = sequence << 16 | mask
        return self.ask(wire.quadlet_write(wire.BROADCAST, reg.QUERY, value, 33, self.bus.generation, flags))

    def hub(self, quads: int, node: int = 0, flags: int = 0, to: int = GROUP) -> list[int]:
        response = self.ask(wire.block_read(node, reg.HUB, 4 * quads, 34, self.bus.generation, flags), to)
        assert isinstance(response, board_side.WireResponse)
        return [int(quad) for quad in np.frombuffer(response.data, ">u4")]


@pytest.mark.parametrize("firmware", [7, 8])
def test_bridges_up_to_rev_8_know_their_nodes_whatever_the_flags(firmware: int) -> None:
    line = RevisionLine(EmulatedBus(controllers(firmware, 5, 2, fpga="V2")))
    assert line.read(0, reg.FIRMWARE) == line.read(0, reg.FIRMWARE, STAY) == (0, firmware)
    assert line.read(1, reg.FIRMWARE) == (1, firmware)
    assert line.read(1, reg.FIRMWARE, STAY) is None
    assert line.read(wire.BROADCAST, reg.FIRMWARE) == line.read(wire.BROADCAST, reg.FIRMWARE, STAY) == (0, firmware)
    assert line.read(0, reg.FIRMWARE, STAY, generation=77) == "dropped"


def test_a_rev_9_bridge_goes_by_board_id_when_told_not_to_forward() -> None:
    line = RevisionLine(EmulatedBus(controllers(9, 5, 2)))
    assert line.read(0, reg.FIRMWARE) == (0, 9)
    assert line.read(0, reg.FIRMWARE, STAY) is None, "no board has id 0"
    assert line.read(5, reg.FIRMWARE, STAY) == (5, 9)
    assert line.read(2, reg.FIRMWARE, STAY) is None, "not relayed"
    assert line.read(wire.BROADCAST, reg.FIRMWARE) is None, "broadcast reads only when they stay"
    assert line.read(wire.BROADCAST, reg.FIRMWARE, STAY) == (5, 9)
    assert line.read(5, reg.FIRMWARE, STAY, generation=77) == (5, 9), "FireWire's generation does not matter here"
    assert line.read(0, reg.FIRMWARE, generation=77) == "dropped"


def test_trailers_of_rev_9_echo_that_a_request_was_not_to_be_forwarded() -> None:
    for firmware, echo in ((8, 0), (9, 0x10)):
        response = RevisionLine(EmulatedBus(controllers(firmware, 0))).ask(
            wire.quadlet_read(0, reg.FIRMWARE, 1, 1, STAY))
        assert isinstance(response, board_side.WireResponse)
        assert response.trailer.flags == echo


def test_ethernet_only_boards_answer_at_their_own_address_only() -> None:
    line = RevisionLine(EmulatedBus(controllers(9, 1, 5), network="ethernet"))
    assert line.read(5, reg.FIRMWARE, STAY, to=5) == (5, 9)
    assert line.read(5, reg.FIRMWARE, STAY, to=1) is None
    assert line.read(5, reg.FIRMWARE, STAY, to=7) is None
    assert line.read(wire.BROADCAST, reg.FIRMWARE, STAY) == (1, 9), "the hub alone"
    line.write(wire.BROADCAST, reg.WATCHDOG, 77, STAY)
    assert line.boards_with(reg.WATCHDOG, 77) == [1, 5]
    line.write(5, reg.WATCHDOG, 78, STAY, to=5)
    assert line.boards_with(reg.WATCHDOG, 78) == [5]


def test_ethernet_only_boards_have_their_id_added_to_their_ip_address() -> None:
    bus = EmulatedBus(controllers(9, 1, 5), network="ethernet")
    RevisionLine(bus).write(wire.BROADCAST, reg.IP_ADDRESS, reg.ip_quadlet("127.0.0.1"), STAY)
    assert [bus.board_at(bytes((127, 0, 0, last))) for last in (1, 2, 6)] == [None, 1, 5]


def test_an_ethernet_only_hub_answers_a_query_by_itself_with_its_own_block_first() -> None:
    line = RevisionLine(EmulatedBus(controllers(9, 5, 0, 3), network="ethernet"))
    response = line.query(0x1234, 0x29, STAY)
    assert isinstance(response, board_side.WireResponse)
    assert (response.tl, response.node, response.trailer.flags) == (33, 5, 0x10)
    quads = [int(quad) for quad in np.frombuffer(response.data, ">u4")]
    assert len(quads) == 3 * 33 + 1
    assert [quads[at] >> 15 for at in (0, 33, 66)] == [33 << 9 | 0x34 << 1] * 3
    assert [reg.board_of(quads[at + 2]) for at in (0, 33, 66)] == [5, 0, 3]
    assert quads[0] & 0x7FFF < quads[33] & 0x7FFF < quads[66] & 0x7FFF
    assert 0 < quads[-1] >> 16 < quads[-1] & 0xFFFF
    assert line.hub(100, 5, STAY, to=5)[:-1] == quads[:-1], "and it may be read again"


def test_an_ethernet_only_query_that_not_all_answer_brings_nothing_by_itself() -> None:
    line = RevisionLine(EmulatedBus(controllers(9, 0, 3), network="ethernet"))
    assert line.query(1, 0x29, STAY) is None
    quads = line.hub(100, 0, STAY, to=0)
    assert [reg.board_of(quads[at + 2]) for at in (0, 33)] == [0, 3]
    assert quads[66:] == [0] * 34
    assert line.query(1, 0x09, 0) is None, "nor does one for FireWire"


def test_mixed_boards_on_one_bridge_answer_each_in_its_own_way() -> None:
    line = RevisionLine(EmulatedBus((Controller(3, firmware=9, fpga="V3"), Controller(0, firmware=7),
                                     Controller(4, "DQLA", 9, "V3"),
                                     Controller(6, "dRA1", 9, "V3"))))
    assert [line.read(node, reg.FIRMWARE) for node in range(4)] == [(0, 9), (1, 7), (2, 9), (3, 9)]
    identities = [line.read(node, reg.HARDWARE_ID) for node in range(4)]
    assert identities == [(0, reg.QLA1), (1, reg.QLA1), (2, reg.DQLA), (3, reg.DRA1)]
    for node, board, quads in ((0, 3, 32), (1, 0, 28), (2, 4, 60), (3, 6, 59)):
        response = line.ask(wire.block_read(node, reg.REAL_TIME, 4 * quads, 1, line.bus.generation))
        assert isinstance(response, board_side.WireResponse)
        words = np.frombuffer(response.data, ">u4")
        assert reg.board_of(int(words[1])) == board
        assert words[4] & 0xFFFF == reg.CURRENT_ZERO
    line.query(0x0105, 0x59)
    quads_of = line.hub(29 + 33 + 61 + 60 + 1)
    starts = (0, 29, 62, 123)
    assert [reg.board_of(quads_of[at + 2]) for at in starts] == [0, 3, 4, 6]
    heads = [0x0105 << 2, *(size << 10 | 5 << 2 for size in (33, 61, 60))]
    assert [quads_of[at] >> 14 for at in starts] == heads


def test_a_missing_board_keeps_those_after_it_from_reporting() -> None:
    line = RevisionLine(EmulatedBus(controllers(8, 0, 2, 4, fpga="V2")))
    line.query(1, 0b10111)
    quads = line.hub(4 * 33 + 1)
    assert quads[0]
    assert not any(quads[33:]), "board 1 is not there, so 2 and 4 wait for ever"


def test_rev_7_shows_the_old_block_of_a_board_that_does_not_report() -> None:
    line = RevisionLine(EmulatedBus(controllers(7, 0, 2, 4, fpga="V2")))
    line.query(1, 0b10101)
    line.bus.hub_memory.withheld[1] = 1
    line.query(2, 0b10111)
    quads = line.hub(4 * 29 + 1)
    assert [quads[at] >> 16 for at in (0, 29, 58, 87)] == [2, 0, 1, 1]
    assert quads[-1], "the timing quadlet is always there"


def test_a_board_that_keeps_its_block_spoils_one_cycle() -> None:
    line = RevisionLine(EmulatedBus(controllers(8, 0, 1, fpga="V2")))
    line.bus.hub_memory.withheld[1] = 1
    line.query(1, 3)
    assert [bool(quad) for quad in line.hub(67)[::33]] == [True, False, False], "no timing while a board is missing"
    line.query(2, 3)
    assert all(line.hub(67)[::33])


@pytest.mark.parametrize(("firmware", "wrong"), [(7, 0x0002), (8, 0x2101 << 1 | 1)])
def test_a_spoilt_sequence_number_shows_in_the_header(firmware: int, wrong: int) -> None:
    line = RevisionLine(EmulatedBus(controllers(firmware, 0, fpga="V2")))
    line.bus.hub_memory.spoiled[0] = 1
    line.query(1, 1)
    head = line.hub(blocks.layout_of(firmware).hub_quads + 1)[0]
    assert head >> (16 if firmware == 7 else 15) in (wrong, 0x0000)
    line.query(2, 1)
    assert line.hub(blocks.layout_of(firmware).hub_quads + 1)[0] >> 15 == (2 << 1 if firmware == 7 else 0x2102 << 1)


def test_a_board_without_power_is_gone_and_the_others_are_numbered_anew() -> None:
    line = RevisionLine(EmulatedBus(controllers(8, 4, 7, 9, fpga="V2")))
    before = line.bus.generation
    line.bus.take_away(1, True)
    assert line.bus.generation == before + 1
    statuses = [line.read(node, reg.STATUS) for node in range(3)]
    assert [status and reg.board_of(status[1]) for status in statuses if isinstance(status, tuple)] == [4, 9]
    assert line.read(0, reg.FIRMWARE, generation=before) == "dropped"
    line.write(wire.BROADCAST, reg.WATCHDOG, 55)
    line.bus.take_away(1, False)
    assert line.bus.generation == before + 2
    assert line.boards_with(reg.WATCHDOG, 55) == [4, 9], "what comes back is as after power-up"


def test_a_host_that_asks_for_a_bus_reset_gets_one() -> None:
    line = RevisionLine(EmulatedBus(controllers(8, 4, fpga="V2")))
    before = line.bus.generation
    line.write(wire.BROADCAST, reg.PHY_REQUEST, reg.PHY_WRITE | 1 << reg.PHY_REGISTER_SHIFT | 0x40 | 63)
    assert line.bus.generation == before + 1


@pytest.mark.parametrize(("controller", "reported"), [
    (Controller(0, "DQLA", 7, "V3"), "DQLA with firmware 7"),
    (Controller(0, "QLA1", 7, "V3"), "QLA1 with firmware 7 on FPGA V3; allowed: 7 on V2, 8 on V2 or V3"),
    (Controller(0, "dRA1", 9, "V2"), "dRA1 with firmware 9 on FPGA V2"),
    (Controller(0, "QLA2"), "hardware QLA2; allowed: QLA1, DQLA, dRA1"),
])
def test_controllers_there_never_were_are_refused(controller: Controller, reported: str) -> None:
    with pytest.raises(ValueError, match=reported):
        EmulatedBus((controller,))


def test_ethernet_only_buses_need_rev_9_on_v3() -> None:
    with pytest.raises(ValueError, match="board 2: firmware 8"):
        EmulatedBus((*controllers(9, 1), *controllers(8, 2)), network="ethernet")


@pytest.mark.parametrize(("hardware", "firmware", "most"), [("QLA1", 8, 15), ("DQLA", 9, 8), ("dRA1", 9, 8)])
def test_no_bus_has_more_boards_than_hub_memory_has_room_for(hardware: str, firmware: int, most: int) -> None:
    boards = [Controller(i, hardware, firmware, "V3") for i in range(most + 1)]
    with pytest.raises(ValueError, match="quadlets in hub memory; allowed: 506"):
        EmulatedBus(tuple(boards))
    bus = EmulatedBus(tuple(boards[:most]), network="ethernet" if firmware == 9 else "bridge")
    reply = bus.answer(wire.quadlet_write(wire.BROADCAST, reg.QUERY, 1 << 16 | (1 << most) - 1, 1, 1, 1), 0)
    assert len(reply or b"") <= wire.MAX_DATA + 32


def test_sixteen_boards_of_rev_7_have_room_in_hub_memory() -> None:
    line = RevisionLine(EmulatedBus(controllers(7, *range(16), fpga="V2")))
    line.query(1, 0xFFFF)
    assert len(line.hub(29 * 16 + 1)) == 465


def test_hub_registers_tell_how_the_memory_was_filled() -> None:
    line = RevisionLine(EmulatedBus(controllers(8, 1, 2, 5)))
    line.query(0x123, 0x26)
    found = [line.read(2, reg.QUERY + k) for k in range(4)]
    assert found == [(2, 0x123_0026), (2, 32 << 16 | 66), (2, 99), (2, 5 << 16 | 6)]
    old = RevisionLine(EmulatedBus(controllers(7, 0, 5, 7, fpga="V2")))
    old.query(1, 0xA1)
    assert [old.read(0, reg.QUERY + k) for k in (1, 2)] == [(0, 0x0570_5705), (0, 0x7057_0570)]


def test_boards_on_the_network_tell_of_their_own_errors_only() -> None:
    line = RevisionLine(EmulatedBus(controllers(9, 2, 5), network="ethernet"))
    astray = bytearray(wire.quadlet_read(5, reg.FIRMWARE, 9, line.bus.generation, STAY))
    astray[2] ^= 0x80  # another destination bus
    assert line.ask(bytes(astray), 5) is None
    errors = []
    for board in (2, 5):
        reply = line.ask(wire.quadlet_read(board, reg.ETHERNET, 9, line.bus.generation, STAY), board)
        assert isinstance(reply, board_side.WireResponse)
        errors.append((reply.value >> 25 & 1, reply.trailer.flags & wire.ETHERNET_ERROR != 0))
    assert errors == [(0, False), (1, True)]
