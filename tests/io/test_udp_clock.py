"""The UDP port and its clock: a simulated one may stand still, and empty datagrams end no wait in real time."""

from __future__ import annotations

import select
import time

from tests.io.stub_bus import bus_of, port_to
from tests.io.test_udp_cycle import quick_scan  # noqa: F401


def test_a_simulated_clock_may_stand_still():
    with bus_of(3) as bus, port_to(bus, now_ns=lambda: 1234, real_time=False, deadline_ms=None) as port:
        port.discover()

        def slow(request, replies):
            select.poll().poll(20)
            return replies

        bus.fault = slow
        assert port.read_all()
        assert port.recv_ns == 1234
        assert port.counters.timeouts == 0


def test_a_machine_that_stood_still_costs_no_read_in_simulated_time():
    with bus_of(3) as bus, port_to(bus, now_ns=lambda: 1234, real_time=False, deadline_ms=None) as port:
        port.discover()
        assert port.read_all()
        transport = port._link.transport
        poll, waits = transport.poll, []

        def held_up(timeout_ms):
            """It is over, however long it was to be, before the boards had a core."""
            waits.append(timeout_ms)
            return [] if len(waits) <= 2 else poll(timeout_ms)

        transport.poll = held_up
        assert port.read_all() and len(waits) > 2
        assert port.counters.timeouts == 0


def test_an_empty_datagram_ends_the_wait_while_time_stands_still():
    with bus_of(3) as bus, port_to(bus, now_ns=lambda: 1234, real_time=False, deadline_ms=20_000) as port:
        port.discover()
        began = time.monotonic()
        bus.fault = lambda request, replies: [b""] if replies else []
        assert not port.read_all()
        assert time.monotonic() - began < 10
        assert port.counters.timeouts == 1
        bus.fault = lambda request, replies: replies
        assert port.read_all()


def test_an_empty_datagram_of_a_stranger_ends_no_wait_in_real_time():
    with bus_of(3) as bus, port_to(bus, deadline_ms=5_000) as port:
        port.discover()
        bus.fault = lambda request, replies: [b"", *replies] if replies else []
        assert port.read_all()
        assert port.counters.timeouts == 0
