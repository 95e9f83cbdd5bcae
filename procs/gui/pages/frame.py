"""Common parts of all pages: the bar with navigation, control and Power off, dialogs, style and script."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from trocar.procs.document.process import CALIBRATION_MODE
from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.gui.catalogue import TIMELINE
from trocar.procs.gui.pages.assets import assets, script
from trocar.procs.gui.pages.buttons import has_buttons
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import Call, box, button
from trocar.procs.gui.robots import robots_of, with_actuators, with_gains

KEYS: Final = (("Ctrl + O", "power off"), ("Ctrl + P", "power on"), ("Ctrl + H", "home"), ("?", "this list"))
STEPS: Final = ("Take control, top right: until then this page is read-only.",
                "Power on, then Home: arms move to be homed. Stand back.",
                "Insert an instrument; the emulated robot of the demo has one.",
                "Enable teleoperation, press the pedal, pinch the master: the instrument follows.")


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


def power_buttons(document: SystemConfig, **attributes: Any) -> None:
    """Power on and home everything: the buttons that Ctrl + P and Ctrl + H press."""
    button("Power on", power_on(document), "primary", id="power-on", title="Ctrl + P",
           confirm="Power on all arms? Amplifiers switch on.", **attributes)
    button("Home", home(document), "primary", id="home", title="Ctrl + H",
           confirm="Home all arms? They move. Keep hands and tissue away.", **attributes)


def pages_of(document: SystemConfig) -> list[tuple[str, str]]:
    """Name and path of each page."""
    found = [("System", "/"), ("3D", "/3d")]
    found += [(arm.name, f"/arm/{arm.name}") for arm in document.arms]
    if document.consoles:
        found.append(("Console", "/console"))
    if document.teleop_psms or document.teleop_ecms:
        found.append(("Teleoperation", "/teleop"))
    robots = robots_of(document)
    for name, path, rows in (("IO", "/io", with_actuators(robots)), ("PID", "/pid", with_gains(robots)),
                             ("Buttons", "/buttons", has_buttons(document)), ("SUJ", "/suj", document.carts),
                             ("Focus", "/focus", document.focuses)):
        if rows:
            found.append((name, path))
    return [*found, ("Plots", "/plots"), ("Processes", "/processes")]


@contextmanager
def page(document: SystemConfig, here: str, wants: Sequence[str] = ()) -> Iterator[Part]:
    """A page at this path; elements made inside are its content."""
    with Part("html", lang="en") as whole:
        _head(document, here)
        with Part("body"):
            _bar(document, here)
            with Part("main", "content", data_wants=" ".join(wants)):
                yield whole
            _timeline()
            _dialogs()


def absent_page() -> None:
    """Content for paths without a page."""
    with box("card"):
        Part("h2", "", "There is no such page")
        Part("p", "quiet", "The bar above lists the pages of this system.")


def _head(document: SystemConfig, here: str) -> None:
    title = next((name for name, path in pages_of(document) if _is_at(here, path)), "No such page")
    with Part("head"):
        Part("meta", charset="utf-8")
        Part("meta", name="viewport", content="width=device-width, initial-scale=1")
        Part("title", "", f"{title} · {document.name} · Trocar")
        Part("link", rel="icon", href=f"{assets()}/icon.svg")
        Part("link", rel="stylesheet", href=f"{assets()}/style.css")
        script("live.js")
        script("timeline.js")


def _is_at(here: str, path: str) -> bool:
    """Whether the page `here` belongs to the link to `path`: pages of robots are below it."""
    return here == path or here.startswith(f"{path}/")


def _bar(document: SystemConfig, here: str) -> None:
    with Part("header", "bar", data_present=True):
        Part("a", "brand", "Trocar", href="/")
        Part("span", "system", document.name, title=document.source)
        with Part("nav"):
            for name, path in pages_of(document):
                Part("a", "here" if _is_at(here, path) else "", name, href=path)
        box("spacer")
        if any(io.calibration_mode for io in document.ios):
            Part("span", "badge warns", "calibration mode", title=CALIBRATION_MODE, role="status")
        if document.clock != WALL:
            Part("span", "badge", "simulated time", title="Boards are emulated, or arms have no robot")
        Part("span", "lost", "not connected", role="status")
        Part("button", "warns", "Load the new page", type="button", id="reload", hidden=True)
        Part("button", "warns", type="button", id="control-lost", role="alert", hidden=True, title="Hide this")
        Part("button", "quiet", "?", type="button", data_opens="help", title="Keys and first steps (?)")
        Part("button", "quiet", "◐", type="button", data_does="theme", title="Dark or light", aria_label="Theme")
        Part("button", "control", "Take control", type="button", id="control")
        button("Power off", power_off(document), "danger", id="power-off", disabled=True,  # until a script heeds it
               title="Ctrl + O. Works from every page, without control. It is no emergency stop.")
        if here != "/":  # which shows them
            power_buttons(document, hidden=True)
        _past()


def _past() -> None:
    """The words of a page that shows the past."""
    with box("past", id="past", hidden=True):
        Part("b", "", "THE PAST", role="status")
        Part("b", id="past-when")
        Part("span", id="past-clock")
        Part("span", "what", id="past-what")
        Part("b", "news", id="past-news", role="alert")
        box("spacer")
        Part("a", "button", id="past-file", download=True, hidden=True)
        Part("button", "", "Return to live", type="button", id="past-live")


def _timeline() -> None:
    """The bar of times; it always shows the present's."""
    with Part("footer", "timeline", id="timeline", data_present=True, data_wants=TIMELINE, aria_label="Timeline"):
        Part("button", "on", "Live", type="button", id="live", title="The present (End)")
        Part("span", "quiet", id="time-begin")
        with box("track"):
            Part("input", type="range", id="time", min="-2", max="0", step="any", value="0", aria_label="Time shown",
                 title="Arrows 1 s, with Shift 0.1 s; Page keys 10 s; Home the oldest, End live")
            box("marks", id="time-marks", aria_hidden="true")
        Part("output", "", id="time-shown", for_="time")
        box("scroll", id="faults", role="group", aria_label="Faults: press to see the moment before")


def _dialogs() -> None:
    with Part("dialog", id="confirm"), Part("form", method="dialog"):
        Part("p", id="confirm-text")
        with box("row end"):
            Part("button", "quiet", "Cancel", value="")
            Part("button", "primary", "Yes", value="yes")
    with Part("dialog", id="help"), Part("form", method="dialog"):
        Part("h2", "", "First steps")
        with Part("ol"):
            for step in STEPS:
                Part("li", "", step)
        Part("h2", "", "Keys")
        with Part("dl", "keys"):
            for key, does in KEYS:
                Part("dt", "", key)
                Part("dd", "", does)
        with box("row end"):
            Part("button", "primary", "Close", value="")
