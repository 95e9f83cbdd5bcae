import numpy as np
import pytest

from trocar.procs.document.system import DigitalInput
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED, Debounce

DT = 1.0 / 1024.0


def button(**changes) -> DigitalInput:
    values = {"name": "clutch", "board_id": 0, "bit_id": 0, "pressed_value": True, "trigger_when_pressed": True,
              "trigger_when_released": True, "debounce_s": 0.25} | changes
    return DigitalInput(**values)


def poll(debounce: Debounce, pressed: bool, times: int) -> list[tuple[int, int]]:
    """(poll number, event) of every event while a contact that closes is pressed or not: closed is low."""
    found = []
    for k in range(times):
        found += [(k, kind) for _, kind in debounce.poll(np.array([not pressed]), DT)]
    return found


def test_first_poll_reports_the_value() -> None:
    debounce = Debounce([button()])
    assert debounce.poll(np.array([False]), DT) == [(0, PRESSED)]
    assert Debounce([button()]).poll(np.array([True]), DT) == [(0, RELEASED)]


def test_the_first_event_heeds_the_triggers() -> None:
    assert poll(Debounce([button(trigger_when_pressed=False)]), True, 1) == []
    assert poll(Debounce([button(trigger_when_released=False)]), False, 1) == []


def test_first_run_may_be_skipped() -> None:
    debounce = Debounce([button(skip_first_run=True)])
    assert poll(debounce, False, 300) == []
    assert not debounce.value[0]


def test_pressed_from_the_first_is_a_press_where_the_first_run_is_skipped() -> None:
    assert poll(Debounce([button(skip_first_run=True)]), True, 300) == [(257, PRESSED)]
    assert poll(Debounce([button(skip_first_run=True, debounce_s=0.0)]), True, 3) == [(0, PRESSED)]


def test_press_is_reported_after_257_polls() -> None:
    debounce = Debounce([button()])
    poll(debounce, False, 3)
    assert poll(debounce, True, 300) == [(257, PRESSED)]
    assert poll(debounce, False, 300) == [(257, RELEASED)]


def test_short_press_clicks_and_is_no_press() -> None:
    debounce = Debounce([button()])
    poll(debounce, False, 1)
    assert poll(debounce, True, 2) == []
    assert poll(debounce, False, 1) == [(0, CLICKED)]
    assert poll(debounce, False, 300) == []
    assert not debounce.value[0]


def test_a_spike_of_one_poll_is_nothing() -> None:
    debounce = Debounce([button()])
    poll(debounce, False, 1)
    assert poll(debounce, True, 1) + poll(debounce, False, 300) == []


def test_equal_click_time_switches_clicks_off() -> None:
    debounce = Debounce([button(debounce_click_s=0.25)])
    poll(debounce, False, 1)
    assert poll(debounce, True, 10) + poll(debounce, False, 10) == []


def test_without_debounce_changes_count_at_once() -> None:
    debounce = Debounce([button(debounce_s=0.0)])
    poll(debounce, False, 1)
    assert poll(debounce, True, 2) == [(0, PRESSED)]


def test_triggers_choose_what_is_reported() -> None:
    debounce = Debounce([button(debounce_s=0.0, trigger_when_released=False)])
    assert poll(debounce, False, 1) == []
    assert poll(debounce, True, 1) == [(0, PRESSED)]
    assert poll(debounce, False, 1) == []


@pytest.mark.parametrize("pressed_value", [True, False])
@pytest.mark.parametrize("bit", [True, False])
def test_the_pressed_value_is_the_value_of_a_low_bit(pressed_value: bool, bit: bool) -> None:
    debounce = Debounce([button(pressed_value=pressed_value)])
    value = not pressed_value if bit else pressed_value
    assert debounce.poll(np.array([bit]), DT) == [(0, PRESSED if value else RELEASED)]
    assert debounce.value[0] == value


@pytest.mark.parametrize(("polls", "clicks"), [(1, False), (2, True), (100, True), (256, True), (257, True)])
def test_every_shorter_press_of_two_polls_clicks(polls: int, clicks: bool) -> None:
    debounce = Debounce([button()])
    poll(debounce, False, 1)
    found = poll(debounce, True, polls) + poll(debounce, False, 300)
    assert [kind for _, kind in found] == ([CLICKED] if clicks and polls < 257 else [])


def test_a_click_lasts_longer_than_the_click_time() -> None:
    for polls, clicks in ((128, False), (129, False), (130, True)):  # polls - 1 periods against 128
        debounce = Debounce([button(debounce_click_s=0.125)])
        poll(debounce, False, 1)
        found = poll(debounce, True, polls) + poll(debounce, False, 300)
        assert [kind for _, kind in found] == [CLICKED] * clicks, polls


def test_letting_go_for_a_moment_is_no_click() -> None:
    debounce = Debounce([button()])
    poll(debounce, True, 1)
    assert poll(debounce, False, 50) + poll(debounce, True, 300) == []
    assert debounce.value[0]


def test_what_bounces_counts_from_the_last_bounce() -> None:
    debounce = Debounce([button(debounce_click_s=0.25)])
    poll(debounce, False, 1)
    for _ in range(5):
        assert poll(debounce, True, 200) + poll(debounce, False, 1) == []
    assert poll(debounce, True, 300) == [(257, PRESSED)]


def test_the_poll_after_the_debounce_time_takes_what_is_there() -> None:
    debounce = Debounce([button(debounce_click_s=0.25)])
    poll(debounce, False, 1)
    assert poll(debounce, True, 257) + poll(debounce, False, 1) == []  # released again just then
    assert not debounce.value[0]


def test_two_clicks_are_two_clicks() -> None:
    debounce = Debounce([button()])
    poll(debounce, False, 1)
    found = []
    for _ in range(2):
        found += poll(debounce, True, 20) + poll(debounce, False, 20)
    assert [kind for _, kind in found] == [CLICKED, CLICKED]


def test_inputs_are_independent() -> None:
    debounce = Debounce([button(), button(debounce_s=0.0), button(skip_first_run=True)])
    assert debounce.poll(np.array([True, True, True]), DT) == [(0, RELEASED), (1, RELEASED)]
    assert debounce.poll(np.array([False, False, True]), DT) == [(1, PRESSED)]
    assert debounce.value.tolist() == [False, True, False]


def test_no_inputs_are_fine() -> None:
    assert Debounce([]).poll(np.zeros(0, dtype=bool), DT) == []
