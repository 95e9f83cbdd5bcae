"""Sockets of the emulated buses: whose datagram it is, when it came, and where the reply goes."""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from collections.abc import Iterator

import pytest

from trocar.procs.boards import endpoints as endpoints_module
from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.endpoints import ANY, MULTICAST, Endpoints
from trocar.procs.document.system import BusConfig, Controller
from trocar.procs.fpga import wire
from trocar.procs.node.setup_error import SetupError

MS = 1_000_000
Heard = list[tuple[int, int, bytes]]


@contextlib.contextmanager
def served(bus: BusConfig, heard: Heard) -> Iterator[Endpoints]:
    """Endpoints of one bus that repeat what they hear."""

    def answer(number: int, data: wire.Buffer, receive_ns: int, to: int) -> wire.Buffer:
        heard.append((number, to, bytes(data)))
        return bytes(data)

    endpoints = Endpoints((bus,), answer, time.monotonic_ns, False,
                          addressee=lambda number, address: 5 if address == bytes((127, 0, 0, 6)) else None)
    try:
        yield endpoints
    finally:
        endpoints.close()


def host_at(address: str) -> socket.socket:
    host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    host.settimeout(5.0)
    host.bind((address, 0))
    host.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
    return host


def serve_until(endpoints: Endpoints, heard: Heard, count: int) -> None:
    deadline = time.monotonic() + 5.0
    while len(heard) < count and time.monotonic() < deadline:
        endpoints.serve(10 * MS)


ETHERNET = BusConfig("a", "127.91.8.64", (Controller(0, firmware=9, fpga="V3"), Controller(5, firmware=9, fpga="V3")),
                     network="ethernet")


def test_ethernet_only_boards_have_an_address_each_and_answer_from_it() -> None:
    heard: Heard = []
    with served(ETHERNET, heard) as endpoints, host_at("127.91.8.64") as host:
        host.sendto(b"five", ("127.91.8.69", wire.UDP_PORT))
        serve_until(endpoints, heard, 1)
        assert heard == [(0, 5, b"five")]
        assert host.recvfrom(100) == (b"five", ("127.91.8.69", wire.UDP_PORT))


def test_multicast_reaches_all_boards_of_the_own_bus_and_the_hub_answers() -> None:
    heard: Heard = []
    with served(ETHERNET, heard) as endpoints, host_at("127.91.8.79") as host, host_at("127.91.8.80") as stranger:
        stranger.sendto(b"of another bus", (MULTICAST, wire.UDP_PORT))
        host.sendto(b"all", (MULTICAST, wire.UDP_PORT))
        serve_until(endpoints, heard, 1)
        assert heard == [(0, GROUP, b"all")]
        assert host.recvfrom(100) == (b"all", ("127.91.8.64", wire.UDP_PORT))


def test_a_rev_9_bridge_is_reached_at_the_bus_and_at_its_hubs_address() -> None:
    heard: Heard = []
    bus = BusConfig("a", "127.91.8.96", (Controller(6, firmware=9), Controller(2, firmware=9)))
    with served(bus, heard) as endpoints, host_at("127.91.8.96") as host:
        for last in (96, 102):
            host.sendto(b"hub", (f"127.91.8.{last}", wire.UDP_PORT))
            serve_until(endpoints, heard, 1)
            assert host.recvfrom(100) == (b"hub", (f"127.91.8.{last}", wire.UDP_PORT))
            heard.clear()


def test_a_bus_at_every_address_answers_from_the_one_that_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    with host_at(ANY) as taken:  # a free port: on 1394 it would be in the way of other buses of this machine
        port = taken.getsockname()[1]
    monkeypatch.setattr(endpoints_module, "UDP_PORT", port)
    heard: Heard = []
    with served(BusConfig("a", ANY, (Controller(5, firmware=9, fpga="V3"),)), heard) as endpoints, host_at(ANY) as host:
        for asked in ("127.0.0.6", "127.0.0.1"):
            host.connect((asked, port))  # and hears nobody else
            host.send(b"x")
            serve_until(endpoints, heard, len(heard) + 1)
            assert host.recv(100) == b"x"
        assert [to for _, to, _ in heard] == [5, GROUP]


