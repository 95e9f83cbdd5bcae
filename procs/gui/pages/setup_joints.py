"""The page SUJ: setup joints of a patient cart, their brakes, poses and potentiometers; KINEMATIC ones are placed."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.cart import FIXED, SI, Cart, CartArm
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import arg, box, button, choice, columns, form, head, hold, live, switch, units
from trocar.procs.gui.pages.poses import TURNS

EXTRA: Final = ("spare 1", "spare 2", "brakes", "ground")


def carts_page(document: SystemConfig) -> None:
    """Its content."""
    script("forms.js")
    for cart in document.carts:
        _cart(cart)
        with box("cards"):
            for place, arm in enumerate(cart.arms):
                _arm(cart, place, arm)


def _cart(cart: Cart) -> None:
    name, state = cart.name, record(cart.name)
    with box("card", data_source=state):
        simulation = ", KINEMATIC" if cart.simulation == "KINEMATIC" else ""
        with head("h2", "title", name, kind=f"setup joints, {cart.kind}{simulation}"):
            units()
            live(f"{state}.state", classes="chip", data_tone="")
        live(f"{state}.reason", tag="p", classes="reason", data_show=f"{state}.reason")
        with box("row"):
            button("Enable", [[(name, "state_command", [], "enable")]], confirm=f"Enable {name}? It gets power.")
            button("Home", [[(name, "state_command", [], "home")]], confirm=f"Home {name}? It gets power.")
            button("Disable", [[(name, "state_command", [], "disable")]], "quiet")
            if cart.simulation != "KINEMATIC" and any(arm.lifts for arm in cart.arms):
                Part("span", "quiet", "Lift, while held:")
                hold("Up", (name, "set_lift_velocity", [1], ""), (name, "set_lift_velocity", [0], ""), every_ms=250)
                hold("Down", (name, "set_lift_velocity", [-1], ""), (name, "set_lift_velocity", [0], ""), every_ms=250)
            box("spacer")
            Part("span", "quiet", "base frames relative to")
            live(f"{state}.reference_arm")
            with form(name, "set_reference_arm", "", "row"):
                choice(((arm.name, arm.name) for arm in cart.arms), data_word="", aria_label="Reference arm")
                Part("button", "commands", "Set", type="button", data_submit="",
                     data_confirm="Use another reference arm? Teleoperations that follow in these base frames stop.")


def _arm(cart: Cart, place: int, arm: CartArm) -> None:
    state = record(cart.name)
    with box("card", data_source=state, id=f"setup-{arm.name}"):
        head("h2", "", arm.name, kind=f"carries {arm.carries}" if arm.carries else "carries nothing")
        with box("row facts"):
            Part("span", "light", "position known", data_on=f"{state}.setup_valid.{place}")
            Part("span", "light", "base frame known", data_on=f"{state}.base_valid.{place}")
            Part("span", "light busy", "clutched", data_on=f"{state}.clutched.{place}")
            if cart.kind != FIXED and cart.simulation != "KINEMATIC":
                switch("Clutch", f"{state}.clutched.{place}", [[(cart.name, "clutch", [1], arm.name)]],
                       [[(cart.name, "clutch", [0], arm.name)]],
                       confirm=f"Release the brakes of setup arm {arm.name}? Hold it: it may sink.")
                with Part("span", "quiet"):
                    Part("span", "", "brakes ")
                    live(f"{state}.brake_current.{place}", "num:2")
                    Part("span", "unit", "A")
        if arm.joints:
            _joints(cart, place, arm, state)
        _pose(f"{state}.local_measured_cp.{place}", f"{state}.setup_valid.{place}", "in the cart")
        _pose(f"{state}.measured_cp.{place}", f"{state}.base_valid.{place}", "", f"{state}.reference_frame.{place}")


def _joints(cart: Cart, place: int, arm: CartArm, state: str) -> None:
    is_kinematic = cart.simulation == "KINEMATIC" and cart.kind != FIXED
    has_pots = cart.kind != FIXED and cart.simulation != "KINEMATIC"
    unit = "counts" if cart.kind == SI else "V"
    titles = ["", "position", *([f"primary {unit}", f"secondary {unit}"] if has_pots else []),
              *(["set to"] if is_kinematic else [])]
    with form(cart.name, "servo_jp", arm.name), box("scroll"), Part("table", "joints setup"):
        columns(titles)
        with Part("tbody"):
            for i in range(arm.joints):
                _joint(state, place, i, has_pots=has_pots, is_kinematic=is_kinematic)
        if is_kinematic:
            with Part("tfoot"), Part("tr"), Part("td", "", colspan=str(len(titles))):
                Part("button", "quiet", "Read", type="button", data_reads="", title="Use the present position")
                Part("button", "commands", "Set position", type="button", data_submit="",
                     data_confirm=f"Set setup arm {arm.name} to this position? {arm.carries or 'Its load'} moves too.")
    if has_pots and cart.kind != SI:
        with box("row quiet"):
            for i, text in enumerate(EXTRA):
                with Part("span"):
                    Part("span", "", f"{text} ")
                    live(f"{state}.extra_voltage.{place}.{i}", "num:2")
                    Part("span", "unit", "V")


def _joint(state: str, place: int, i: int, *, has_pots: bool, is_kinematic: bool) -> None:
    """The row of joint `i` of the setup arm at `place`."""
    kind, known = "r" if i else "p", f"{state}.setup_valid.{place}"
    with Part("tr"):
        Part("td", "", f"joint {i}")
        with Part("td"):
            live(f"{state}.position.{place}.{i}", f"joint:{kind}", data_valid=known)
            Part("span", "unit", data_unit=kind)
        for field in ("primary_voltage", "secondary_voltage") if has_pots else ():
            with Part("td"):
                live(f"{state}.{field}.{place}.{i}", "num:3")
        if is_kinematic:
            with Part("td"):
                arg("input", f"joint-{kind}", size="8", inputmode="decimal", aria_label=f"Joint {i}",
                    data_now=f"{state}.position.{place}.{i}", data_valid=known)


def _pose(path: str, valid: str, text: str, frame: str = "") -> None:
    with box("pose"):
        with Part("span", "quiet"):
            Part("span", "", text or "in ")
            if frame:
                live(frame)
        with Part("span", data_show=valid):
            for i in range(3):
                live(f"{path}.{i}", "mm:1", "figure")
            Part("span", "unit", "mm")
        with Part("span", data_show=valid, title=TURNS):
            for i in range(3):
                live(path, f"turn:{i}", "figure")
            Part("span", "unit", "°")
        Part("span", "quiet", "not known", data_show=f"!{valid}")
