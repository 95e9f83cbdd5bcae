"""Who has control, on a clock of the test's."""

from __future__ import annotations

from procs.gui.control import HEARTBEAT_NS, BrowserControl

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