def test_sockets_answer_with_the_arrival_time_of_the_kernel() -> None:
    stamps: list[int] = []

    def answer(bus: int, data: wire.Buffer, receive_ns: int, to: int) -> wire.Buffer | None:
        stamps.append(receive_ns)
        return bytes([bus]) + bytes(data)

    buses = (BusConfig("a", "127.91.8.16", (Controller(0),)), BusConfig("b", "127.91.8.32", (Controller(0),)))
    endpoints = Endpoints(buses, answer, time.monotonic_ns, simulated=False)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.settimeout(5.0)
        try:
            before = time.monotonic_ns()
            host.sendto(b"first", ("127.91.8.32", wire.UDP_PORT))
            time.sleep(0.005)  # more than the two clocks are apart on a busy machine
            host.sendto(b"second", ("127.91.8.16", wire.UDP_PORT))
            sent = time.monotonic_ns()
            time.sleep(0.05)
            while len(stamps) < 2:
                endpoints.serve(10 * MS)
            assert {host.recv(100), host.recv(100)} == {b"\x01first", b"\x00second"}  # in any order, of two sockets
            slack = 25_000_000  # half of that sleep: a busy kernel delivers late, and the clocks' offset is read
            assert before - slack <= min(stamps) <= max(stamps) <= sent + slack
            with pytest.raises(SetupError, match=r"127\.91\.8\.16.*; stop that, or choose an address"):
                Endpoints(buses, answer, time.monotonic_ns, simulated=False)
        finally:
            endpoints.close()


def test_arrival_times_are_right_where_boards_were_held_up_while_they_compared_clocks() -> None:
    stamps: list[int] = []
    asked = itertools.count()

    def held_up_once() -> int:
        if next(asked) == 1:  # between the two looks at the other clock
            time.sleep(0.05)
        return time.monotonic_ns()

    endpoints = Endpoints((BusConfig("a", "127.91.10.16", (Controller(0),)),),
                          lambda bus, data, at, to: stamps.append(at), held_up_once, simulated=False)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host, contextlib.closing(endpoints):
        host.sendto(b"x", ("127.91.10.16", wire.UDP_PORT))
        sent = time.monotonic_ns()
        time.sleep(0.03)  # it lies there
        while not stamps:
            endpoints.serve(10 * MS)
    assert next(asked) > 2 and stamps[0] <= sent + 10 * MS


def test_in_lock_step_requests_arrive_at_the_simulated_time() -> None:
    stamps: list[int] = []
    endpoints = Endpoints((BusConfig("a", "127.91.9.16", (Controller(0),)),),
                          lambda bus, data, at, to: stamps.append(at), lambda: 4711, simulated=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.sendto(b"x", ("127.91.9.16", wire.UDP_PORT))
        while not stamps:
            endpoints.serve(10 * MS)
        endpoints.close()
    assert stamps == [4711]


@pytest.mark.parametrize("simulated", [True, False])
def test_a_read_without_a_reply_is_told_in_simulated_time_by_an_empty_datagram(simulated: bool) -> None:
    heard: list[wire.Buffer] = []
    endpoints = Endpoints((BusConfig("a", "127.91.10.16", (Controller(0),)),),
                          lambda bus, data, at, to: heard.append(bytes(data)), lambda: 4711, simulated=simulated)
    asked = [wire.quadlet_write(0, 0, 1, 1, 1), wire.quadlet_read(0, 0, 2, 1), wire.block_read(0, 0, 64, 3, 1)]
    replies = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.setblocking(False)
        for request in asked:
            host.sendto(request, ("127.91.10.16", wire.UDP_PORT))
            while heard[-1:] != [request]:
                endpoints.serve(10 * MS)
            with contextlib.suppress(BlockingIOError):
                replies.append((asked.index(request), host.recv(100)))
        endpoints.close()
    assert replies == ([(1, b""), (2, b"")] if simulated else [])
