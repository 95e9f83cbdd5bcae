"""Files of a real site and the stock share load as they are and stay as they are."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import stock
from trocar.procs.config import check_file, load_system
from trocar.procs.config.read.problem import FileProblem
from trocar.procs.document import system as document

KINDS = ("system", "io", "pid", "psm", "ecm", "mtm", "kinematic", "tool", "tool index", "setup joints, Classic",
         "setup joints, Si", "setup joints, fixed", "potentiometer table", "gravity")


def dvrk_files() -> list[Path]:
    folders = (stock.find("dvrk-share"), stock.find("dvrk-site"))
    return sorted(path for folder in folders for path in folder.rglob("*.json"))


def site() -> Path:
    return stock.find("dvrk-site/jhu-dVRK/system-PSM1.json")


@pytest.mark.slow
def test_every_file_is_read_without_unknown_keys() -> None:
    share = stock.find("dvrk-share")
    seen = set()
    for path in dvrk_files():
        result = check_file(path, search=[share])
        texts = [str(problem) for problem in result.problems]
        seen.add(result.kind)
        expected = ("before dVRK 2.4", "no such file: it cannot be chosen")
        assert all(any(part in text for part in expected) for text in texts), texts
    assert seen == set(KINDS)


def test_site_system_loads_with_emulated_boards() -> None:
    folder = site().parent
    before = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}
    loaded = load_system(site(), search=[stock.find("dvrk-share")], boards="emulated", name="site")
    assert loaded.errors == () and loaded.warnings == ()
    system = loaded.system
    assert system is not None and system.emulation is not None
    (bus,) = system.emulation.buses
    assert [controller.board_id for controller in bus.controllers] == [6, 7]
    assert system.ios[0].port == f"udp:{bus.address}"
    assert [note for note in system.notes if "tool index" not in note] == [
        f"IO1: port fw replaced by emulated boards 6, 7 at {bus.address}"
    ]
    assert [(row.name, row.kind, row.after) for row in system.processes] == [
        ("boards", "boards", ()),
        ("IO1", "io", ("boards",)),
        ("PSM1", "arm", ("IO1",)),
        ("system", "system", ()),
    ]
    assert {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()} == before


def test_site_numbers_arrive_unchanged() -> None:
    system = load_system(site(), search=[stock.find("dvrk-share")], boards="emulated").system
    assert system is not None
    io, arm = system.ios[0], system.arms[0]
    first = io.robots[0].actuators[0]
    assert (first.board_id, first.axis_id, first.joint_type) == (6, 0, "REVOLUTE")
    assert first.current_to_bits == document.Linear(-5242.88, 33032.43877763718)
    assert first.encoder is not None and first.encoder.bits_to_position == document.Linear(-7.722695805e-06, 0.0)
    assert [tolerance.latency_s for tolerance in io.robots[0].tolerances] == [0.01] * 5 + [0.05, 0.5]
    assert [button.name for button in io.digital_inputs][-1] == "PSM1_adapter"
    assert io.digital_inputs[0].debounce_s == 0.2 and io.digital_inputs[0].debounce_click_s == 0.0
    assert (io.protocol, io.watchdog_s, io.period_s) == ("broadcast-query-read-write", 0.03, 1 / 1500)
    assert (arm.tool_detection, arm.tool, arm.serial, arm.io, arm.robot) == ("MANUAL", None, "28007", "IO1", "PSM1")
    assert [link.name for link in arm.chain.links] == ["yaw", "pitch", "insertion"]
    assert arm.chain.convention == "modified" and arm.use_setpoint_v


def test_site_system_needs_only_our_own_files() -> None:
    system = load_system(site(), boards="emulated").system
    assert system is not None
    assert system.arms[0].chain.source.endswith("configs/kinematic/PSM.yaml")
    assert system.ios[0].pids[0].source.endswith("configs/pid/PSM.yaml")


def test_tele_operation_starts_after_its_arms() -> None:
    path = stock.find("dvrk-site/jhu-dVRK/system-MTML-PSM1-Teleop.json")
    loaded = load_system(path, search=[stock.find("dvrk-share")], boards="emulated")
    system = loaded.system
    assert system is not None and system.emulation is not None
    assert [arm.name for arm in system.arms] == ["PSM1", "MTML"]
    assert ("MTML_PSM1", "teleop", ("MTML", "PSM1")) in [(p.name, p.kind, p.after) for p in system.processes]
    assert [row.name for row in system.processes if row.kind in ("console", "system")] == ["console1", "system"]
    (console,) = system.consoles
    assert console.teleops == ("MTML_PSM1",) and console.clutch == document.WiredInput("IO1", "clutch")
    assert console.operator_present == (document.WiredInput("IO1", "coag"),) and console.present_count == 1
    boards = [controller.board_id for controller in system.emulation.buses[0].controllers]
    assert boards == [0, 1, 3, 6, 7], "masters, gripper and pedals have boards too"
    assert system.arms[0].reference_frame == "ECM" and system.arms[0].base_frame is not None


def test_arms_of_every_kind_start() -> None:
    for name, arm in (
        ("jhu-daVinci/system-ECM", "ECM"),
        ("jhu-daVinci-Si/system-ECM", "ECM"),
        ("jhu-daVinci-Si/system-PSM1", "PSM1"),
        ("jhu-dVRK/system-MTML", "MTML"),
        ("jhu-dVRK/system-MTMR", "MTMR"),
    ):
        path = stock.find(f"dvrk-site/{name}.json")
        loaded = load_system(path, search=[stock.find("dvrk-share")], boards="emulated")
        assert loaded.errors == () and loaded.system is not None
        assert [(row.name, row.kind) for row in loaded.system.processes] == [
            ("boards", "boards"), ("IO1", "io"), (arm, "arm"), ("system", "system")]
        assert not any(note.startswith("not started yet") for note in loaded.system.notes)


def test_table_of_digital_potentiometers_must_exist(tmp_path: Path) -> None:
    io = stock.find("dvrk-site/jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json")
    copy = tmp_path / io.name
    copy.write_bytes(io.read_bytes())
    (problem,) = check_file(copy).problems
    assert problem.key == "robots[0].potentiometers.lookup_table_file" and "no file" in problem.text


def test_missing_share_files_are_named(tmp_path: Path) -> None:
    path = stock.find("dvrk-site/jhu-dVRK/system-MTML.json")
    loaded = load_system(path, configs=tmp_path, boards="emulated")
    files = {problem.key: problem.text for problem in loaded.errors}
    assert "pid/sawControllersPID-MTM.json" in files["arms[0].PID_file"]
    assert "kinematic/MTML.json" in files["kinematic"]


SI_IO = "dvrk-site/jhu-daVinci-Si/sawRobotIO1394-PSM1-292409"


def _with_table(folder: Path, change: Callable[[dict[str, Any]], None], name: str = "") -> list[FileProblem]:
    """Problems of an IO file whose table was changed, or has another name."""
    io = json.loads(stock.find(f"{SI_IO}.json").read_text(encoding="utf-8"))
    table = json.loads(stock.find(f"{SI_IO}-PotentiometerLookupTable.json").read_text(encoding="utf-8"))
    change(table)
    name = name or "PSM1-292409-table.json"
    io["robots"][0]["potentiometers"]["lookup_table_file"] = name
    (folder / name).write_text(json.dumps(table), encoding="utf-8")
    (folder / "io.json").write_text(json.dumps(io), encoding="utf-8")
    return [problem for problem in check_file(folder / "io.json").problems if problem.severity == "error"]


def test_a_table_of_digital_potentiometers_is_beside_its_io_file(tmp_path: Path) -> None:
    assert _with_table(tmp_path, lambda table: None) == []


def test_two_consoles_with_masters_of_one_name_are_emulated(tmp_path: Path) -> None:
    """The same master's files on two buses, as a site with two consoles has them."""
    folder = stock.find("dvrk-site/jhu-dVRK")
    row = {"type": "MTM", "serial": "22723", "name_on_IO": "MTML"}
    system = {"$id": "dvrk-system.schema.json", "$version": 1,
              "IOs": [{"name": name, "port": "udp"} for name in ("IO1", "IO2")],
              "arms": [{"name": "MTML", "IO": "IO1", **row}, {"name": "MTML_trainee", "IO": "IO2", **row}]}
    file = tmp_path / "system-two.json"
    file.write_text(json.dumps(system))
    loaded = load_system(file, search=[folder, stock.find("dvrk-share")], boards="emulated")
    assert loaded.errors == () and loaded.system is not None
    robots = {robot.name for io in loaded.system.emulated().ios for robot in io.robots}
    assert {"IO1/MTML", "IO2/MTML"} <= robots and len(robots) == 4, "their grippers, too"
    grippers = [loaded.system.emulated().arm(name).gripper for name in ("MTML", "MTML_trainee")]
    assert [gripper.partition("/")[0] for gripper in grippers] == ["IO1", "IO2"]
