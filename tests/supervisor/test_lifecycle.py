"""The states of an instance, over every pair of a state and an event."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.supervisor.played import Clock, PlayedProcess, played
from trocar.procs.supervisor.children import Child

STATES = {"STOPPED": (), "RUNNING": ("start",), "STOPPING": ("start", "stop"), "RESTARTING": ("start", "stop", "start")}
EVENTS = ("start", "stop", "quit")
EXPECTED = {
    ("STOPPED", "start"): "RUNNING",
    ("STOPPED", "stop"): "STOPPED",
    ("STOPPED", "quit"): "STOPPED",
    ("RUNNING", "start"): "RUNNING",
    ("RUNNING", "stop"): "STOPPING",
    ("RUNNING", "quit"): "STOPPED",
    ("STOPPING", "start"): "RESTARTING",
    ("STOPPING", "stop"): "STOPPING",
    ("STOPPING", "quit"): "STOPPED",
    ("RESTARTING", "start"): "RESTARTING",
    ("RESTARTING", "stop"): "STOPPING",
    ("RESTARTING", "quit"): "RUNNING",
}


def beat(child: Child, process: PlayedProcess, event: str) -> None:
    """The event, then what the supervisor does in each beat, twice: the second one changes nothing."""
    if event == "quit":
        process.ends(0)
    else:
        {"start": child.start, "stop": child.stop}[event]()
    for _ in range(2):
        child.look()
        before = process.begun
        child.ensure()
    assert process.begun == before


@cases("pair", list(itertools.product(STATES, EVENTS)))
def test_every_pair_goes_where_the_design_says(pair: tuple[str, str]) -> None:
    child, process = played("force", "arm", Clock())
    for event in STATES[pair[0]]:
        beat(child, process, event)
    assert child.state == pair[0]
    begun, asked = process.begun, process.asked
    beat(child, process, pair[1])
    assert child.state == EXPECTED[pair]
    assert (process.begun > begun) == (child.state == "RUNNING" and pair[0] != "RUNNING"), "begins on entering RUNNING"
    assert (process.asked and not asked) == (pair == ("RUNNING", "stop")), "is asked to end on leaving it by a stop"


@given(st.lists(st.sampled_from(EVENTS)))
def test_at_most_one_process_ever_runs(events: list[str]) -> None:
    child, process = played("force", "arm", Clock())
    for event in events:
        beat(child, process, event)  # `begin` refuses a second one
        assert process.runs == (child.state != "STOPPED")
