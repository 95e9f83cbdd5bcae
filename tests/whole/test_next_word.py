"""The rule of a bring-up: which word an arm gets next, in every state on the way to every goal."""

from __future__ import annotations

import itertools

import pytest

from tests.cases import cases
from trocar.procs.tables.bring_up import DISABLE, ENABLE, HOME, ORDER, next_word, obstacle, reached

STATES = ("", "DISABLED", "ENABLED", "PAUSED", "FAULT")
GOALS = (ENABLE, HOME, DISABLE)


@cases(("word", "asked", "state"), [*itertools.product(GOALS, ORDER, STATES)])
def test_words_come_once_and_in_order_and_none_beyond_the_goal(word: str, asked: str, state: str) -> None:
    found = next_word(word, asked, state)
    assert not found or ORDER.index(asked) < ORDER.index(found) <= ORDER.index(word)
    assert found != ENABLE or state == "DISABLED"
    assert found != HOME or state == "ENABLED"
    assert not (found and obstacle(word, asked, state, "PSM1", "")), "it is reported, and gets no word"


@pytest.mark.parametrize("state", STATES)
def test_disable_is_sent_in_every_state_and_reached_only_after_it(state: str) -> None:
    assert next_word(DISABLE, "", state) == DISABLE and not obstacle(DISABLE, "", state, "PSM1", "")
    assert not reached(DISABLE, "", True, state, False, False)
    assert reached(DISABLE, DISABLE, True, state, False, False) == (state == "DISABLED")
    assert not reached(DISABLE, DISABLE, False, state, False, False), "the arm has not confirmed it"
