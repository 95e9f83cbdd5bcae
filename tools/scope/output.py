"""A capture as text, CSV, JSON and PNG. Times are in s from the moment; no record is made up or left out."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.machine.extras import missing
from trocar.tools.inspect.enumerations import in_words, words_of
from trocar.tools.output.columns import columns_file
from trocar.tools.output.errors import Problem
from trocar.tools.scope.capture import Capture, stamps_in_all
from trocar.tools.scope.drawing import axis_line, changes, plot_lines

MAX_CHANGES: Final = 12  # of a text or an enumeration that are printed


@dataclass(frozen=True, slots=True)
class Series:
    """One cell of a capture: its path, unit, stamps, ns, and values (numbers, or texts)."""

    label: str
    unit: str
    field: Any
    is_text: bool
    stamps: NDArray[np.int64]
    values: NDArray[Any]

    def seconds(self, moment_ns: int) -> NDArray[np.float64]:
        """Its stamps from the moment, s."""
        return np.asarray(self.stamps - moment_ns, np.float64) * 1e-9


def series_of(capture: Capture) -> Iterator[Series]:
    """Every cell, in the order of the requested fields."""
    for one in capture.scoped:
        rows = capture.rows[one.topic]
        for k, label in enumerate(one.cells.labels):
            yield Series(label, one.cells.field.unit, one.cells.field, one.cells.is_text, rows.stamps,
                         rows.columns[one.column][:, k])


def as_json(capture: Capture, condition: str, before_s: float, after_s: float) -> dict[str, Any]:
    """One document."""
    return {
        "condition": condition or None, "moment_ns": capture.moment_ns, "before_s": before_s, "after_s": after_s,
        "fields": [{"field": each.label, "unit": each.unit, "stamp_ns": each.stamps.tolist(),
                    "value": plain(each.values)} for each in series_of(capture)],
        "lost": lost(capture), "gaps": [{"topic": gap.topic, "stamp_ns": gap.stamp_ns, "lost": gap.lost}
                                        for gap in capture.gaps],
        "missing_before_s": capture.short, "missing_after_s": capture.unseen,
    }


def lost(capture: Capture) -> int:
    """Records in the window that are lost."""
    return sum(gap.lost for gap in capture.gaps)


def write_csv(capture: Capture, file: str) -> None:
    """A row for each stamp; empty if a ring has no record of that stamp."""
    every, stamps = list(series_of(capture)), stamps_in_all(capture)
    columns: list[list[Any]] = []
    for each in every:
        column: list[Any] = [None] * len(stamps)
        for place, value in zip(np.searchsorted(stamps, each.stamps).tolist(), plain(each.values), strict=True):
            column[place] = value
        columns.append(column)
    with columns_file(file, ["t_s", "stamp_ns", *(each.label for each in every)]) as out:
        for k, stamp in enumerate(stamps.tolist()):
            out.row([f"{(stamp - capture.moment_ns) * 1e-9:.6f}", stamp, *(column[k] for column in columns)])


def text_lines(capture: Capture, first_s: float, last_s: float, width: int, height: int) -> Iterator[str]:
    """Plots of numbers, changes of texts and enumerations, one below the other."""
    ascii_only = (getattr(sys.stdout, "encoding", None) or "ascii").lower().replace("-", "") != "utf8"
    for each in series_of(capture):
        yield f"{each.label}{f'  {each.unit}' if each.unit else ''}"
        times = each.seconds(capture.moment_ns)
        if each.is_text or words_of(each.field.text):
            yield from _changed(each, times)
        else:
            yield from plot_lines(times, each.values, first_s, last_s, width=width, height=height,
                                  ascii_only=ascii_only)
            yield axis_line(first_s, last_s, width=width, ascii_only=ascii_only)


def _changed(each: Series, times: NDArray[np.float64]) -> Iterator[str]:
    found = changes(times, each.values)
    for time_s, value in found[:MAX_CHANGES]:
        shown = plain(value)
        if isinstance(shown, float) and shown.is_integer():
            shown = in_words(each.field, int(shown))
        yield f"  {time_s:+9.4f} s  {shown if shown != '' else '(empty)'}"
    if len(found) > MAX_CHANGES:
        yield f"  … and {len(found) - MAX_CHANGES} more changes: --csv has them"
    if not found:
        yield "  no record in this window"


def remarks(capture: Capture) -> Iterator[str]:
    """Missing parts, in words, with their amount."""
    for topic, rows in capture.rows.items():
        yield f"{topic}: {len(rows)} records"
    for topic, seconds in capture.short.items():
        missing = f"the first {seconds:.3f} s of" if len(capture.rows[topic]) else "all of"
        yield f"{topic}: its ring keeps less: {missing} the window are missing"
    for topic, seconds in capture.unseen.items():
        yield f"{topic}: no more records came: the last {seconds:.3f} s of the window are missing"
    for gap in capture.gaps:
        at_s = (gap.stamp_ns - capture.moment_ns) * 1e-9
        yield f"{gap.topic}: {gap.lost} records lost behind {at_s:+.4f} s: overwritten before they were read"


def write_png(capture: Capture, file: str, title: str) -> None:
    """A figure with one plot for each unit; Problem without matplotlib, or if it cannot be written."""
    if lacks := missing("matplotlib"):
        raise Problem(f"{lacks}; or take --csv")
    from matplotlib.figure import Figure

    numbers = [each for each in series_of(capture) if not each.is_text]
    if not numbers:
        raise Problem("none of these fields is a number: nothing to plot; --csv and --json have texts")
    units = list(dict.fromkeys(each.unit for each in numbers))
    figure = Figure(figsize=(11.0, 2.0 + 2.6 * len(units)), layout="constrained")
    figure.suptitle(title, fontsize="medium")
    every = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axes, unit in zip(every, units, strict=True):
        for each in numbers:
            if each.unit == unit:
                axes.plot(each.seconds(capture.moment_ns), each.values, drawstyle="steps-post", linewidth=1.0,
                          label=each.label)
        axes.axvline(0.0, color="grey", linewidth=0.8, linestyle="--")
        axes.set_ylabel(unit or "no unit")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", loc="best")
    every[-1].set_xlabel("s from the moment")
    try:
        figure.savefig(Path(file), format="png", dpi=110)
    except OSError as error:
        raise Problem(f"{file}: cannot be written: {error.strerror}") from None
