import numpy as np

from procs.lib.debounce import CLICKED, PRESSED, RELEASED, Debounce
from procs.lib.document import DigitalInput

DT = 1.0 / 1024.0


def button(**changes) -> DigitalInput:
    values = {"name": "clutch", "board_id": 0, "bit_id": 0, "pressed_value": True, "trigger_when_pressed": True,
              "trigger_when_released": True, "debounce_s": 0.25} | changes
    return DigitalInput(**values)


def poll(debounce: Debounce, bit: bool, times: int) -> list[tuple[int, int]]:
    """(poll number, event) of every event."""
    found = []
    for k in range(times):
        found += [(k, kind) for _, kind in debounce.poll(np.array([bit]), DT)]
    return found


def test_first_poll_reports_the_value() -> None:
    debounce = Debounce([button()])
    assert debounce.poll(np.array([True]), DT) == [(0, PRESSED)]
    assert Debounce([button()]).poll(np.array([False]), DT) == [(0, RELEASED)]


def test_first_run_may_be_skipped() -> None:
    debounce = Debounce([button(skip_first_run=True)])
    assert debounce.poll(np.array([True]), DT) == []
    assert not debounce.value[0]


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


def test_active_low_inputs_are_inverted() -> None:
    debounce = Debounce([button(pressed_value=False, debounce_s=0.0)])
    poll(debounce, True, 1)
    assert not debounce.value[0]
    assert poll(debounce, False, 1) == [(0, PRESSED)]


def test_inputs_are_independent() -> None:
    debounce = Debounce([button(), button(debounce_s=0.0)])
    debounce.poll(np.array([False, False]), DT)
    assert debounce.poll(np.array([True, True]), DT) == [(1, PRESSED)]
    assert debounce.value.tolist() == [False, True]


def test_no_inputs_are_fine() -> None:
    assert Debounce([]).poll(np.zeros(0, dtype=bool), DT) == []
