"""Sizes of records follow the document."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from tests.conftest import World
from trocar.procs.config import load_system
from trocar.procs.crtk.topics import catalogue
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.supervisor import memory
from trocar.procs.tables.manifest import proc
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.parts import remove_all
from trocar.shm.time.control_page import CONTROL
from trocar.shm.topics import SUPERVISOR_STATE

DEMO = PROJECT_CONFIGS / "systems" / "demo-teleop.yaml"


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


def test_the_rate_of_a_topic_of_each_cycle_is_the_configured_one(world: World) -> None:
    system = load_system(DEMO, boards="emulated", sets=["io.period_s=0.002", "arm.period_s=0.004"]).system
    assert system is not None
    memory.create_all(dataclasses.replace(system, name=world.name))
    try:
        rates = {entry.name: entry.rate_hz for entry in catalogue(world.name)}
    finally:
        remove_all(world.name)
    periods = {row.name: row.period_s for row in system.processes}
    assert (rates["IO1/state"], rates["PSM1/state"], rates["PSM1/measured_js"]) == (500.0, 250.0, 250.0)
    assert rates["console/state"] == 1.0 / periods["console"] and rates["IO1/events"] == 0.0
