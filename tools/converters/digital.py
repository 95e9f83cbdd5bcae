"""Digital inputs and outputs and instrument memories of old IO files."""

from __future__ import annotations

from trocar.tools.converters.element import Element
from trocar.tools.converters.names import today
from trocar.tools.converters.report import number_text

Json = dict[str, object]

_MAX_BOARDS, _MAX_BITS = 16, 32
_TRIGGERS = {"all": (True, True), "press": (True, False), "release": (False, True), "none": (False, False)}
_FLAGS = {"0": False, "1": True}
_CLICK = 0.2  # of the debounce time, where an old file did not say


def digital_input(element: Element) -> Json:
    """One `DigitalIn`."""
    row = _place(element)
    report = element.report
    if element.has("Pressed"):
        row["pressed_value"] = bool(element.word(_FLAGS, "Pressed"))
    else:
        row["pressed_value"] = False
        report.defaulted(element.line, element.key("Pressed"), "false", "as in the original software")
    if not element.has("Trigger"):
        element.missing("Trigger", ", ".join(_TRIGGERS))
    pressed, released = element.word(_TRIGGERS, "Trigger") or (False, False)
    row |= {"trigger_when_pressed": pressed, "trigger_when_released": released}
    if element.has("SkipFirstRun"):
        row["skip_first_run"] = bool(element.word(_FLAGS, "SkipFirstRun"))
    debounce = _duration(element, "Debounce")
    row["debounce_time"] = debounce
    if element.has("DebounceClick"):
        click = _duration(element, "DebounceClick")
        if click > debounce:
            allowed = f"up to Debounce ({number_text(debounce)})"
            report.error(element.line, element.key("DebounceClick"), number_text(click), "out of range", allowed)
        row["debounce_time_click"] = click
    elif debounce:
        row["debounce_time_click"] = round(_CLICK * debounce, 9)
        why = f"{_CLICK} of Debounce, as in the original software; left out it would be 0 today"
        new = number_text(_CLICK * debounce, "s")
        report.defaulted(element.line, element.key("DebounceClick"), new, why)
    return row


def digital_output(element: Element) -> Json:
    """One `DigitalOut`."""
    row = _place(element)
    for old, new in (("HighDuration", "high_duration"), ("LowDuration", "low_duration")):
        if element.has(old):
            row[new] = _duration(element, old)
    frequency = element.has("Frequency")
    row["is_PWM"] = frequency
    if frequency:
        row["PWM_frequency"] = _duration(element, "Frequency")
    return row


def dallas_chip(element: Element) -> Json:
    """One `DallasChip`."""
    return {"name": name_of(element), "board_id": _board(element)}


def _place(element: Element) -> Json:
    bit = element.integer("BitId", "BitID", most=_MAX_BITS - 1)
    return {"name": name_of(element), "board_id": _board(element), "bit_id": bit}


def _board(element: Element) -> int:
    return element.integer("BoardId", "BoardID", most=_MAX_BOARDS - 1)


def name_of(element: Element) -> str:
    """Its name, as it is called today."""
    old = element.text("Name")
    name = today(old)
    if name != old:
        element.report.converted(element.line, element.key("Name"), old, name, "today's name")
    return name


def _duration(element: Element, name: str) -> float:
    value = element.number(name, default=0.0)
    if value < 0.0:
        element.report.error(element.line, element.key(name), number_text(value), "out of range", "a number from 0")
    return value
