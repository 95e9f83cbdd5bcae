"""Raw Ethernet: which interface, which frames. What needs a cable runs with the conformance test, in its namespace."""

from __future__ import annotations

import socket
import subprocess

import pytest

from tests.fpga import board_side
from tests.io.emulated_ports import OTHER_END, OUR_END, PortBench, in_namespace
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus import ethernet, named_port
from trocar.procs.io.bus.ethernet import EthernetTransport, interface_of
from trocar.procs.io.bus.transport import PortError

on_cable = pytest.mark.skipif(not in_namespace(), reason="runs in the namespace of the conformance test")


def test_interfaces_are_named_or_counted_and_unknown_ones_are_refused_with_those_there_are(monkeypatch):
    monkeypatch.setattr(ethernet, "interfaces", lambda: ["lan", "wan"])
    assert [interface_of(where) for where in ("0", "1", "lan")] == ["lan", "wan", "lan"]
    for where in ("2", "lo"):
        with pytest.raises(PortError, match=r"no such Ethernet interface.*0: lan, 1: wan"):
            interface_of(where)


def test_a_user_who_may_not_use_raw_ethernet_is_told(monkeypatch):
    def refused(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(ethernet, "interfaces", lambda: ["lan"])
    monkeypatch.setattr(ethernet.socket, "socket", refused)
    with pytest.raises(PortError, match=r"eth:lan: raw Ethernet is not permitted.*cap_net_raw"):
        EthernetTransport("0").open()


@on_cable
def test_the_cable_is_the_only_interface_that_counts():
    assert sorted(ethernet.interfaces()) == [OUR_END, OTHER_END]


@on_cable
def test_one_bus_has_one_owner_whether_it_is_named_or_counted():
    with named_port.hold(f"eth:{OUR_END}"), pytest.raises(PortError, match="in use"):
        named_port.hold(f"ethfw:{ethernet.interfaces().index(OUR_END)}")


@on_cable
def test_frames_have_the_addresses_of_the_boards_and_a_length():
    with PortBench("eth without FireWire") as bench, listening() as cable, bench.port() as port:
        port.discover()
        port.read_quadlet(3, registers.STATUS)
        frames = heard(cable)
    own = next(bytes.fromhex(line.split()[1].replace(":", "")) for line in link_of(OUR_END) if "link/ether" in line)
    asked = frames[0]
    assert asked[:12] == bytes.fromhex("fb610e1394ff") + own and asked[14:16] == bytes((wire.NO_FORWARD, 0))
    assert int.from_bytes(asked[12:14], "big") == len(asked) - 14 == 18
    to_board = [frame for frame in frames if frame[:6] == bytes.fromhex("fa610e139403")]
    assert to_board and all(frame[6:12] == own for frame in to_board)


@on_cable
def test_frames_of_others_are_no_replies():
    with PortBench("eth") as bench, listening() as cable, bench.port(deadline_ms=20) as port:
        port.discover()
        own = cable_address(port)
        reply = board_side.quadlet_response(0, 1, 7, board_side.Trailer())
        length = len(reply).to_bytes(2, "big")
        board = wire.BOARD_MAC + b"\x02"
        for head in (b"\xff" * 6 + board, own + b"\x02" * 6, board + own):
            cable.send(head + length + reply)
        cable.send(own + board + (500).to_bytes(2, "big") + reply)  # says it is longer than it is
        port.counters.clear()
        assert port.read_quadlet(2, registers.HARDWARE_ID) == registers.QLA1
        assert port.counters.stray >= 3


@on_cable
def test_an_interface_that_is_down_is_told():
    subprocess.run(["ip", "link", "set", OUR_END, "down"], check=True)
    try:
        with pytest.raises(PortError, match="down"):
            EthernetTransport(OUR_END).open()
    finally:
        subprocess.run(["ip", "link", "set", OUR_END, "up"], check=True)


@on_cable
def test_a_cable_that_is_pulled_out_and_plugged_in_again_is_survived():
    with PortBench("eth") as bench, bench.port(deadline_ms=20) as port:
        port.discover()
        assert any(port.read_all() for _ in range(20))
        subprocess.run(["ip", "link", "set", OUR_END, "down"], check=True)
        assert not any([port.read_all(), port.write_all(), port.read_all()])
        subprocess.run(["ip", "link", "set", OUR_END, "up"], check=True)
        assert any(port.read_all() for _ in range(200))
        assert port.write_all()


def listening():
    """The other end of the cable, hearing everything."""
    made = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    made.bind((OTHER_END, 0x0004))
    made.settimeout(0.2)
    return made


def heard(cable):
    frames = []
    try:
        while True:
            frames.append(cable.recv(4096))
    except TimeoutError:
        return frames


def cable_address(port):
    return port._link.transport._own


def link_of(interface):
    done = subprocess.run(["ip", "link", "show", interface], check=True, capture_output=True, text=True)
    return done.stdout.splitlines()
