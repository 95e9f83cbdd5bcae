"""Plots in plain text: braille dots, or ASCII if the terminal has no others. Pure."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character, by row and column of its dots."""
BRAILLE: Final = 0x2800
LABEL: Final = 10  # characters in front of a plot
SPARKS: Final = "▁▂▃▄▅▆▇█"


def plot_lines(times: Numbers, values: Numbers, first: float, last: float, *, width: int = 80, height: int = 6,
               ascii_only: bool = False) -> list[str]:
    """A plot of values (n,) over times (n,), s, from `first` to `last`, with its scale; of this size in characters.

    Of several samples in a column of dots, the range from the smallest to the largest is drawn: no peak is too short.
    """
    columns, rows = (width - LABEL - 2) * (1 if ascii_only else 2), height * (1 if ascii_only else 4)
    good = np.isfinite(values)
    if not good.any():
        return [" " * LABEL + "│ no value in this window"]
    lowest, highest = float(values[good].min()), float(values[good].max())
    low, high = _range(lowest, highest)
    grid = np.zeros((rows, columns), np.bool_)
    _draw(grid, times, values, first, last, low, high)
    texts = _ascii(grid) if ascii_only else _braille(grid)
    is_flat = (low, high) != (lowest, highest)
    labels = {height // 2: _short(lowest)} if is_flat else dict(zip((0, height - 1), _apart(high, low), strict=True))
    bar = "|" if ascii_only else "│"
    return [f"{labels.get(k, ''):>{LABEL}}{bar}{text}" for k, text in enumerate(texts)]


def axis_line(first: float, last: float, *, width: int = 80, ascii_only: bool = False) -> str:
    """The line below: begin, end, and the trigger (0) if it is between them."""
    columns = width - LABEL - 2
    line = [" "] * columns
    begin, end = f"{first:+.3f} s", f"{last:+.3f} s"
    line[: len(begin)] = begin
    line[columns - len(end) :] = end
    if first < 0.0 < last:
        at = round(-first / (last - first) * (columns - 1))
        mark = ("^ 0" if ascii_only else "▲ 0")[: max(0, columns - len(end) - at)]
        if at >= len(begin) and at + len(mark) <= columns - len(end):
            line[at : at + len(mark)] = mark
    return " " * (LABEL + 1) + "".join(line)


def sparkline(values: Numbers, width: int) -> str:
    """The newest `width` values as a line of small bars; blank without values."""
    shown = values[-width:] if width else values[:0]
    good = shown[np.isfinite(shown)]
    if not len(good):
        return " " * len(shown)
    low, high = float(good.min()), float(good.max())
    if high - low <= max(1e-9, abs(high) * 1e-6):
        return "".join(SPARKS[3] if math.isfinite(value) else " " for value in shown.tolist())
    places = (0.5 * shown - 0.5 * low) / (0.5 * high - 0.5 * low) * (len(SPARKS) - 1)  # halves do not overflow
    return "".join(SPARKS[round(place)] if math.isfinite(place) else " " for place in places.tolist())


def _range(low: float, high: float) -> tuple[float, float]:
    least = max(1e-9, 1e-6 * max(abs(low), abs(high)))
    return (low, high) if high - low > least else (low - least, high + least)


def _draw(grid: NDArray[np.bool_], times: Numbers, values: Numbers, first: float, last: float, low: float, high: float
          ) -> None:
    rows, columns = grid.shape
    span = max(last - first, 1e-9)
    xs = np.clip(((times - first) / span * (columns - 1)).round(), 0, columns - 1)
    ys = (0.5 * high - 0.5 * values) / (0.5 * high - 0.5 * low) * (rows - 1)  # halves do not overflow
    before: tuple[int, int] | None = None
    for x, y in zip(xs.tolist(), ys.tolist(), strict=True):
        if not math.isfinite(y):
            before = None
            continue
        at, row = int(x), round(y)
        if before is not None:  # a step is drawn as one: the value is held until the next
            grid[before[1], before[0] : at + 1] = True
            grid[min(before[1], row) : max(before[1], row) + 1, at] = True
        grid[row, at] = True
        before = at, row


def _braille(grid: NDArray[np.bool_]) -> list[str]:
    rows, columns = grid.shape
    cells = np.full((rows // 4, columns // 2), BRAILLE)
    for y, bits in enumerate(DOTS):
        for x, bit in enumerate(bits):
            cells += grid[y::4, x::2] * bit
    return ["".join(map(chr, line)).replace(chr(BRAILLE), " ") for line in cells.tolist()]


def _ascii(grid: NDArray[np.bool_]) -> list[str]:
    return ["".join("*" if dot else " " for dot in line) for line in grid.tolist()]


def _short(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}"


def _apart(high: float, low: float) -> tuple[str, str]:
    """Both with as many digits as needed to distinguish them."""
    return next(((top, bottom) for top, bottom in ((_short(high, n), _short(low, n)) for n in range(4, 12))
                 if top != bottom), (_short(high), _short(low)))


def changes(times: Numbers, values: NDArray[Any]) -> list[tuple[float, Any]]:
    """Times at which a value (n,) changed, and the new values; the first one too."""
    if not len(values):
        return []
    new = np.flatnonzero(values[1:] != values[:-1]) + 1
    return [(float(times[k]), values[k]) for k in (0, *new.tolist())]
