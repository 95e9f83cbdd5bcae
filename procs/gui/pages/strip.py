"""The strip of every page: arms, alarms, control, the next step, Stop and Power off, always in the same places."""

from __future__ import annotations

from typing import Any, Final

from trocar.procs.document.process import CALIBRATION_MODE
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import ALARMS, STRIP
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import Call, box, button

POWER_ON_ASKS: Final = "Amplifiers switch on."
HOME_ASKS: Final = "They move. Keep hands and tissue away."


def moving(document: SystemConfig) -> list[str]:
    """Instances that can be powered: arms and carts."""
    return [row.name for rows in (document.arms, document.carts) for row in rows]


def power_off(document: SystemConfig) -> list[list[Call]]:
    """Power off everything; steps of a button."""
    if document.consoles:
        return [[("system", "power_off", [], "")]]
    return [[(name, "state_command", [], "disable") for name in moving(document)]]


def power_on(document: SystemConfig) -> list[list[Call]]:
    """Power on everything."""
    if document.consoles:
        return [[("system", "power_on", [], "")]]
    return [[(name, "state_command", [], "enable") for name in moving(document)]]


def home(document: SystemConfig) -> list[list[Call]]:
    """Power on and home everything."""
    if document.consoles:
        return [[("system", "home", [], "")]]
    return [*power_on(document), [(name, "state_command", [], "home") for name in moving(document)]]


def stop(document: SystemConfig) -> list[list[Call]]:
    """Stop all motion, and what would begin one; power stays. To all arms, whatever a page shows of them."""
    calls: list[Call] = [("system", "hold", [], "")] if document.consoles else []
    calls += [(row.name, "teleop_enable", [0], "") for row in document.consoles]
    calls += [(row.name, command, [0], "") for row in document.focuses for command in ("focus_in", "focus_out")]
    return [[*calls, *((row.name, "hold", [], "") for row in document.arms)]]


def ends(document: SystemConfig) -> dict[str, list[list[Call]]]:
    """Steps of the buttons that end something; the server sends them to each page, whatever system that was made of."""
    return {"stop": stop(document), "power_off": power_off(document)}


def teleop_calls(name: str, on: int) -> list[list[Call]]:
    """Start or stop the teleoperations of a console."""
    return [[(name, "teleop_enable", [on], "")]]


def power_button(document: SystemConfig, which: str, classes: str = "", **attributes: Any) -> None:
    """`which`: "power-on" or "home", of everything. The question names the arms, as they are then (strip.js)."""
    is_home = which == "home"
    button("Home" if is_home else "Power on", home(document) if is_home else power_on(document), classes,
           title="Ctrl + H" if is_home else "Ctrl + P", data_asks=which,
           confirm=f"Home all arms? {HOME_ASKS}" if is_home else f"Power on all arms? {POWER_ON_ASKS}", **attributes)


def strip(document: SystemConfig) -> None:
    """Its content."""
    with Part("section", "strip", aria_label="State of the robot, and stop", data_present=True,
              data_wants=f"{STRIP} {ALARMS}"):
        with Part("ul", "chips", aria_label="Arms"):
            for row in document.arms:
                _chip(row.name, f"/arm/{row.name}")
            for cart in document.carts:
                _chip(cart.name, "/suj")
        with box("now"):
            Part("button", "alarms", "– alarms", type="button", id="alarms", aria_expanded="false",
                 aria_controls="alarm-list")
            Part("span", "clock", id="clock")
        with box("who"):
            Part("span", "holder", id="holder", role="status")
            Part("button", "control", "Take control", type="button", id="control")
        _next(document)
        with box("ends"):
            button("Stop", stop(document), "stop", id="stop", disabled=True,  # until a script heeds it
                   title="Ctrl + S. Teleoperation ends, arms hold their places, power stays. Works without control.")
            button("Power off", power_off(document), "danger", id="power-off", disabled=True,
                   title="Ctrl + O. Works from every page, without control. It is no emergency stop.")
        with box("offline", id="offline", hidden=True):
            Part("span", "lost", role="alert")
            Part("span", "since", aria_hidden="true")  # it changes each second
        _alarm_list()
    if any(io.calibration_mode for io in document.ios):
        with Part("p", "calibration", role="note"):
            Part("b", "", "calibration mode", title=CALIBRATION_MODE)
            Part("span", "", f": {CALIBRATION_MODE.partition(': ')[2]}")
    for name in ("announced", "alarmed"):
        Part("p", "unseen", id=name, aria_live="assertive" if name == "alarmed" else "polite")


def _chip(name: str, href: str) -> None:
    """One arm; its word and icon are given by strip.js."""
    with Part("li"), Part("a", "armchip", href=href, data_arm_chip=name, data_word="no data"):
        Part("span", "icon", "?", aria_hidden="true")
        Part("b", "", name)
        Part("span", "word", "no data")


def _next(document: SystemConfig) -> None:
    """The next step: one of these buttons at a time, at the same place."""
    with box("next", id="next"):
        power_button(document, "power-on", "step", id="power-on", data_step="power-on")
        power_button(document, "home", "step", id="home", hidden=True, data_step="home")
        button("Resume", [[(name, "state_command", [], "resume") for name in moving(document)]], "step", id="resume",
               hidden=True, data_step="resume", data_asks="resume", confirm="Resume all arms?")  # strip.js: the paused
        for console in document.consoles[:1]:
            button("Start teleoperation", teleop_calls(console.name, 1), "step", id="start-teleop", hidden=True,
                   title="Ctrl + T, or Alt + T", data_step="teleop", data_console=console.name,
                   confirm="Start teleoperation? Masters move to align.")
        Part("span", "step none", "Ready", data_step="none", hidden=True)


def _alarm_list() -> None:
    with Part("section", "alarm-list", id="alarm-list", aria_label="Alarms", hidden=True):
        with box("row head"):
            Part("h2", "", "Alarms")
            box("spacer")
            Part("button", "quiet", "Sound is off", type="button", id="sound", aria_pressed="false")
            Part("button", "", "Acknowledge all", type="button", data_acknowledge="")
        box("list", id="alarm-rows", tabindex="0")
