"""Systems whose arms say `"simulation": "KINEMATIC"`: one process plays them, boards and IO files are not needed."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import stock
from tests.config.conftest import Home
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document import system as document

ROBOTS = {
    "system-PSM1_Classic_KIN_SIMULATED": ("PSM1",),
    "system-ECM_Classic_KIN_SIMULATED": ("ECM",),
    "system-MTML_Classic_KIN_SIMULATED": ("MTML",),
    "system-surgeon-console-simulated": ("MTML", "MTMR"),
    "system-full-system-simulated": ("MTML", "MTMR", "PSM1", "PSM2", "PSM3", "ECM"),
}
ARM = {"name": "PSM2", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}
REAL = {"name": "PSM1", "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": "arms/PSM1-demo.yaml",
        "IO_file": "io/PSM1-demo.yaml", "PID_file": "pid/PSM.yaml"}
BUS = {"name": "IO1", "port": "udp"}


def kinematic(path: Path, **options: object) -> document.SystemConfig:
    loaded = load_system(path, search=[stock.find("dvrk-share")], **options)  # type: ignore[arg-type]
    assert loaded.errors == () and loaded.warnings == () and loaded.system is not None
    return loaded.system


def test_every_stock_file_with_kinematic_arms_is_listed_here() -> None:
    files = stock.find("dvrk-share/system").glob("system-*.json")
    assert {path.stem for path in files if "KINEMATIC" in path.read_text()} == set(ROBOTS)


def test_a_kinematic_arm_with_a_fixed_instrument_may_take_any_of_the_tool_index() -> None:
    (arm,) = kinematic(stock.find("dvrk-share/system/system-PSM1_Classic_KIN_SIMULATED.json")).arms
    assert arm.tool_detection == "FIXED" and arm.tool is not None and arm.tool.name == "LARGE_NEEDLE_DRIVER:400006"
    assert len(arm.tools) == 17


@pytest.mark.parametrize(("name", "boards"), [*((name, None) for name in ROBOTS), (list(ROBOTS)[-1], "emulated")])
def test_stock_file_starts_one_process_that_plays_all_robots(name: str, boards: str | None) -> None:
    system = kinematic(stock.find(f"dvrk-share/system/{name}.json"), boards=boards)
    (io,) = system.ios
    assert (io.name, io.port, io.digital_inputs, system.emulation) == ("io", "", (), None)
    assert tuple(robot.name for robot in io.robots) == ROBOTS[name]
    assert {robot.hardware for robot in io.robots} == {"KINEMATIC"}
    robots = [(p.name, p.kind, p.after) for p in system.processes if p.kind in ("boards", "io", "arm", "suj")]
    assert robots == [
        ("io", "io", ()), *((arm, "arm", ("io",)) for arm in ROBOTS[name]),
        *((cart.name, "suj", ()) for cart in system.carts)]
    assert [(pid.robot, pid.arm) for pid in io.pids] == [(arm, arm) for arm in ROBOTS[name]]
    assert document.from_json(document.to_json(system)) == system


def test_robots_have_the_limits_of_their_chains() -> None:
    system = kinematic(stock.find("dvrk-share/system/system-full-system-simulated.json"))
    robots = {robot.name: [(a.encoder.lower, a.encoder.upper) for a in robot.actuators if a.encoder is not None]
              for robot in system.ios[0].robots}
    assert robots["PSM1"][:3] == [(-1.588, 1.588), (-0.925025, 0.925025), (0.0, 0.24)]
    assert robots["PSM1"][3:] == [(-math.radians(172), math.radians(172))] * 4
    assert len(robots["ECM"]) == 4
    chain = stock.chain("MTML")  # coupled: every corner of the joint space must be within reach
    inverse = np.linalg.inv(np.array(chain.actuator_to_joint))
    low, high = np.array(robots["MTML"]).T
    for corner in np.random.default_rng(1).integers(0, 2, (200, 7)):
        joints = np.array([(link.lower, link.upper)[k] for link, k in zip(chain.links, corner, strict=True)])
        assert ((inverse @ joints >= low - 1e-9) & (inverse @ joints <= high + 1e-9)).all()


def test_arm_is_told_to_be_played(home: Home) -> None:
    loaded = home.load_made({"arms": [ARM]})
    assert loaded.system is not None and loaded.warnings == ()
    (arm,) = loaded.system.arms
    assert (arm.simulation, arm.io, arm.robot) == ("KINEMATIC", "io", "PSM2")
    assert any("PSM2 is KINEMATIC: positions follow" in note for note in loaded.system.notes)


def test_si_arm_starts_without_its_brakes(home: Home) -> None:
    folder = stock.find("dvrk-site/jhu-daVinci-Si")
    arm = {"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": str(folder / "PSM1-292409.json")}
    (home.path / "kinematic").rename(home.path / "ours")
    (home.path / "kinematic").symlink_to(stock.find("dvrk-share/kinematic"))
    system = home.load_made({"arms": [arm]}).system
    assert system is not None
    assert [(row.name, row.kind) for row in system.processes] == [("io", "io"), ("PSM1", "arm"), ("system", "system")]


def test_real_and_kinematic_arms_stand_side_by_side(home: Home) -> None:
    system = home.load_made({"IOs": [BUS], "arms": [REAL, ARM], "trocar": {"boards": "emulated"}}).system
    assert system is not None and system.emulation is not None
    assert [(p.name, p.after) for p in system.processes] == [
        ("boards", ()), ("IO1", ("boards",)), ("io", ()), ("PSM1", ("IO1",)), ("PSM2", ("io",)),
        ("system", ())]
    emulated = system.emulated()
    assert [io.name for io in emulated.ios] == ["IO1"] and [arm.name for arm in emulated.arms] == ["PSM1"]
    assert [bus.io for bus in system.emulation.buses] == ["IO1"]


def test_emulated_boards_know_nothing_of_played_robots(home: Home) -> None:
    section = {"boards": "emulated", "emulation": {"buses": {"desk": {"controllers": {"0": {}}}}}}
    system = home.load_made({"arms": [ARM], "trocar": section}).system
    assert system is not None and system.emulation is not None
    assert system.emulated().ios == () and [io.name for io in system.ios] == ["io"]


def test_files_of_a_bus_are_not_needed_by_an_arm_made_kinematic(home: Home) -> None:
    arm = {**REAL, "simulation": "KINEMATIC", "IO_file": "io/missing.json", "PID_file": "pid/PSM.yaml"}
    loaded = home.load_made({"IOs": [BUS], "arms": [arm]})
    assert loaded.system is not None, loaded.errors
    assert [io.name for io in loaded.system.ios] == ["io"]
    assert any("its part of IO1 is not used" in note for note in loaded.system.notes)


def test_named_gains_are_checked_although_nothing_needs_them(home: Home) -> None:
    home.edit("pid/PSM.yaml", "p_gain", "p_gian")
    loaded = home.load_made({"arms": [{**ARM, "PID_file": "pid/PSM.yaml"}]})
    assert {problem.key for problem in loaded.errors} == {"pid[0].p_gian"}
    assert home.load_made({"arms": [ARM]}).errors == ()


def test_name_of_the_process_that_plays_is_taken(home: Home) -> None:
    loaded = home.load_made({"IOs": [{**BUS, "name": "io"}], "arms": [ARM]})
    (problem,) = loaded.errors
    assert problem.key == "IOs[0].name" and "simulates KINEMATIC arms" in problem.text


def test_arm_without_file_and_serial_is_refused(home: Home) -> None:
    loaded = home.load_made({"arms": [{"name": "PSM2", "type": "PSM", "simulation": "KINEMATIC"}]})
    assert [problem.key for problem in loaded.errors] == ["arms[0].arm_file"]


def test_tasks_are_for_robots_on_boards(home: Home) -> None:
    (home.path / "wall.py").write_text("class Wall: ...\n")
    loaded = home.load_made({"arms": [ARM], "trocar": {"io": {"tasks": [{"module": "wall.py", "name": "Wall"}]}}})
    assert loaded.system is not None and loaded.system.io("io").tasks == ()
    assert "in-cycle tasks need boards: none runs for PSM2" in loaded.system.notes


def test_period_is_the_shortest_asked_for_unless_said_otherwise(home: Home) -> None:
    def period(*keys: dict[str, object], **trocar: object) -> float:
        arms = [{**ARM, "name": f"PSM{place}", **more} for place, more in enumerate(keys)]
        system = home.load_made({"arms": arms, "trocar": trocar}).system
        assert system is not None
        return system.io("io").period_s

    assert period({}, {}) == 1 / 1500
    assert period({"PID_period": 0.001}, {"PID_period": 0.0005}, {}) == 0.0005
    assert period({"PID_period": 0.001}, processes={"io": {"period_s": 0.002}}) == 0.002


@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_simulated_time_needs_emulated_boards_only_where_there_is_a_bus(home: Home, clock: str) -> None:
    assert home.load_made({"arms": [ARM], "trocar": {"clock": clock}}).errors == ()
    mixed = home.load_made({"IOs": [BUS], "arms": [REAL, ARM], "trocar": {"clock": clock}})
    assert [problem.key for problem in mixed.errors] == ["trocar.clock"]


@pytest.mark.parametrize(("content", "trocar", "clock"), [
    ({"arms": [ARM]}, {}, "paced"), ({"arms": [ARM]}, {"clock": "wall"}, "wall"),
    ({"IOs": [BUS], "arms": [REAL, ARM]}, {}, "wall"),
    ({"IOs": [BUS], "arms": [REAL, ARM]}, {"boards": "emulated"}, "paced"),
    ({"IOs": [BUS], "arms": [REAL, ARM]}, {"boards": "emulated", "clock": "lockstep"}, "lockstep")])
def test_what_is_not_real_is_paced_unless_a_clock_is_stated(
        home: Home, content: dict[str, Any], trocar: dict[str, str], clock: str) -> None:
    loaded = home.load_made({**content, "trocar": trocar})
    assert loaded.system is not None and loaded.system.clock == clock, loaded.errors



def test_newcomers_file_needs_no_other_files() -> None:
    system = load_system(PROJECT_CONFIGS / "systems/kinematic.yaml").system
    assert system is not None and system.arms[0].tool is not None
    assert json.loads(document.to_json(system))["ios"][0]["port"] == ""
