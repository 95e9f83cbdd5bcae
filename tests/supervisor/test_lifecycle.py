"""The lifecycle table, walked over every pair."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.tables.lifecycle import ASK, BEGIN, EVENTS, STATES, TABLE, step

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


@pytest.mark.parametrize("pair", list(itertools.product(STATES, EVENTS)), ids="-".join)
def test_every_pair_goes_where_the_design_says(pair: tuple[str, str]) -> None:
    assert step(*pair)[0] == EXPECTED[pair]


def test_the_table_holds_known_names_only() -> None:
    assert {s for s, _ in TABLE} | {s for s, _ in TABLE.values()} == set(STATES)
    assert {e for _, e in TABLE} == set(EVENTS)


def test_a_process_begins_on_entering_running_and_is_asked_to_end_on_leaving_it_by_stop() -> None:
    for state, event in itertools.product(STATES, EVENTS):
        then, done = step(state, event)
        assert (done == BEGIN) == (then == "RUNNING" and state != "RUNNING")
        assert (done == ASK) == ((state, then) == ("RUNNING", "STOPPING"))


@given(st.lists(st.sampled_from(EVENTS)))
def test_at_most_one_process_ever_runs(events: list[str]) -> None:
    state, running = "STOPPED", 0
    for event in events:
        if event == "quit" and not running:
            continue  # only what runs can end
        running -= event == "quit"
        state, done = step(state, event)
        running += done == BEGIN
        assert running == (state != "STOPPED")
