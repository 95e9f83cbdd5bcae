"""Registers of the network chips, as the test programs of the boards look at them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.boards.devices.phy import MDIO_TICKS, FirewirePhy, Ksz8851, Rtl8211


def ask(phy: FirewirePhy, number: int) -> int:
    phy.request(number)
    assert phy.response >> 8 == number
    return phy.response & 0xFF


class Port(Rtl8211):
    """One port of FPGA V3, asked by a host that waits long enough."""

    tick = 0

    def read(self, number: int, chip: int = 1) -> int:
        self.request(0x6000_0000 | chip << 23 | number << 18, self.tick)
        self.tick += MDIO_TICKS
        result = self.result(self.tick)
        assert result >> 16 == number
        return result & 0xFFFF

    def write(self, number: int, value: int, chip: int = 1) -> None:
        self.request(0x5002_0000 | chip << 23 | number << 18 | value, self.tick)
        self.tick += MDIO_TICKS


# -- FireWire ----------------------------------------------------------------------------------------------------------


def test_firewire_phy_has_two_fast_ports() -> None:
    phy = FirewirePhy(5)
    assert ask(phy, 0) >> 2 == 5
    assert ask(phy, 1) & 0x3F == 63
    assert ask(phy, 2) & 0xE0 == 0xE0
    assert ask(phy, 2) & 0x1F == 2
    assert ask(phy, 3) >> 5 == 2
    assert ask(phy, 3) & 0xF == 0
    assert phy.bus_resets == 0


def test_gap_count_is_written_and_node_is_not() -> None:
    phy = FirewirePhy(5)
    phy.request(0x1100 | 7)
    phy.request(0xABCD_0000 | 0x1000 | 0xFF)
    assert phy.response == 0  # writes are not answered
    assert phy.requested == 0x10FF
    assert (ask(phy, 1), ask(phy, 0)) == (7, 20)


def test_host_can_ask_for_a_bus_reset() -> None:
    phy = FirewirePhy(0)
    phy.request(0x1100 | 0x40 | 9)
    assert (phy.bus_resets, ask(phy, 1)) == (1, 9)
    phy.request(0x1500 | 0x40)
    assert (phy.bus_resets, ask(phy, 5)) == (2, 0)
    phy.request(0x1500 | 0x83)
    phy.request(0x1400 | 0xC0)
    assert (phy.bus_resets, ask(phy, 5), ask(phy, 4)) == (2, 0x83, 0xC0)


def test_page_1_names_the_vendor() -> None:
    phy = FirewirePhy(0)
    assert [ask(phy, number) for number in range(8, 13)] == [0] * 5
    phy.request(0x1700 | 0x20)
    assert [ask(phy, number) for number in range(7, 13)] == [0x20, 1, 0, 0x08, 0x00, 0x28]


@given(st.lists(st.integers(0, 0xFFFF_FFFF)))
def test_any_request_is_swallowed(requests: list[int]) -> None:
    phy = FirewirePhy(62)
    for value in requests:
        phy.request(value)
    assert [ask(phy, number) for number in (0, 2, 3)] == [62 << 2, 0xE2, 0x40]


# -- Ethernet, V2 ------------------------------------------------------------------------------------------------------


def test_v2_chip_is_set_up_as_the_firmware_does() -> None:
    chip = Ksz8851(11)
    expected = {0x10: (0xFFFF, 0x940B), 0x12: (0xFFFF, 0x0E13), 0x14: (0xFFFF, 0xFA61), 0x84: (0x4000, 0x4000),
                0x70: (0x1FF, 0x1EF), 0x86: (0x4000, 0x4000), 0x9C: (0xFF, 1), 0x74: (0xFFFF, 0x7CE1),
                0xA2: (0xFFFF, 8), 0x82: (0x3F7, 0x20), 0x90: (0xFFFF, 0xA000), 0xC0: (0xFFF0, 0x8870)}
    assert {at: (mask, chip.read(at, True) & mask) for at, (mask, _) in expected.items()} == expected
    assert chip.read(0xF8, True) & 0x0660 == 0x0660
    assert chip.read(0x1E, True) == 0


def test_v2_chip_is_read_and_written_by_words_and_bytes() -> None:
    chip = Ksz8851(0)
    chip.write(0x20, 0x5_1234, True)
    assert [chip.read(at, False) for at in (0x20, 0x21)] == [0x34, 0x12]
    chip.write(0x21, 0xFFAB, False)
    chip.write(0x20, 0xFFCD, False)
    assert chip.read(0x21, True) == 0xABCD
    for fixed in (0xC0, 0xF8):
        before = chip.read(fixed, True)
        chip.write(fixed, ~before, True)
        assert chip.read(fixed, True) == before


# -- Ethernet, V3 ------------------------------------------------------------------------------------------------------


def test_v3_chip_tells_its_identity_and_delays() -> None:
    port = Port(2)
    assert [port.read(number) for number in (2, 3)] == [0x001C, 0xC916]
    assert port.read(26) == 0x002C  # link, full duplex, 1000 Mbit/s
    assert port.read(16, chip=8) & 0x2040 == 0x0040
    assert Port(1).read(16, chip=8) & 0x2040 == 0x2000
    port.write(31, 0xD08)
    assert port.read(17) & 0x100 and port.read(21) & 8
    assert [port.read(number) for number in (2, 31)] == [0x001C, 0xD08]
    port.write(31, 0xA42)
    assert [port.read(number) for number in (17, 21)] == [0, 0]
    assert port.read(2, chip=3) == 0xFFFF


def test_every_bit_of_the_interrupt_register_can_be_written() -> None:
    port = Port(2)
    assert port.read(18) == 0x10
    for bit in range(16):
        port.write(18, 1 << bit)
        assert port.read(18) == 1 << bit
    for fixed in (1, 2, 3, 26):
        before = port.read(fixed)
        port.write(fixed, before ^ 0xFFFF)
        assert port.read(fixed) == before
    for number in (5, 31):
        port.write(number, 0xD08, chip=3)
    assert [port.read(number) for number in (5, 31)] == [0, 0xA42]
    for value in (1, 2, 3):  # results that nobody reads are not in the way
        port.write(18, value)
    assert port.read(18) == 3
    port.write(16, 0x2000, chip=8)
    port.reset()
    assert (port.read(18), port.read(16, chip=8), port.read(31)) == (0x10, 0x40, 0xA42)


def test_management_frame_takes_1024_ticks() -> None:
    port = Rtl8211(2)
    port.request(0x6000_0000 | 1 << 23 | 2 << 18, 100)
    assert [port.result(tick) for tick in (100, 1123, 1124)] == [0, 0, 2 << 16 | 0x1C]
    port.request(0x5002_0000 | 1 << 23 | 18 << 18 | 7, 2000)
    assert port.result(9000) == 2 << 16 | 0x1C  # a write leaves the result


def test_one_frame_waits_and_further_ones_are_lost() -> None:
    port = Rtl8211(2)
    for number in (2, 3, 26):
        port.request(0x6000_0000 | 1 << 23 | number << 18, 0)
    results = [port.result(tick) >> 16 for tick in (0, 1023, 1024, 2047, 2048, 9999)]
    assert results == [0, 0, 2, 2, 3, 3]
    port.request(0x6000_0000 | 1 << 23 | 2 << 18, 10_000)
    port.request(0x5002_0000 | 1 << 23 | 18 << 18 | 7, 10_000)
    assert port.result(10_000 + 2048) >> 16 == 2
