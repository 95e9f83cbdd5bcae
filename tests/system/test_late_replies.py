"""A bus on which replies come late, or not at all: io is not deceived, goes on, and blames whose fault it is."""

from __future__ import annotations

import pytest

from tests.system.robot import Robot, wait_for
from tests.system.samples import Records, is_well, newest, stop_boards
from trocar.shm.ring.ring import RingReader
from trocar.shm.time.clock import monotonic_ns

pytestmark = [pytest.mark.slow, pytest.mark.patient]


def test_boards_that_stood_still_are_heard_again(demo: Robot, records: Records) -> None:
    """However far behind their replies are by then; io itself goes on all the time."""
    state, io = records(demo, "IO1", "state"), demo.pid("IO1")
    for seconds in (0.15, 0.3, 0.8):
        stop_boards(demo, seconds, [state])
    assert demo.pid("IO1") == io and newest(state, "bad_reads") > 10


def reported(events: RingReader, since_ns: int) -> list[tuple[str, str]]:
    """Codes and texts of what io has reported."""
    return [(bytes(row["code"]).rstrip(b"\0").decode(), bytes(row["text"]).rstrip(b"\0").decode())
            for row in events.since(since_ns)]


def test_a_board_that_is_gone_is_blamed_alone(demo: Robot, records: Records) -> None:
    state, events = records(demo, "IO1", "state"), records(demo, "IO1", "events")
    demo.trocar("power-on")
    begun_ns = monotonic_ns()
    demo.trocar("send", "boards", "unplug_board", "7", "IO1")
    wait_for(lambda: any(code == "board-away" for code, _ in reported(events, begun_ns)), 60, "io says so")
    text = next(text for code, text in reported(events, begun_ns) if code == "board-away")
    assert text.startswith("PSM1, board 7: ")

    def sampled() -> bool:
        cycle, bad = newest(state, "cycle"), newest(state, "bad_reads")
        wait_for(lambda: newest(state, "cycle") >= cycle + 1500, 60, "a second's cycles with one board")
        return bool(newest(state, "bad_reads") < bad + 30)

    wait_for(sampled, 60, "the other board is sampled in every cycle; a crowded machine misses some")
    demo.trocar("send", "boards", "plug_board", "7", "IO1")
    back_ns = monotonic_ns()
    wait_for(lambda: is_well(state, back_ns), 60, "good samples of both boards")
