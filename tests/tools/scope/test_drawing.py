"""The scale of plots in a terminal."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.tools.scope.drawing import LABEL, plot_lines

TIMES = np.linspace(0.0, 1.0, 50)
WAVE = np.sin(9.0 * TIMES)


def labels(values: np.ndarray) -> list[str]:
    lines = plot_lines(TIMES, values, 0.0, 1.0, width=50, height=4)
    return [line[:LABEL].strip() for line in lines]


@pytest.mark.parametrize("values", [WAVE, 0.120001 + 1e-5 * WAVE, -1234567.0 + WAVE, 1e-7 * WAVE])
def test_the_numbers_at_top_and_bottom_differ(values: np.ndarray) -> None:
    top, bottom = (float(label) for label in labels(values) if label)
    assert top > bottom and top - bottom == pytest.approx(np.ptp(values), rel=0.5)


@pytest.mark.parametrize("value", [0.0, 0.12, -1234567.0])
def test_a_flat_curve_has_its_value_once(value: float) -> None:
    (label,) = (label for label in labels(np.full(50, value)) if label)
    assert float(label) == pytest.approx(value, rel=1e-3)
