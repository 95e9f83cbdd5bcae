"""How long io waits from a query to the read: as long as these boards need, or as the file says."""

from __future__ import annotations

import time

import pytest

from tests.io.stub_bus import StubBus, bus_of, port_to
from tests.io.test_udp_cycle import quick_scan  # noqa: F401

PATIENCE_S = 10.0


def waits_ns(port, bus: StubBus) -> list[int]:
    """Of twenty reads in a row that were good: from query to read. Fails when there never are any."""
    waits: list[int] = []
    until = time.monotonic() + PATIENCE_S
    while len(waits) < 20:
        assert time.monotonic() < until, "hardly any read is good"
        port.ask_all()
        asked_ns = port._link.send_ns
        good = port.read_all()
        waits = [*waits, port._link.send_ns - asked_ns] if good else []
    return waits


def test_without_a_key_it_is_ten_and_five_a_board_or_what_the_last_one_took() -> None:
    with bus_of(4) as bus, port_to(bus) as port:
        port.discover()
        assert min(waits_ns(port, bus)[2:]) >= 33_000, "1650 ticks of the last board"
    with bus_of(1) as bus, port_to(bus) as port:
        port.discover()
        assert min(waits_ns(port, bus)) >= 15_000


@pytest.mark.parametrize("boards", [1, 4])
def test_boards_that_are_slower_than_that_are_given_more_time(boards: int) -> None:
    with bus_of(boards) as bus, port_to(bus, deadline_ms=5000) as port:
        port.discover()
        assert port.read_all()
        bus.early_reads = 10
        assert not any(port.read_all() for _ in range(10)), "what answers an earlier query is no sample"
        assert port.counters.sequence_errors == 10
        waits = waits_ns(port, bus)
        assert waits[0] >= 10_000 + 5_000 * boards + 10 * 5_000
        assert min(waits[1:]) < waits[0], "a lost query is no reason to wait for ever"


def test_the_file_may_say_how_long() -> None:
    with bus_of(2) as bus, port_to(bus, query_wait_ns=90_000) as port:
        port.discover()
        assert min(waits_ns(port, bus)) >= 90_000
