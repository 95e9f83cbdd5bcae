"""Paths of fields: what is one, and which cells of a record it means."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.crtk.field_paths import BadPath, FieldCells, all_cells, cells_of, indices_text, parse_path
from trocar.procs.crtk.topics import find
from trocar.shm.system import directory


@pytest.fixture
def played(world: Any) -> Iterator[ScriptedRobot]:
    with robot(world.name) as made:
        made.show_arm(0.25)
        yield made


def rows_and_cells(played: ScriptedRobot, text: str) -> tuple[Any, FieldCells]:
    path = parse_path(text)
    entry = find(played.name, path.topic)
    reader = directory.reader(played.name, entry.instance, entry.ring)
    rows = reader.last(100)
    reader.close()
    return rows, cells_of(entry, path, rows[-1:])


@cases(("text", "topic", "field", "indices"), [
    ("PSM1/measured_js.position[0]", "PSM1/measured_js", "position", (0,)),
    ("PSM1/measured_js.position[0:3]", "PSM1/measured_js", "position", (slice(0, 3),)),
    ("PSM1/measured_js.position[:]", "PSM1/measured_js", "position", (slice(None, None),)),
    ("PSM1/state.jacobian[1][-1]", "PSM1/state", "jacobian", (1, -1)),
    ("PSM1/state.jacobian[1, 2:]", "PSM1/state", "jacobian", (1, slice(2, None))),
    ("IO1/PSM1/measured_js.effort", "IO1/PSM1/measured_js", "effort", ()),
    ("PSM1/state", "PSM1/state", "", ()),
])
def test_a_path_is_topic_field_and_indices(text: str, topic: str, field: str, indices: tuple[Any, ...]) -> None:
    path = parse_path(text)
    assert (path.topic, path.field, path.indices) == (topic, field, indices)


@cases("text", ["", "PSM1", "PSM1/", "PSM1/state.", "PSM1/state.position[", "PSM1/state.position[]",
                "PSM1/state.position[a]", "PSM1/state.position[1:2:3]", "PSM1/state.position[1]x",
                "PSM1/state.position[99999999999]", "PSM1/state.__class__()", "x" * 300 + "/y.z"])
def test_what_is_no_path_says_what_is_one(text: str) -> None:
    with pytest.raises(BadPath, match=r"is no field: a field is written as|is no index; allowed are"):
        parse_path(text)


@given(st.text(max_size=60))
def test_any_text_is_a_path_or_refused(text: str) -> None:
    try:
        path = parse_path(text)
    except BadPath:
        return
    assert path.text == text and "/" in path.topic


@given(st.lists(st.integers(-5, 300) | st.tuples(st.none() | st.integers(0, 9), st.none() | st.integers(0, 9)),
                max_size=3))
def test_indices_written_are_indices_read(indices: list[Any]) -> None:
    def word(index: Any) -> str:
        return str(index) if isinstance(index, int) else ":".join("" if n is None else str(n) for n in index)

    path = parse_path("A/b.c" + "".join(f"[{word(index)}]" for index in indices))
    assert path.indices == tuple(index if isinstance(index, int) else slice(*index) for index in indices)


@pytest.mark.slow
def test_a_view_has_the_joints_of_its_arm(played: ScriptedRobot) -> None:
    rows, cells = rows_and_cells(played, "PSM1/measured_js.position")
    assert cells.labels == tuple(f"PSM1/measured_js.position[{k}]" for k in range(6))
    assert cells.numbers(rows).tolist() == [[0.25] * 6]
    rows, cells = rows_and_cells(played, "PSM1/measured_js.position[-1]")
    assert cells.labels == ("PSM1/measured_js.position[5]",) and cells.shape == ()
    with pytest.raises(BadPath, match="position has 6 numbers, counted from 0"):
        rows_and_cells(played, "PSM1/measured_js.position[6]")


def test_parts_of_poses_are_called_as_echo_shows_them(played: ScriptedRobot) -> None:
    rows, cells = rows_and_cells(played, "PSM1/measured_cp.position[0:2]")
    assert cells.numbers(rows).tolist() == [[1.0, 2.0]]
    rows, cells = rows_and_cells(played, "PSM1/measured_cp.orientation")
    assert cells.numbers(rows).tolist() == [[0.0, 0.0, 0.0, 1.0]]


def test_values_that_are_not_valid_are_none(played: ScriptedRobot) -> None:
    played.show_arm(0.5, valid=False)
    rows, cells = rows_and_cells(played, "PSM1/measured_js.position[0]")
    assert cells.numbers(rows)[0, 0] == 0.25 and np.isnan(cells.numbers(rows)[1, 0])
    rows, cells = rows_and_cells(played, "PSM1/state.position[0]")
    assert cells.numbers(rows)[:, 0].tolist() == [0.25, 0.5]  # the record as it is


def test_matrices_texts_and_stamps_have_paths_too(played: ScriptedRobot) -> None:
    rows, cells = rows_and_cells(played, "PSM1/state.jacobian[1][2:4]")
    assert cells.labels == ("PSM1/state.jacobian[1][2]", "PSM1/state.jacobian[1][3]")
    rows, cells = rows_and_cells(played, "PSM1/state.state")
    assert cells.is_text and cells.raw(rows).tolist() == [[b"DISABLED"]]
    with pytest.raises(BadPath, match=r"PSM1/state\.state is text"):
        cells.numbers(rows)
    rows, cells = rows_and_cells(played, "PSM1/state.sequence")
    assert cells.numbers(rows).tolist() == [[1.0]]


def test_fields_that_are_not_there_are_named_with_those_near(played: ScriptedRobot) -> None:
    with pytest.raises(BadPath, match=r"no field positin; did you mean position"):
        rows_and_cells(played, "PSM1/measured_js.positin[0]")
    with pytest.raises(BadPath, match="is a whole topic; its fields are: valid, name, position"):
        rows_and_cells(played, "PSM1/measured_js")
    with pytest.raises(BadPath, match=r"takes no index"):
        rows_and_cells(played, "PSM1/state.count[0]")
    with pytest.raises(BadPath, match=r"use PSM1/events.value"):
        rows_and_cells(played, "PSM1/error.value")


@pytest.mark.slow
def test_every_label_is_a_path_of_one_cell(played: ScriptedRobot) -> None:
    for topic in ("PSM1/state", "PSM1/measured_js", "PSM1/measured_cp", "PSM1/jaw/measured_js"):
        entry = find(played.name, topic)
        rows, _ = rows_and_cells(played, f"{topic}.stamp_ns")
        for cells in all_cells(entry, rows[-1:]):
            for label, place in zip(cells.labels, cells.flat, strict=True):
                _, again = rows_and_cells(played, label) if len(cells.labels) < 4 else (rows, None)
                assert again is None or again.flat.tolist() == [place]
    assert indices_text((1, 2)) == "[1][2]"
