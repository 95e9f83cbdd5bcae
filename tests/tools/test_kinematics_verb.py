"""`trocar kinematics`: lines in, lines out, for files by themselves and for arm files."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from tests import stock
from trocar.procs.kinematics.endoscopes import NAMES, endoscope
from trocar.tools import cli
from trocar.tools.output.errors import Problem
from trocar.tools.verbs.kinematics import fk, gravity, ik, jacobian

Verb = Callable[..., int]


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, list[Any]]]:
    """Runs a verb on lines; returns its exit code and the objects it printed."""

    def run(verb: Verb, lines: list[Any], **options: Any) -> tuple[int, list[Any]]:
        text = "\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines)
        monkeypatch.setattr(sys, "stdin", io.StringIO(text))
        code = verb(**options)
        return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return run


def share(name: str) -> Path:
    return stock.find(f"dvrk-share/{name}")


def golden(name: str, count: int = 20) -> list[Any]:
    return [json.loads(line) for line in stock.find(f"golden/kinematics/{name}.jsonl").read_text().splitlines()
            ][1 : count + 1]


LND = "LARGE_NEEDLE_DRIVER_400006"


def test_poses_and_jacobians_are_those_of_the_original_routines(ask: Any) -> None:
    records = golden(f"PSM_{LND}")
    files = {"kinematic": share("kinematic/PSM.json"), "tool": share(f"tool/{LND}.json")}
    asked = [{"q": record["q"]} for record in records]
    code, poses = ask(fk, asked, **files)
    other, jacobians = ask(jacobian, asked, **files)
    assert code == other == 0 and len(poses) == len(jacobians) == len(records)
    for record, pose, both in zip(records, poses, jacobians, strict=True):
        for key, row in (("q", pose), ("fk", pose), ("fk_notip", pose), ("jb", both), ("js", both)):
            np.testing.assert_allclose(row[key], record[key], atol=1e-9)


@pytest.mark.parametrize(("name", "kinematic", "tool"), [
    (f"PSM_{LND}", "PSM", LND), ("PSM_NEEDLE_DRIVER_400117_snake", "PSM", "NEEDLE_DRIVER_400117"), ("MTML", "MTML", ""),
])
def test_goals_come_back_as_joints_that_reach_them(ask: Any, name: str, kinematic: str, tool: str) -> None:
    files = {"kinematic": share(f"kinematic/{kinematic}.json"), "tool": share(f"tool/{tool}.json") if tool else None}
    asked = [{"goal": record["fk"], "seed": record["ik"][0]["seed"]} for record in golden(name) if "ik" in record]
    code, found = ask(ik, asked, **files)
    _, reached = ask(fk, [{"q": row["q"]} for row in found], **files)
    assert code == 0 and all(row["ok"] and row["reason"] == "" for row in found)
    for goal, row in zip(asked, reached, strict=True):
        np.testing.assert_allclose(row["fk"], goal["goal"], atol=1e-7)


def test_a_goal_out_of_reach_has_a_reason_and_leaves_the_seed(ask: Any) -> None:
    goal = golden("ECM_straight", 1)[0]["fk"]
    goal[0][3] += 1.0
    arm = share("arm/ECM_KIN_SIMULATED_STRAIGHT.json")
    code, (row,) = ask(ik, [{"goal": goal, "seed": [0, 0, 0.1, 0]}], arm=arm, path=[stock.find("dvrk-share")])
    assert (code, row["ok"], row["q"]) == (0, False, [0, 0, 0.1, 0])
    assert row["reason"].startswith("insertion would be 1.0")


def test_weights_come_from_the_arm_file_or_from_the_chain_itself(ask: Any) -> None:
    path = [stock.find("dvrk-share")]
    q = [0.2, -0.3, 0.15, 0.4]
    code, (mounted,) = ask(gravity, [{"q": q}], arm=share("arm/ECM_KIN_SIMULATED_STRAIGHT.json"), path=path)
    _, (flat,) = ask(gravity, [{"q": q, "pitch": 0}], kinematic=share("kinematic/ECM.json"), camera_mass=1.5)
    assert code == 0
    np.testing.assert_allclose(mounted["tau"], (-0.65605, -2.30105, -12.81713, 0), atol=2e-5)
    np.testing.assert_allclose(flat["tau"], (-0.9278, 1.41582, -13.77753, 0), atol=2e-5)
    for record in golden("gravity_PSM_Si", 5):
        asked = [{"q": record["q"], "pitch": record["pitch"]}, {"q": record["q_phys"], "pitch": record["pitch"]}]
        _, (arm, links) = ask(gravity, asked, kinematic=share("kinematic/PSM_Si_physical.json"))
        np.testing.assert_allclose(arm["tau"], record["effort"], atol=1e-8)
        np.testing.assert_allclose(links["tau"], record["ccg_mdh"], atol=1e-8)


def test_a_master_is_held_by_the_parameters_its_arm_file_names(ask: Any) -> None:
    q = [0.1, 0.2, 0.3, -0.4, 0.5, -0.6, 0.7]
    code, (row,) = ask(gravity, [{"q": q}], arm=stock.find("dvrk-site/jhu-dVRK/MTML-22723.json"),
                       path=[stock.find("dvrk-share")])
    assert code == 0
    np.testing.assert_allclose(row["tau"], (-0.04732, 0.5073, 0.21282, 0.05798, 0.04149, -0.03281, 0), atol=1e-5)


@pytest.mark.parametrize(("line", "reported"), [
    ("{", "not JSON"), ("[1]", "not an object"), ({}, "q is missing"), ({"q": [0.0] * 5}, "q: 6 numbers"),
    ({"q": ["a"] * 6}, "q: not numbers"), ('{"q": [0, 0, 0, 0, 0, NaN]}', "q: not finite"), ({"q": None}, "q: "),
    ({"q": [[0.0] * 6]}, "q: 6 numbers, one a joint; not shape (1, 6)"),
])
def test_a_line_that_cannot_be_answered_says_why_and_the_others_are_answered(ask: Any, line: Any,
                                                                             reported: str) -> None:
    files = {"kinematic": share("kinematic/PSM.json"), "tool": share(f"tool/{LND}.json")}
    code, (first, second) = ask(fk, [line, "", {"q": [0.0] * 6}], **files)
    assert code == 1 and first["line"] == 1 and reported in first["error"]
    assert "fk" in second


@pytest.mark.parametrize("goal", [[[1, 2], [3, 4]], (2.0 * np.eye(4)).tolist(), None])
def test_a_goal_that_is_no_pose_is_refused(ask: Any, goal: Any) -> None:
    code, (row,) = ask(ik, [{"goal": goal}], kinematic=share("kinematic/MTML.json"))
    assert code == 1 and row["error"].startswith("goal: ")


def test_what_the_options_lack_or_the_files_have_wrong_is_said(tmp_path: Path) -> None:
    run = CliRunner()
    nothing = run.invoke(cli.build("kinematics"), ["kinematics", "fk"])
    assert nothing.exit_code == 2
    broken = tmp_path / "PSM.json"
    broken.write_text('{"DH": {"convention": "modified", "joints": [{"name": "yaw", "type": "screw"}]}}')
    wrong = run.invoke(cli.build("kinematics"), ["kinematics", "fk", "--kinematic", str(broken)])
    assert wrong.exit_code == 1
    short = run.invoke(cli.build("kinematics"), ["kinematics", "ik", "--kinematic", str(share("kinematic/PSM.json"))])
    assert short.exit_code == 1


def test_every_endoscope_has_a_tip_that_is_a_pose_and_a_mass() -> None:
    assert len(NAMES) == 13
    for name in NAMES:
        found = endoscope(name)
        np.testing.assert_allclose(found.tip[:3, :3] @ found.tip[:3, :3].T, np.eye(3), atol=1e-12)
        assert 0.0 < found.mass < 3.0
    down, up = endoscope("Si_HD_DOWN").tip[:3, 2], endoscope("Si_HD_UP").tip[:3, 2]
    np.testing.assert_allclose(down * (-1, 1, 1), up, atol=1e-12)
    assert endoscope("Custom_STRAIGHT").tip[2, 3] == 0.18
    with pytest.raises(ValueError, match="no endoscope 'Si_4K_UP'; allowed: NONE, Classic_SD_STRAIGHT"):
        endoscope("Si_4K_UP")


def test_files_are_looked_for_along_the_path_and_among_our_own(
    ask: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tool = tmp_path / "site" / "tool" / "mine.json"
    tool.parent.mkdir(parents=True)
    tool.write_text(share(f"tool/{LND}.json").read_text())
    files = {"kinematic": Path("kinematic/PSM.json"), "tool": Path("tool/mine.json"), "path": [tmp_path / "site"]}
    code, (found,) = ask(fk, [{"q": [0.1, 0.2, 0.1, 0, 0, 0]}], **files)
    assert code == 0 and "fk" in found, "the one is ours, the other lies along the path"
    with pytest.raises(Problem, match=r"kinematic/PSN\.json: error: no such file \(did you mean kinematic/PSM"):
        fk(kinematic=Path("kinematic/PSN.json"))
