"""The page Processes: who runs, how often, how much they use, and how they last ended."""

from __future__ import annotations

from typing import Final

from procs.gui.catalogue import PROCESSES
from procs.gui.pages.parts import Part, box

COLUMNS: Final = ("process", "kind", "state", "Hz", "period p99 ms", "work p99 ms", "missed", "CPU %", "MB", "restarts",
                  "last ended, or scheduling")


def processes_page() -> None:
    """Its content."""
    with box("card wide", data_source=PROCESSES):
        with box("row head"):
            Part("h2", "", "Processes")
            box("spacer")
            Part("span", "age")
        with box("scroll"), Part("table", "processes"):
            with Part("thead"), Part("tr"):
                for column in COLUMNS:
                    Part("th", "", column)
            Part("tbody", id="processes")
