"""Arms derived from ours in a running system: the page's example homes, follows, scans, and is killed meanwhile."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.system import directory
from trocar.tools.inspect.processes import statuses

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PAGE = (ROOT / "docs/derived-arms.md").read_text(encoding="utf-8")
BROKEN = """
import time

from trocar.procs.arm.derived import DerivedEcm, DerivedMtm

class Master(DerivedMtm):
    pass

class Broken(DerivedEcm):
    on = False

    def on_break(self):
        self.on = True

    def watch(self):
        if self.on:
            raise ZeroDivisionError("no more")
        super().watch()

class Slow(Broken):
    def watch(self):
        if self.on:
            time.sleep(0.2)
"""


def page_in(folder: Path) -> dict[str, Any]:
    """What the page declares; its program is in this folder."""
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (declared,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (folder / "scanner.py").write_text(program)
    page: dict[str, Any] = yaml.safe_load(declared)
    return page


def system_of(folder: Path, second: str) -> Path:
    """A derived master, the page's PSM1, and an ECM of this class of broken.py."""
    page = page_in(folder)
    (folder / "broken.py").write_text(BROKEN)
    system = yaml.safe_load((ROOT / "configs/systems/kinematic-teleop.yaml").read_text())
    system["consoles"][0]["teleop_PSMs"][0]["configure_parameter"]["align_MTM"] = False
    ecm = {"name": "ECM", "type": "ECM_DERIVED", "component": second, "simulation": "KINEMATIC",
           "arm_file": "arms/ECM-demo.yaml"}
    master = {**system["arms"][0], "type": "MTM_DERIVED", "component": "broken.Master"}
    system["arms"] = [master, *page["arms"], ecm]
    for arm in system["arms"]:
        arm["arm_file"] = f"{ROOT}/configs/{arm['arm_file']}"
    system["trocar"] = page["trocar"]
    if second.startswith("broken."):
        system["trocar"]["processes"].append({"name": "ECM", "commands": [{"name": "break"}]})
    file = folder / "lab.yaml"
    file.write_text(yaml.safe_dump(system))
    return file


def reason(robot: Robot, name: str) -> str:
    return next(row.exit_reason for row in statuses(robot.name) if row.name == name)


def test_the_arm_of_the_page_homes_follows_scans_and_is_killed(
        robot: Robot, tmp_path: Path, records: Callable[..., Any]) -> None:
    robot.up(system_of(tmp_path, "broken.Broken"))
    robot.home()
    psm, master, teleop = (records(robot, name, "state") for name in ("PSM1", "MTMR", "MTMR_PSM1"))

    def shown(ring: Any, field: str) -> Any:
        assert ring.newest()
        return ring.field(field).copy()

    def is_in(state: bytes) -> bool:
        return bool(shown(psm, "sub_state") == state)

    def scans() -> bool:
        """It is on its way, asked again where a busy machine has not seen the second that a scan takes."""
        if is_in(b"HOMED"):
            robot.trocar("send", "PSM1", "scan", "0.05", code=None)
        return is_in(b"SCANNING") and abs(shown(psm, "position")[0] - home) > 0.002

    robot.trocar("send", "console", "teleop_enable", "1")
    robot.trocar("send", "console", "emulate_operator_present", "1", "stay")
    wait_for(lambda: shown(teleop, "following"), 60, "following")
    begin, goal = shown(psm, "measured_cp"), shown(master, "measured_cp")
    goal[0] += 0.02
    robot.trocar("send", "MTMR", "move_cp", *map(str, goal), "--wait")
    wait_for(lambda: np.linalg.norm(shown(psm, "measured_cp")[:3] - begin[:3]) > 0.003, 30, "the slave has followed")
    robot.trocar("send", "console", "teleop_enable", "0")

    wait_for(lambda: "width: 0 to 0.1 rad" in robot.trocar("send", "PSM1", "scan", "1", code=1), 60,
             "nobody stops it any more, and its own reason")
    assert "swing for a second" in robot.trocar("send", "PSM1")
    home = shown(psm, "position")[0]
    for killed in (False, True):
        assert "for a second" in robot.trocar("send", "PSM1", "scan", "0.05")
        wait_for(scans, 60, "it scans")
        if killed:
            pid, before = robot.kill("PSM1"), shown(psm, "setpoint_position")[0]
            robot.comes_back("PSM1", pid)
        wait_for(lambda: is_in(b"HOMED"), 30, "its end")
        if killed:
            assert shown(psm, "is_homed") and abs(shown(psm, "position")[0] - before) < 0.01
        else:
            assert abs(shown(psm, "position")[0] - home) < 1e-4

    pid = robot.pid("ECM")
    robot.trocar("send", "ECM", "break")
    wait_for(lambda: "exit code 4: ZeroDivisionError: no more" in reason(robot, "ECM"), 30, "its reason")
    robot.comes_back("ECM", pid)
    wait_for(lambda: shown(records(robot, "ECM", "state"), "is_homed"), 30, "it goes on homed")
    robot.trocar("send", "console", "teleop_enable", "1")
    wait_for(lambda: shown(teleop, "following"), 60, "following again")
    assert robot.down() == 0


def test_on_boards_io_holds_the_arm_while_its_process_is_away(
        robot: Robot, tmp_path: Path, records: Callable[..., Any]) -> None:
    page, system = page_in(tmp_path), yaml.safe_load((ROOT / "configs/systems/demo.yaml").read_text())
    (arm,) = system["arms"]
    arm |= {key: f"{ROOT}/configs/{arm[key]}" for key in ("arm_file", "IO_file", "PID_file")}
    arm |= {key: page["arms"][0][key] for key in ("type", "component")}
    system["trocar"] |= page["trocar"]
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(system))
    robot.up(tmp_path / "lab.yaml")
    robot.trocar("power-on")
    robot.home()
    psm, boards = records(robot, "PSM1", "state"), records(robot, "boards", "state")

    def yaw() -> float:
        assert boards.newest()
        return float(boards.field("position")[0])

    def scans() -> bool:
        """It is on its way, asked again where a busy machine has not seen the second that a scan takes."""
        if psm.newest() and psm.field("sub_state") == b"HOMED":
            robot.trocar("send", "PSM1", "scan", "0.05", code=None)
        return abs(yaw() - home) > 0.01

    home = yaw()
    wait_for(scans, 60, "it scans")
    pid = robot.kill("PSM1")
    robot.comes_back("PSM1", pid)
    wait_for(lambda: psm.newest() and psm.field("sub_state") == b"HOMED", 30, "it goes on")
    assert abs(yaw() - home) < 0.06 and psm.field("is_homed")
    assert "for a second" in robot.trocar("send", "PSM1", "scan", "0.02")
    assert robot.down() == 0


def test_an_arm_whose_class_cannot_be_used_says_so(robot: Robot, tmp_path: Path) -> None:
    file = system_of(tmp_path, "broken.Missing")
    robot.up(file, wait=False)
    assert robot.supervisor is not None
    assert robot.supervisor.wait(timeout=120) != 0
    assert "broken.py has no class Missing that is derived from DerivedEcm; it has: Broken, Slow" in robot.output()
    assert not directory.instances(robot.name)


@pytest.mark.simulated("paced")
def test_an_arm_whose_code_takes_long_for_each_cycle_is_named(robot: Robot, tmp_path: Path) -> None:
    robot.up(system_of(tmp_path, "broken.Slow"))
    robot.home()
    robot.trocar("send", "ECM", "break", code=None)
    wait_for(lambda: "first: ECM: its cycles take so long" in robot.trocar("status", code=None), 60, "it is named")
