"""Control pages: live cells, states by name, refused when they are something else."""

from __future__ import annotations

from typing import Any

import pytest

from trocar.shm.memory.segment import SegmentError, segment_name
from trocar.shm.time.control_page import SCHEMA, STATES, ControlPage, create_control


@pytest.fixture
def page(world: Any) -> Any:
    create_control(world.name, "PSM1")
    yield world.name
    world.remove()


def test_cells_are_live_between_attachments(page: str) -> None:
    own, tool = ControlPage(page, "PSM1", write=True), ControlPage(page, "PSM1")
    cell = tool.field("missed")
    own.field("missed")[...] = 7
    own.field("policy")[...] = b"FIFO 80"
    assert int(cell) == 7 == tool.get("missed") and tool.get("policy") == b"FIFO 80"
    own.close()
    tool.close()


@pytest.mark.parametrize("state", STATES)
def test_states_show_by_name(page: str, state: str) -> None:
    own, tool = ControlPage(page, "PSM1", write=True), ControlPage(page, "PSM1")
    assert tool.state == "CREATED"
    own.show(state, "because")
    assert (tool.state, tool.get("error")) == (state, b"because")
    own.close()
    tool.close()


def test_a_long_error_is_cut(page: str) -> None:
    own = ControlPage(page, "PSM1", write=True)
    own.show("FAILED", "ü" * 1000)
    assert own.get("error").decode() == "ü" * 198 + "…"
    own.close()


def test_an_unknown_state_is_said_to_be_one(page: str) -> None:
    own = ControlPage(page, "PSM1", write=True)
    own.field("state")[...] = 200
    assert own.state == "unknown (200)"
    own.close()


def test_a_tool_cannot_write(page: str) -> None:
    tool = ControlPage(page, "PSM1")
    with pytest.raises(ValueError, match="read-only"):
        tool.field("missed")[...] = 1
    tool.close()


def test_an_absent_instance_is_an_error(page: str) -> None:
    with pytest.raises(SegmentError, match="no such segment"):
        ControlPage(page, "PSM9")


def test_one_segment_is_not_another(page: str, world: Any) -> None:
    from trocar.shm.memory.segment import Segment, create

    with Segment(segment_name(page, "PSM1", "control")) as segment:
        schema = segment.header.schema
    create(segment_name(page, "PSM2", "control"), "ring", schema, 1)
    with pytest.raises(SegmentError, match="is a ring, not a control"):
        ControlPage(page, "PSM2")


def test_the_futex_word_is_aligned() -> None:
    assert SCHEMA.offset("wakeup") % 4 == 0
