"""Parts of pages: elements that show live data, and buttons that command, by attributes that `live.js` understands.

`data-live`: the value to show, `SOURCE.field.index`, `data-format`: its format. `data-show`, `data-on`: shown, or lit,
while the condition is true (`PSM1/state.state=FAULT`, `!…`, `…>3`). `data-source`: grey, with its age in `.age`, while
that source is old. `data-valid`: numbers in it are shown while that field is true. `data-steps`: commands of a button,
steps one after the other; `data-free`: allowed without control, `data-confirm`: confirm first. With `forms.js` on the
page: switches and forms.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, Final

from trocar.procs.gui.pages.element import Part
from trocar.shm.commands import can_stop

Call = tuple[str, str, Sequence[float], str]
"""To whom, command, values, text."""
EFFECTS: Final = {"enable": "Amplifiers switch on.", "home": "It moves.",
                  "resume": "It resumes what it was doing, and may move."}
"""Of words of `state_command` on an arm, as the confirmation says."""


def box(classes: str = "", **attributes: Any) -> Part:
    """A div."""
    return Part("div", classes, **attributes)


def live(path: str, form: str = "text", classes: str = "", tag: str = "span", **attributes: Any) -> Part:
    """A value that is kept up to date."""
    return Part(tag, f"live {classes}".strip(), data_live=path, data_format=form, **attributes)


def head(tag: str, classes: str, title: str, *, kind: str = "", has_age: bool = True, **attributes: Any) -> Part:
    """The head of a card; elements made in it are placed at its right end. `kind`: the kind of thing in the title."""
    row = box("row head")
    with row:
        Part(tag, classes, title, **attributes)
        if kind:
            Part("span", "kind", kind)
        box("spacer")
        if has_age:
            Part("span", "age")
    return row


def columns(titles: Sequence[str]) -> None:
    """The head of a table."""
    with Part("thead"), Part("tr"):
        for title in titles:
            Part("th" if title else "td", "", title)


def choice(options: Iterable[tuple[str, str]], **attributes: Any) -> None:
    """One of several options: value and text of each."""
    with Part("select", **attributes):
        for value, text in options:
            Part("option", "", text, value=value)


def units() -> None:
    """Numbers of the page in degrees and mm, or in rad and m."""
    Part("button", "quiet", "° mm / rad m", type="button", data_does="units", title="Other units")


def reason(arm: str, state: str) -> None:
    """Reason for an arm's state; after a fault with the remedy."""
    with box("fault", data_show=f"{state}.state=FAULT"):
        live(f"{state}.reason", tag="p")
        Part("p", "remedy", data_remedy=arm)
    with box("reason", data_show=f"!{state}.state=FAULT"):
        live(f"{state}.reason", tag="p", data_show=f"{state}.reason")


def teleop_reason(state: str) -> None:
    """Why a teleoperation does not follow; once it is DISABLED, why it stopped."""
    with box(data_show=f"!{state}.state=DISABLED"):
        live(f"{state}.reason", tag="p", classes="reason", data_show=f"{state}.reason")
    with box("quiet", data_show=f"{state}.state=DISABLED"), Part("p", data_show=f"{state}.reason"):
        Part("span", "", "Last stop: ")
        live(f"{state}.reason")


def button(text: str, steps: Sequence[Sequence[Call]], classes: str = "", *, confirm: str = "",
           **attributes: Any) -> Part:
    """A command button; buttons that only stop something work from every page, without control."""
    is_free = all(can_stop(command, text, values) for step in steps for _, command, values, text in step)
    if is_free:
        attributes["data_free"] = ""
    if confirm:
        attributes["data_confirm"] = confirm
    classes = classes if is_free else f"{classes} commands".strip()
    return Part("button", classes, text, type="button", data_steps=json.dumps(steps), **attributes)


def state_buttons(name: str, *words: str, ends: Sequence[str] = ("disable",), is_cart: bool = False) -> None:
    """Buttons for words of `state_command` of an arm, or of the setup joints of a cart, and for those that end it."""
    with box("row buttons"):
        for word in words:
            effect = "It gets power." if is_cart else EFFECTS.get(word, "")
            button(word.capitalize(), [[(name, "state_command", [], word)]],
                   confirm=f"{word.capitalize()} {name}? {effect}" if effect else "")
        box("spacer")
        if not is_cart:
            button("Hold", [[(name, "hold", [], "")]], "quiet", title="Stay where it is")
        for word in ends:
            button(word.capitalize(), [[(name, "state_command", [], word)]], "quiet")


def switch(text: str, path: str, on: Sequence[Sequence[Call]], off: Sequence[Sequence[Call]], *, confirm: str = "",
           confirm_off: str = "", **attributes: Any) -> Part:
    """A button that shows whether something is on, and commands the opposite; `confirm`: text before switching on."""
    return Part("button", "switch commands", text, type="button", data_on=path, data_switch=path,
                data_steps_on=json.dumps(on), data_steps_off=json.dumps(off), data_confirm_on=confirm,
                data_confirm_off=confirm_off, **attributes)


def form(to: str, command: str, text: str, classes: str = "", **attributes: Any) -> Part:
    """Inputs (`arg`) and a button (`data-submit`) that sends their values with a command."""
    return box(classes, data_form=json.dumps([to, command, text]), **attributes)


def arg(tag: str, kind: str, **attributes: Any) -> Part:
    """A value of a form: "choice" of a select, "num", "deg", "mm", of a prismatic ("joint-p") or revolute ("joint-r")
    joint, or "joint": by the type of the chosen one.

    `data_now`: the value that *Read* (`data-reads`) takes, with `data_valid` while that field is true. `data_low`,
    `data_high`: the allowed range, in units as typed.
    """
    return Part(tag, "", data_arg=kind, **attributes)


def hold(text: str, call: Call, release: Call, *, every_ms: int = 0, **attributes: Any) -> Part:
    """A button that commands while it is held, every `every_ms`, and sends `release` when it is released."""
    if every_ms:
        attributes["data_every"] = str(every_ms)
    return Part("button", "hold commands", text, type="button", data_hold=json.dumps(call),
                data_release=json.dumps(release), **attributes)
