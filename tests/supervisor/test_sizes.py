"""Sizes of records follow the document."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from trocar.procs.config import load_system
from trocar.procs.tables.manifest import proc
from trocar.shm.memory.layout import schema_of
from trocar.shm.time.control_page import CONTROL
from trocar.shm.topics import SUPERVISOR_STATE


def test_boards_record_every_robot_on_them_io_its_own(data: Callable[[str], Path]) -> None:
    path = data("dvrk-site/jhu-dVRK/system-MTML-PSM1-Teleop.json")
    system = load_system(path, search=[data("dvrk-share")], boards="emulated").system
    assert system is not None
    dims, info = proc("boards").sizes(system, "boards")
    assert dims == {"axes": 15, "boards": 5} and info["boards"] == [0, 1, 3, 6, 7]
    cuts = {name: (row["first"], row["count"]) for name, row in info["robots"].items()}
    assert cuts == {"PSM1": (0, 7), "MTML": (7, 7), "MTML_gripper": (14, 1)}
    dims, info = proc("io").sizes(system, "IO1")
    assert (dims["axes"], list(info["robots"])) == (15, ["PSM1", "MTML", "MTML_gripper"])


def test_how_a_process_ended_has_room_for_all_that_it_said_of_itself() -> None:
    said = schema_of(CONTROL).dtype["error"].itemsize
    room = schema_of(SUPERVISOR_STATE, {"instances": 1}).dtype["exit_reason"].base.itemsize
    assert room >= len("exit code 4: ") + said + len("; given up after 100 restarts")
