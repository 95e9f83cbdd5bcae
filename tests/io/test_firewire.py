"""FireWire through the kernel's devices: which of them, whom it speaks to, and how all boards are reached at once."""

from __future__ import annotations

import select

import pytest

from tests.io.fake_firewire import CARD, DISK, OTHER_CARD, FakeFirewire
from tests.io.stub_bus import eventually_reads
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus.bus_port import ALL_BOARDS
from trocar.procs.io.bus.firewire import FirewireTransport
from trocar.procs.io.bus.protocols import SEQUENTIAL
from trocar.procs.io.bus.transport import PortError


def test_only_boards_and_the_card_itself_are_spoken_to():
    with FakeFirewire() as fake, fake.port(first_control=0x00080000) as port:
        port.discover()
        assert eventually_reads(port) and port.write_all()
        assert fake.touched == {CARD, *(f"/dev/fw{10 + board}" for board in fake.ids)}
        assert DISK not in fake.touched


def test_cards_are_counted_and_one_without_boards_is_told():
    fake = FakeFirewire()
    fake.transport = lambda: FirewireTransport(1, fake)
    with fake, fake.port() as port, pytest.raises(PortError, match="no controller answers"):
        port.discover()
    fake.transport = lambda: FirewireTransport(2, fake)
    with fake, pytest.raises(PortError, match=r"fw:2: this machine has 2 FireWire cards, counted from 0"):
        fake.port().open()


def test_a_user_who_may_not_open_the_devices_is_told():
    fake = FakeFirewire()
    fake.forbidden = set(fake.devices())
    with fake, pytest.raises(PortError, match=r"not permitted to open /dev/fw0, .*udev"):
        fake.port().open()


@pytest.mark.parametrize("length", [0, 2, 8, 4068])
def test_answers_of_another_length_than_was_asked_for_are_none(length):
    with FakeFirewire() as fake, fake.port() as port:
        port.discover()
        assert eventually_reads(port)
        fake.spoil = lambda data: (data + bytes(length))[:length]
        with pytest.raises(PortError, match="is not answered"):
            port.read_quadlet(fake.ids[0], registers.STATUS)
        before = port.blocks.copy()
        assert not port.read_all() and (port.blocks == before).all()
        fake.spoil = lambda data: data
        assert eventually_reads(port)


def test_a_machine_without_firewire_is_told():
    class Nothing(FakeFirewire):
        def devices(self):
            return []

    with Nothing() as fake, pytest.raises(PortError, match=r"this machine has no FireWire card; .*--boards emulated"):
        fake.port().open()


@pytest.mark.parametrize(("first", "query", "commands"), [
    (False, (0, 0x1800), (0, 0xFFFF_FFFF_0000)),
    (True, (wire.BROADCAST, 0xFFFF_FFFF_1800), (wire.BROADCAST, 0xFFFF_FFFF_0000)),
])  # fmt: skip
def test_queries_and_commands_of_all_go_to_node_0_or_are_broadcast_where_that_is_no_board(first, query, commands):
    with FakeFirewire(first=first) as fake, fake.port() as port:
        port.discover()
        fake.broadcasts.clear()
        assert eventually_reads(port, tries=1) and port.write_all()
        assert fake.broadcasts == [query, commands]
        port.write_quadlet(ALL_BOARDS, registers.STATUS, registers.CONTROL_RELAY_ON)
        assert fake.broadcasts == [query, commands], "other registers are written board by board"
        assert all(port.read_quadlet(board, registers.STATUS) & registers.STATUS_RELAY for board in fake.ids)


def test_more_than_the_kernel_broadcasts_is_refused_with_the_protocol_that_could():
    with FakeFirewire(first=True) as fake, fake.port() as port:
        port._link.transport.open()
        assert port._link.transport.most_write == 512
        fake.transport = port._link.transport
        port.discover()
        port._link.transport.most_write = 71
        with pytest.raises(PortError, match=rf"3 boards do not fit one broadcast write \(72 bytes\).*{SEQUENTIAL}"):
            port._check_size(port._reader._rows.layouts)


def test_a_board_whose_device_comes_later_is_found_then():
    with FakeFirewire() as fake, fake.port(boards=(2, 3)) as port:
        port.discover()
        assert eventually_reads(port)
        fake.take_away(2)
        assert not any(port.read_all() for _ in range(4))
        assert f"/dev/fw{12}" not in fake.devices()
        fake.take_away(2, gone=False)
        assert eventually_reads(port, tries=200)


def test_a_device_that_may_be_opened_only_later_is_opened_then():
    with FakeFirewire() as fake, fake.port() as port:
        port.discover()
        fake.take_away(3)
        fake.forbidden = {"/dev/fw13"}  # its permissions are set a moment after it has appeared
        fake.take_away(3, gone=False)
        assert not any(port.read_all() and not port.away.any() for _ in range(8))
        fake.forbidden = set()
        assert any(not select.poll().poll(10) and port.read_all() and not port.away.any() for _ in range(400))


def test_a_card_that_is_pulled_out_is_a_bad_cycle():
    with FakeFirewire(first=True) as fake, fake.port(deadline_ms=5) as port:
        port.discover()
        assert eventually_reads(port)
        for path, end in fake._clients.values():
            if path == CARD:
                end.close()
        assert not port.read_all() and not port.write_all()


def test_a_reset_between_request_and_answer_is_noticed():
    with FakeFirewire() as fake, fake.port(SEQUENTIAL) as port:
        port.discover()
        assert eventually_reads(port)
        fake.kernel_generation += 1  # nobody was told yet
        assert not port.read_all()
        fake._report_reset()
        assert eventually_reads(port)
        assert port.counters.bus_resets >= 1


def test_replies_to_what_was_asked_before_reach_nobody():
    with FakeFirewire() as fake, fake.port() as port:
        port.discover()
        link, node = port._link, port.info(fake.ids[0]).node
        for times in (1, 2):
            assert link.send(wire.quadlet_read(node, registers.STATUS, 5, link.generation))
            assert times == 1 or link.transport.poll(100)
            assert link.transport.forget()
            assert not link.transport.poll(20), "neither one that waits nor one that is still to be fetched"
        assert link.read_quadlet(node, registers.HARDWARE_ID) == registers.QLA1


def test_the_card_sends_no_cycle_starts():
    with FakeFirewire() as fake:
        asked = []
        ioctl = fake.ioctl

        def recorded(fd, request, argument):
            asked.append((request, bytes(argument)))
            ioctl(fd, request, argument)

        fake.ioctl = recorded
        with fake.port():
            pass
    requests = [argument for request, argument in asked if request != 0xC0282300]
    assert len(requests) == 1 and int.from_bytes(requests[0][8:16], "little") == 0xFFFF_F000_0000


def test_another_cards_devices_are_left_alone():
    with FakeFirewire() as fake, fake.port() as port:
        port.discover()
        assert OTHER_CARD not in fake.touched
        assert all(path != OTHER_CARD for path, _ in fake._clients.values() if path in fake.touched)
