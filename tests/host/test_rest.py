"""An arm at rest: few cycles, until there is something to do."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.host.hosted import document
from trocar.procs.host.host import Host
from trocar.shm.ring.ring import RingReader

MS = 1_000_000
PERIOD_NS = round(1e9 / 1500)


@pytest.fixture
def host() -> Iterator[Host]:
    """With PSM1 homed and at rest, in the middle of its sleep."""
    with Host(document("kinematic.yaml", None, ())) as one:
        one.run(0.1)
        for word, seconds in (("enable", 0.2), ("home", 2.0)):
            one.client("PSM1").send("state_command", (), word)
            one.run(seconds)
        state = one.reader("PSM1")
        assert state.newest() and state.field("is_homed")
        one.run_until(state.stamp_ns + 5 * MS)
        yield one


def newest(host: Host) -> RingReader:
    state = host.reader("PSM1")
    assert state.newest()
    return state


def test_an_arm_at_rest_writes_a_hundred_records_a_second(host: Host) -> None:
    before = newest(host).head
    host.run(1.0)
    assert newest(host).head - before == 100


def test_a_command_begins_its_next_cycle_at_once(host: Host) -> None:
    asked_ns = host.now_ns
    host.client("PSM1").send("move_jp", (0.1, 0.0, 0.1, 0.0, 0.0, 0.0))
    host.run(1e-9)
    assert newest(host).stamp_ns == asked_ns + 1, "after what others do at that instant"
    before = newest(host).head
    host.run(0.1)
    assert newest(host).head - before == 150, "it moves at its full rate"


def test_what_io_reports_begins_its_next_cycle_at_once(host: Host) -> None:
    off_ns = host.now_ns
    host.client("io").send("power_off", (), "PSM1")
    host.run(0.003)
    state = newest(host)
    assert state.field("state").item() == b"FAULT" and off_ns < state.stamp_ns < off_ns + 3 * MS


def test_a_silence_of_io_is_seen_a_sleep_later_at_most(host: Host) -> None:
    io = host.reader("io")
    host.delay("io", 1.0)
    assert io.newest()
    events = host.reader("PSM1", "events")
    while events.next():
        pass
    host.run(0.05)
    assert events.next()
    while events.field("state").item() != b"FAULT":
        assert events.next()
    assert 30 * MS < events.stamp_ns - io.stamp_ns <= 40 * MS + PERIOD_NS


def test_after_a_report_of_io_it_does_not_sleep_until_the_record_that_shows_it_must_be_out(host: Host) -> None:
    host.loops["io"].node.events.emit("warning", "something")  # its record comes later
    before, reported_ns = newest(host).head, host.now_ns
    host.run(0.005)
    assert newest(host).head - before > 5 and newest(host).stamp_ns > reported_ns + 4 * MS


def test_a_stream_begins_as_gently_as_without_the_sleep(host: Host) -> None:
    state = newest(host)
    at = state.field("setpoint_position")[:6].copy()
    host.client("PSM1").send("servo_jp", (at[0] + 0.03, *at[1:]))
    host.run_until(host.now_ns + PERIOD_NS // 2)
    assert state.newest()
    step = state.field("setpoint_position")[0] - at[0]
    host.run_until(host.now_ns + PERIOD_NS)
    assert state.newest()
    next_step = state.field("setpoint_position")[0] - at[0] - step
    assert 0.0 < step + next_step < 0.003, "10 ms of acceleration in one step would be 0.0075"
