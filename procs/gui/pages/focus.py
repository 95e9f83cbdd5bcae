"""The page Focus: the lens of an endoscope."""

from __future__ import annotations

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, head, hold, switch


def focus_page(document: SystemConfig) -> None:
    """Its content."""
    script("forms.js")
    with box("cards"):
        for focus in document.focuses:
            state = record(focus.name)
            with box("card", data_source=state):
                head("h2", "title", focus.name, kind=f"focus, moved by {', '.join(focus.outputs)} of {focus.io}")
                with box("row facts"):
                    Part("span", "light", "moves in", data_on=f"{state}.focusing.0")
                    Part("span", "light", "moves out", data_on=f"{state}.focusing.1")
                    Part("span", "light busy", "locked", data_on=f"{state}.locked")
                    with Part("span", "light alarm", data_on=f"!{state}.valid", data_show=f"!{state}.valid"):
                        Part("span", "", f"no data from {focus.io}")
                with box("row"):
                    for text, command in (("In", "focus_in"), ("Out", "focus_out")):
                        hold(text, (focus.name, command, [1], ""), (focus.name, command, [0], ""),
                             id=f"{focus.name}-{command}")
                    switch("Lock", f"{state}.locked", [[(focus.name, "lock", [1], "")]],
                           [[(focus.name, "lock", [0], "")]], id=f"{focus.name}-lock")
                pedals = ", ".join(wired.name for wired in focus.pedals)
                Part("p", "quiet", "It moves while a button is held, 10 s at most. "
                                   + (f"Pedals: {pedals}." if pedals else "It has no pedals."))
