"""A picture of differences: each field in both recordings, and below it their difference."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.machine.extras import missing
from trocar.procs.recordings.reading import RecordingReader
from trocar.tools.analysis.choosing import numbers
from trocar.tools.analysis.differences import TopicDifference, paired
from trocar.tools.output.errors import Problem

MOST: Final = 6  # pictures below each other that can still be read


def plot(path: str, a: RecordingReader, b: RecordingReader, topics: tuple[TopicDifference, ...], how: str) -> list[str]:
    """Write a PNG with the fields that differ most by their own spread; the names of those that are in it."""
    if lacks := missing("matplotlib"):
        raise Problem(lacks)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    wanted = [(topic.name, field) for topic in topics for field in topic.fields
              if np.isfinite(field.most) and field.name not in ("sequence", "stamp_ns")]
    wanted = sorted(wanted, key=lambda each: (each[1].beyond == 0, -each[1].count))[:MOST]
    figure = Figure(figsize=(11.0, 1.0 + 3.2 * max(1, len(wanted))), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2 * max(1, len(wanted)), 1, squeeze=False, height_ratios=[2, 1] * max(1, len(wanted)))[:, 0]
    for k, (name, field) in enumerate(wanted):
        records = a.records(name), b.records(name)
        pairs = paired(*records, how)
        time_s, values_a = _curve(records[0].rows[pairs.a], field.name)
        _, values_b = _curve(records[1].rows[pairs.b], field.name)
        above, below = axes[2 * k], axes[2 * k + 1]
        for n in range(values_a.shape[1]):
            above.plot(time_s, values_a[:, n], color=f"C{n % 10}", linewidth=1.0, label=f"[{n}]")
            above.plot(time_s, values_b[:, n], color=f"C{n % 10}", linewidth=1.0, linestyle="--")
            below.plot(time_s, values_b[:, n] - values_a[:, n], color=f"C{n % 10}", linewidth=0.8)
        above.set_title(f"{name}.{field.name}  (full: {a.path.name}, dashed: {b.path.name})", fontsize=9)
        above.set_ylabel(field.unit)
        below.set_ylabel("B - A")
        below.set_xlabel("s")
        if 1 < values_a.shape[1] <= 8:
            above.legend(fontsize=7, ncols=values_a.shape[1], loc="upper right")
    if not wanted:
        axes[0].set_title("no number differs")
    try:
        figure.savefig(path, dpi=110, format="png")
    except OSError as error:
        raise Problem(f"{path}: {error.strerror}") from None
    return [f"{name}.{field.name}" for name, field in wanted]


def _curve(rows: NDArray[Any], field: str) -> tuple[NDArray[Any], NDArray[Any]]:
    stamps = rows["stamp_ns"].astype(np.int64)
    return (stamps - stamps[:1].sum()) * 1e-9, numbers(rows, field)
