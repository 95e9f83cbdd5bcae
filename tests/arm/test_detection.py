"""Which instrument is on a PSM: its memory says so, or a person."""

from __future__ import annotations

import dataclasses

import pytest

from tests.arm.arm_configs import TOOL
from tests.arm.fake_psm import DRIVER, OTHER, with_adapter


def test_manual_detection_asks_once_and_takes_the_answer() -> None:
    psm = with_adapter()
    assert "not requested" in psm.send("set_tool_type", (), DRIVER).replies[0][1]
    psm.reports.events.clear()
    psm.retracted().put_on("tool")
    psm.run(0.5)
    assert psm.types == [("tool_type_request", "")] and len(psm.reports.of("warning")) == 1
    assert psm.arm.state == "HOMED" and not psm.homed_flag and psm.state["count"] == 7
    assert "there are" in psm.send("set_tool_type", (), "SPOON:1").replies[0][1]
    assert DRIVER in psm.send("set_tool_type", (), "").replies[0][1]
    assert psm.send("set_tool_type", (), DRIVER).outcomes == ["done"]
    assert psm.types[-1] == ("tool_type", DRIVER)
    assert psm.arm.state == "ENGAGING_TOOL" and psm.state.text("tool") == TOOL.name
    assert "not requested" in psm.send("set_tool_type", (), DRIVER).replies[0][1]


def test_the_memory_of_an_instrument_says_which_it_is() -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    psm.io.memory = f"{DRIVER}[3]"
    psm.put_on("tool")
    assert ("trigger_read", ()) in psm.io.sent and psm.state["count"] == 7
    psm.run(0.2)
    assert psm.types == [("tool_type", DRIVER)] and psm.state["count"] == 6 and psm.homed_flag
    psm.take_off("tool")
    psm.io.memory = "MEGA_NEEDLE_DRIVER:400194[1]"
    psm.put_on("tool")
    psm.run(0.2)
    assert [t for _, t in psm.types] == [DRIVER, "", "MEGA_NEEDLE_DRIVER:400194"]
    assert psm.state.text("tool") == OTHER.name


@pytest.mark.parametrize("memory", ("", "SPOON:1[1]", "not a name"))
def test_what_the_memory_does_not_tell_a_person_is_asked_for(memory: str) -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    psm.io.memory = memory
    psm.put_on("tool")
    psm.run(0.3)
    assert psm.types == [("tool_type", "ERROR"), ("tool_type_request", "")]
    assert len(psm.reports.of("error")) == 1 and psm.arm.state == "HOMED"
    assert psm.send("set_tool_type", (), DRIVER).outcomes == ["done"]
    psm.run(0.1)
    assert psm.state["count"] == 6


def test_a_reading_that_somebody_else_asked_for_counts_as_well() -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    psm.put_on("tool")
    psm.run(0.3)
    psm.io.memory = f"{DRIVER}[3]"
    psm.io._do("trigger_read", ())
    psm.run(0.3)
    assert psm.state["count"] == 6


def test_a_reader_that_is_busy_is_asked_again() -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    psm.io.memory, psm.io.refuses["trigger_read"] = f"{DRIVER}[3]", "its board is busy reading for another"
    psm.put_on("tool")
    psm.run(1.0)
    assert psm.state["count"] == 7 and not psm.reports.of("error")
    psm.io.refuses.clear()
    psm.run(1.0)
    assert psm.state["count"] == 6


def test_an_io_that_never_reads_is_told() -> None:
    psm = with_adapter(tool_detection="AUTOMATIC")
    psm.io.loses["trigger_read"] = 9
    psm.put_on("tool")
    psm.run(6.2)
    assert psm.types == [("tool_type", "ERROR"), ("tool_type_request", "")]


def test_a_version_has_to_be_said_where_there_are_several() -> None:
    old = dataclasses.replace(TOOL, name="LARGE_NEEDLE_DRIVER_420006", model="420006", version_max=11)
    new = dataclasses.replace(old, name="LARGE_NEEDLE_DRIVER_GEARED_420006", version_min=12, version_max=None)
    psm = with_adapter(tools=(old, new))
    psm.put_on("tool")
    assert "specify one" in psm.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:420006").replies[0][1]
    psm.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:420006[14]")
    psm.run(0.1)
    assert psm.state.text("tool") == new.name
