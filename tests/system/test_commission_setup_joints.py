"""Setup joints calibrated on a running system: one arm of a Classic cart, by a simulated person."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.system.robot import Robot
from trocar.procs.config.read.source import read_source
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.tools.commission import currents, setup_joints, stop
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.person import Settle
from trocar.tools.commission.person_sim import AtBoards
from trocar.tools.converters import to_json

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
SITE = "dvrk-site/jhu-daVinci/"


class OfOneArm(AtBoards):
    """A person who measures one arm only, and notes what the system shows meanwhile."""

    def agrees(self, question: str) -> bool:
        return question.startswith("SUJ/PSM1:")

    def measured(self, question: str, act: Settle) -> tuple[float, ...]:
        reader = directory.reader(self.system, "system", "state", "system", often=False)
        assert reader.newest()
        self.shown.append((reader.field("shown_arm").item().decode(), *reader.field("shown_position")[:6].tolist()))
        reader.close()
        return super().measured(question, act)


def test_one_setup_arm_is_measured_with_its_brakes_released_by_its_clutch_only(robot: Robot, tmp_path: Path) -> None:
    robot.up(stock.find(f"{SITE}system-SUJ.json"), "--path", str(stock.find("dvrk-share")), "--boards", "emulated",
             "--set", "io.period_s=0.002")
    document = from_json(directory.document(robot.name))
    with OfOneArm(document) as person, RunningBench(document, person, ["SUJ"]) as bench:
        person.system, person.shown = robot.name, []
        assert bench.subjects == () and [cart.name for cart in bench.carts] == ["SUJ"]
        (tmp_path / "currents").mkdir()
        assert [str(problem) for problem in currents.run(bench, tmp_path / "currents").problems] == []
        outcome = setup_joints.run(bench, tmp_path)
        assert [str(problem) for problem in outcome.problems] == []
        where = outcome.figures["SUJ/PSM1"]["position"]
        assert np.array(person.shown)[:, 1:].astype(float) == pytest.approx(np.array(where), abs=1e-6)
        assert {row[0] for row in person.shown} == {"SUJ/PSM1"}
        assert bench.setup_readings(bench.carts[0]).clutched.tolist() == [False] * 4
    (path,) = tmp_path.glob("*.json")
    files = [read_source(each)[0] for each in (path, stock.find(f"{SITE}suj-ECM-1-2-3.json"))]
    new, old = ({arm["name"]: arm for arm in file.data["arms"]} for file in files if file is not None)
    for key in ("primary_scales", "primary_offsets", "secondary_scales", "secondary_offsets"):
        assert new["PSM1"][key] == pytest.approx(old["PSM1"][key], abs=0.01), key
    assert all(new[name] == old[name] for name in old if name != "PSM1")


def test_emergency_stop_and_watchdog_cut_the_current_of_the_brakes(robot: Robot, tmp_path: Path) -> None:
    source, _ = read_source(stock.find(f"{SITE}system-SUJ.json"))
    assert source is not None
    source.data["IOs"][0]["watchdog_timeout"] = 0.3  # a busy machine holds io up
    file = tmp_path / "system-SUJ.json"
    file.write_text(to_json(source.data))
    robot.up(file, "--path", str(stock.find(SITE)), "--path", str(stock.find("dvrk-share")), "--boards", "emulated",
             "--set", "io.period_s=0.002", "--clock", "wall")
    document = from_json(directory.document(robot.name))
    with AtBoards(document) as person, RunningBench(document, person, ["SUJ"]) as bench:
        outcome = stop.run(bench)
        assert [str(problem) for problem in outcome.problems] == []
        assert outcome.figures["IO1 stop_s"].keys() == {"SUJ"} and outcome.figures["IO1 watchdog_s"]
        assert not bench.sample("IO1", 0.2).drives("amp_on", bench.setups[0])[-1].any()
