"""The page Plots: any numbers of any records, several at once."""

from __future__ import annotations

import itertools
import re
from typing import Any, Final

from trocar.procs.crtk.field_paths import indices_text
from trocar.procs.crtk.topics import RECORD, catalogue
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.gate import FILES
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box

TOPICS: Final = f"{FILES}topics"
"""Address of the records: the page requests them, because they are known only while their processes run."""
SPANS: Final = (5, 10, 30, 60)
SHAPE: Final = re.compile(r"^\(([\d,]*)\)")
HIDDEN: Final = frozenset({"events", "audit", "setpoint"})
"""Rings that are no records of values, or repeat them."""


def plots_page(document: SystemConfig) -> None:
    """Its content."""
    script("plots.js")
    first = f"{document.arms[0].name}/state" if document.arms else ""
    with box("card wide plots", data_topics=TOPICS, data_first=first):
        with box("row"):
            Part("select", id="plot-topic", aria_label="Record")
            Part("select", id="plot-field", aria_label="Field")
            Part("select", id="plot-index", aria_label="Number")
            Part("button", "primary", "Add", type="button", data_plot="add")
            box("spacer")
            with Part("select", id="plot-span", aria_label="Seconds"):
                for span in SPANS:
                    attributes = {"selected": ""} if span == SPANS[1] else {}
                    Part("option", "", f"{span} s", value=str(span), **attributes)
            for text, does in (("Pause", "pause"), ("Whole", "whole"), ("CSV", "csv"), ("PNG", "png")):
                Part("button", "", text, type="button", data_plot=does)
        box("row legend", id="plot-legend")
        Part("canvas", "plot", id="plot")
        Part("p", "quiet", "Paused: drag to zoom, double click for all. Signals that no page shows are not recorded.")


def topics_of(system: str) -> dict[str, list[list[Any]]]:
    """Records with their numbers: name, unit, the indices of each as in a field path, description."""
    found: dict[str, list[list[Any]]] = {}
    for entry in catalogue(system):
        if entry.kind != RECORD or entry.ring in HIDDEN or entry.problem or not entry.rate_hz:
            continue
        rows = []
        for field in entry.fields:
            shape = SHAPE.match(field.dtype)
            sizes = [int(size) for size in shape.group(1).split(",") if size] if shape else []
            indices = [indices_text(place) for place in itertools.product(*map(range, sizes))]
            if "S" not in field.dtype and indices and field.name not in ("sequence", "stamp_ns"):
                rows.append([field.name, field.unit, indices, field.text])
        found[entry.name] = rows
    return found
