"""The page Console, for the operator's place: pedals and head sensors, selection, common scale."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.consoles import Console, TeleopEcmConfig, TeleopPsmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, button, head, live, teleop_reason
from trocar.procs.gui.pages.strip import teleop_calls

PEDALS: Final = (("operator", "operator_present", "emulate_operator_present"), ("clutch", "clutch", "emulate_clutch"),
                 ("camera", "camera", "emulate_camera"))
"""Label, its field in the record of a console, and the command that emulates the input."""
RELEASED: Final = {"clutch": "Act as if the clutch were released? Slaves follow again.",
                   "camera": "Act as if the camera pedal were released? Masters may move to align."}
"""Confirmation before the command causes motion; an absent operator stops all."""
SCALES: Final = tuple(tenths / 10 for tenths in range(1, 11))


def console_page(document: SystemConfig) -> None:
    """Its content."""
    in_record: tuple[TeleopPsmConfig | TeleopEcmConfig, ...] = (*document.teleop_ecms, *document.teleop_psms)
    for console in document.consoles:
        _console(console, [row.name for row in in_record if row.console == console.name])


def teleop_buttons(name: str) -> None:
    """Start and stop the teleoperations of a console."""
    button("Start teleoperation", teleop_calls(name, 1), id=f"start-{name}",
           confirm="Start teleoperation? Masters move to align.")
    button("Stop", teleop_calls(name, 0), "quiet")


def _console(console: Console, teleops: list[str]) -> None:
    """`teleops`: in the order of its record."""
    state, name = record(console.name), console.name
    with box("cards"):
        with box("card", data_source=state):
            with box("row head"):
                Part("span", "title", name)
                live(f"{state}.input_type", classes="kind")
                box("spacer")
                Part("span", "age")
                Part("span", "light", "teleoperation requested", data_on=f"{state}.teleop_enabled")
            for text, field, command in PEDALS:
                with box("row pedal"):
                    Part("span", "light", text, data_on=f"{state}.{field}")
                    box("spacer")
                    button("press", [[(name, command, [1], "")]], "small", id=f"{name}-{text}-press",
                           confirm=f"Act as if the {text} pedal or sensor were pressed, until it is released?")
                    button("release", [[(name, command, [0], "")]], "small", confirm=RELEASED.get(text, ""))
            Part("p", "quiet", "Press and release act as if, where there are no pedals.")
            with box("row"):
                Part("span", "quiet", "scale of all")
                live(f"{state}.scale", "num:2")
                for scale in SCALES:
                    button(f"{scale:g}", [[(name, "set_scale", [scale], "")]], "small",
                           data_on=f"{state}.scale={scale:g}")
            with box("row buttons"):
                teleop_buttons(name)
        with box("card", data_source=state):
            with head("h2", "", "Teleoperations", has_age=False):
                Part("span", "quiet", "those that share an arm take turns")
            for i, teleop in enumerate(teleops):
                _selected(name, teleop, f"{state}.selected.{i}")


def _selected(console: str, name: str, selected: str) -> None:
    """One teleoperation: whether it is selected, and how it is."""
    state = record(name)
    with box("teleop", data_source=state):
        with box("row"):
            button(name, [[(console, "select_teleop", [], name)]], "small", data_show=f"!{selected}",
                   title="Select it",
                   confirm=f"Select {name}? Where teleoperation is on, its master may move to align.")
            button(f"✓ {name}", [[(console, "unselect_teleop", [], name)]], "small on", data_show=selected,
                   title="Selected; press to unselect")
            box("spacer")
            Part("span", "light", "following", data_on=f"{state}.following")
            live(f"{state}.state", classes="chip small", data_tone="")
        teleop_reason(state)
