"""Who has control, on a clock of the test's."""

from __future__ import annotations

from trocar.procs.gui.control import HEARTBEAT_NS, BrowserControl

S = 1_000_000_000


def test_one_browser_at_a_time_has_control() -> None:
    control = BrowserControl()
    assert control.holder(0) == ""
    assert control.take("a", 0) == "a" and control.take("b", 1) == "a"
    control.drop("b")
    assert control.holder(2) == "a"
    control.drop("a")
    assert control.take("b", 3) == "b"


def test_another_one_may_take_it_over() -> None:
    control = BrowserControl()
    control.take("a", 0)
    assert control.take("b", 1, over=True) == "b"
    control.beat("a", 2, 2)
    assert control.holder(2 * S) == "b" and control.holder(2 * S + 2) == ""


def test_who_is_silent_for_two_seconds_has_lost_it_for_good() -> None:
    control = BrowserControl()
    control.take("a", 0)
    for now in range(0, 10 * S, S):
        control.beat("a", now, now)
        assert control.holder(now + HEARTBEAT_NS) == "a"
    assert control.holder(11 * S + 1) == ""
    control.beat("a", 11 * S + 2, 11 * S + 2)
    assert control.holder(11 * S + 2) == ""


def test_what_a_browser_says_late_shows_that_it_was_there_then() -> None:
    control = BrowserControl()
    control.take("a", 0)
    for now in range(S, 4 * S, S // 2):
        control.beat("a", now, max(0, now - 3 * S))
    assert control.holder(2 * S + 1) == ""
    control.take("a", 5 * S)
    control.beat("a", 6 * S, 5 * S + S // 2)
    control.beat("a", 6 * S, 5 * S)
    assert control.holder(7 * S + S // 2) == "a" and control.holder(7 * S + S // 2 + 1) == ""


def test_it_is_free_when_nobody_was_there_for_as_long_as_silence_lasts() -> None:
    control = BrowserControl()
    assert control.is_free(10 * S)
    control.take("a", 10 * S)
    control.drop("a")
    assert not control.is_free(11 * S) and control.is_free(10 * S + HEARTBEAT_NS + 1)
    control.take("b", 20 * S)
    assert not control.is_free(20 * S + HEARTBEAT_NS) and control.is_free(20 * S + HEARTBEAT_NS + 1)
