"""The page System: all arms, power and homing, teleoperations, and messages of processes."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import MESSAGES, record
from trocar.procs.gui.pages.console import PEDALS, teleop_buttons
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, button, choice, head, live, reason, state_buttons, teleop_reason
from trocar.procs.gui.pages.strip import moving, power_button

SAID_ALREADY: Final = "HOMED|DISABLED|ENABLED|FAULT"
"""Sub-states that chip and light show too."""


VOLUMES: Final = (0.0, 0.25, 0.5, 1.0)


def system_page(document: SystemConfig) -> None:
    """Its content."""
    with box("columns"):
        with box():
            with Part("section", "arms"):
                for arm in document.arms:
                    arm_card(arm)
                for cart in document.carts:
                    cart_card(cart.name)
            messages_card(document)
        with Part("aside"):
            _first_steps(document)
            _power(document)
            for console in document.consoles:
                _console(console.name, [row.name for rows in (document.teleop_psms, document.teleop_ecms)
                                        for row in rows if row.console == console.name])


def arm_card(arm: ArmConfig) -> None:
    """One arm: its type, pending conditions, problem, and buttons."""
    state = record(arm.name)
    with box("card", data_source=state, id=f"arm-{arm.name}"):
        with head("a", "title", arm.name, kind=f"{arm.type} {arm.generation}", href=f"/arm/{arm.name}"):
            live(f"{state}.state", classes="chip", data_tone="")
        with box("row facts"):
            Part("span", "light", "homed", data_on=f"{state}.is_homed")
            Part("span", "light", "busy", data_on=f"{state}.is_busy")
            live(f"{state}.sub_state", classes="quiet", data_show=f"!{state}.sub_state={SAID_ALREADY}")
            live(f"{state}.tool", classes="quiet tool", data_show=f"{state}.tool")
        reason(arm.name, state)
        state_buttons(arm.name, "enable", "home")


def cart_card(name: str) -> None:
    """Setup joints."""
    state = record(name)
    with box("card", data_source=state):
        with head("span", "title", name, kind="setup joints"):
            live(f"{state}.state", classes="chip", data_tone="")
        live(f"{state}.reason", tag="p", classes="reason", data_show=f"{state}.reason")
        state_buttons(name, "enable", is_cart=True)


def _first_steps(document: SystemConfig) -> None:
    """First steps, completed ones in green; hidden once a slave follows, or when closed."""
    arms = [record(name) for name in moving(document)]
    steps = [("Take control", "first-control", []),
             ("Power on all arms", "", [f"{arm}.state=ENABLED" for arm in arms]),
             ("Home them: they move", "", [f"{arm}.is_homed" for arm in arms])]
    psm = next((record(row.name) for row in document.arms if row.type == "PSM"), "")
    if psm:
        steps.append(("Insert an instrument", "", [f"{psm}.tool"]))
    over = ""
    if document.consoles and document.teleop_psms:
        console, teleop = record(document.consoles[0].name), record(document.teleop_psms[0].name)
        steps += [("Start teleoperation", "", [f"{console}.teleop_enabled"]),
                  ("Sit down; without pedals: Console, press operator", "", [f"{console}.operator_present"]),
                  ("Move the master: the slave follows", "", [f"{teleop}.following"])]
        over = f"!{teleop}.following"
    with box("card first", id="first-steps", **({"data_show": over} if over else {})):
        with head("h2", "", "First steps", has_age=False):
            Part("button", "quiet", "×", type="button", data_does="dismiss", aria_label="Close")
        with Part("ol"):
            for text, classes, conditions in steps:
                with Part("li", classes):
                    Part("span", "", text)
                    for condition in conditions:  # done when all of them are so
                        Part("i", "mark", data_on=condition)


def _power(document: SystemConfig) -> None:
    with box("card"):
        Part("h2", "", "All arms")
        with box("row buttons"):
            power_button(document, "power-on")
            power_button(document, "home")
        if document.consoles:
            state = record("system")
            live(f"{state}.waiting", tag="p", classes="reason", data_show=f"{state}.waiting")
            with box("row"):
                Part("span", "quiet", "Volume")
                for volume in VOLUMES:
                    button(f"{volume:.0%}", [[("system", "set_volume", [volume], "")]], "small",
                           data_on=f"{state}.volume={volume:g}")


def _console(name: str, teleops: list[str]) -> None:
    state = record(name)
    with box("card", data_source=state):
        head("span", "title", name)
        with box("row facts"):
            for text, field, _ in PEDALS:
                Part("span", "light", text, data_on=f"{state}.{field}")
        for teleop in teleops:
            teleop_row(teleop)
        with box("row buttons"):
            teleop_buttons(name)


def teleop_row(name: str) -> None:
    """One teleoperation in a line, with its pending conditions below."""
    state = record(name)
    with box("teleop", data_source=state):
        with box("row"):
            Part("b", "", name)
            box("spacer")
            Part("span", "light", "following", data_on=f"{state}.following")
            live(f"{state}.state", classes="chip small", data_tone="")
        teleop_reason(state)


def messages_card(document: SystemConfig) -> None:
    """Messages of all processes, by severity and process."""
    with box("card messages", data_source=MESSAGES):
        with head("h2", "", "Messages", has_age=False):
            choice((("status", "all"), ("warning", "warnings and errors"), ("error", "errors")), id="severity",
                   aria_label="At least")
            choice((("", "all processes"), *((row.name, row.name) for row in document.processes)), id="from",
                   aria_label="From")
        box("list", id="messages")
