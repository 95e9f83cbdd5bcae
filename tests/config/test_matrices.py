"""What counts as a transform."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trocar.procs.config.read.matrices import check_rigid


class SystemReport:
    """What is wrong."""

    def __init__(self) -> None:
        self.errors: list[str] = []

    def error(self, key: object, text: str, allowed: str = "") -> None:
        self.errors.append(text)


def changed(row: int, column: int, value: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(("matrix", "wrong"), [
    (np.eye(4), ""), (changed(0, 3, 5.0), ""), (changed(0, 0, 1.0004), ""), (changed(0, 0, 1.01), "not a rotation"),
    (changed(2, 2, -1.0), "not a rotation"), (changed(1, 1, 1e300), "not a rotation"),
    (changed(3, 0, 0.1), "last row"), (np.eye(3), "wrong size"),
])
def test_a_transform_turns_and_shifts_and_nothing_else(matrix: np.ndarray, wrong: str) -> None:
    reported: Any = SystemReport()
    assert check_rigid(reported, (), tuple(map(tuple, matrix.tolist()))) is (wrong == "")
    assert [text[: len(wrong)] for text in reported.errors] == [wrong] * bool(wrong)
