"""The page Processes: running processes, rates, resource use, last end, and logs."""

from __future__ import annotations

from typing import Final

from trocar.procs.gui.catalogue import PROCESSES
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, columns, head

COLUMNS: Final = ("process", "kind", "state", "Hz", "period p99 ms", "work p99 ms", "missed", "CPU %", "MB", "restarts",
                  "problem, last ended, or scheduling")


def processes_card() -> None:
    """A table of all processes."""
    script("processes.js")
    with box("card wide", data_source=PROCESSES):
        with box("row head"):
            Part("h2", "", "Processes")
            Part("span", "quiet", "Press a name to see its log.")
            box("spacer")
            Part("span", "age")
        with box("scroll"), Part("table", "processes"):
            columns(COLUMNS)
            Part("tbody", id="processes")


def processes_page() -> None:
    """Its content."""
    processes_card()
    with box("card wide", id="log-card", hidden=True):
        with head("h2", "", "Log", id="log-of"):
            Part("span", "quiet", "the newest 200 lines")
        box("list log", id="log")
