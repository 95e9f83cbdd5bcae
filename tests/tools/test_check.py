"""`trocar check`: what it prints and its exit code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from trocar.procs.config import PROJECT_CONFIGS, check_file
from trocar.procs.machine.paths import ROOT
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import system_file
from trocar.tools.verbs import check

DEMO = PROJECT_CONFIGS / "systems/demo.yaml"


@pytest.mark.slow
def test_fine_files_exit_zero(capsys: pytest.CaptureFixture[str]) -> None:
    files = sorted(PROJECT_CONFIGS.rglob("*.yaml"))
    assert check.check(files, as_json=False) == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"{DEMO}: system file, fine" in lines
    assert sum(line.endswith("fine") for line in lines) == len(files)


def test_mistake_exits_one_and_is_printed_on_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = tmp_path / "pid.yaml"
    wrong.write_text((PROJECT_CONFIGS / "pid/PSM.yaml").read_text().replace('"1"', "2"))
    assert check.check([wrong, DEMO], as_json=False) == 1
    out = capsys.readouterr().out
    assert f'{wrong}:4: error: $version = 2: unknown word; allowed: the text "1"' in out
    assert f"{wrong}: pid file, 1 error" in out


def test_json_output_is_one_object_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.json"
    broken.write_text('{"$id": 1,\n}')
    assert check.check([broken, DEMO], as_json=True) == 1
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first["file"], first["ok"], second["ok"], second["kind"]) == (str(broken), False, True, "system")
    (problem,) = first["problems"]
    assert (problem["line"], problem["severity"]) == (1, "error") and "comma before }" in problem["text"]


def test_check_says_all_that_up_with_emulated_boards_would(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "system.yaml"
    file.write_text(DEMO.read_text().replace("boards: emulated", "emulation: {robots: {PSM9: {payload: 1}}}"))
    assert check.check([file], as_json=False) == 0
    assert "warning: trocar.emulation.robots.PSM9" in (out := capsys.readouterr().out) and "--boards emulated" in out
    assert check.check([file], as_json=False, boards="emulated") == 1
    assert "error: trocar.emulation.robots.PSM9" in capsys.readouterr().out
    assert check.check([file], as_json=False, sets=["clock=lockstep"]) == 1, "real boards don't wait"


@pytest.mark.parametrize(
    ("text", "kind", "code"),
    [
        ('{"$id": "dvrk-sistem.schema.json"}', "unknown", 1),
        ('{"arms": [{"name": "ECM", "measured_cp": []}]}', "setup joints, fixed", 1),
        ('{"GC_controller": {}}', "gravity", 1),
        ('{"serial": "1", "lookup": []}', "potentiometer table", 1),
        ('{"arms": [{"name": "PSM1", "arm": "x.json"}]}', "system", 1),
        ('{"robots": []}', "io", 1),
        ('{"pid": []}', "pid", 1),
        ('{"DH": {"joints": []}}', "kinematic", 1),
        ('{"instruments": []}', "tool index", 1),
        ("{}", "unknown", 0),
    ],
)
def test_kind_is_told_from_id_or_keys(tmp_path: Path, text: str, kind: str, code: int) -> None:
    file = tmp_path / "file.json"
    file.write_text(text)
    result = check_file(file)
    assert result.kind == kind
    assert check.check([file], as_json=True) == code


def test_missing_file_exits_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check.check([tmp_path / "nowhere.json"], as_json=False) == 1
    assert "no such file" in capsys.readouterr().out


def test_a_file_that_is_not_found_names_the_option_that_adds_a_folder_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert check.check([Path("nosuch.json")], as_json=False) == 1
    assert capsys.readouterr().out.splitlines()[0].count("--path") == 1
    with pytest.raises(Problem) as caught:
        system_file(Path("nosuch.json"))
    assert str(caught.value).count("--path") == 1


def test_a_folder_is_answered_with_a_command_for_its_files(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "a.yaml").write_text("")
    assert check.check([tmp_path], as_json=False) == 1
    assert f"trocar check {tmp_path}/*.yaml" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_pipe_a_huge_file_and_a_huge_gain_are_refused_at_once(tmp_path: Path) -> None:
    pipe, huge, stiff = tmp_path / "pipe.yaml", tmp_path / "huge.json", tmp_path / "stiff.yaml"
    stiff.write_text((PROJECT_CONFIGS / "pid/PSM.yaml").read_text().replace("p_gain: 120", "p_gain: 1e308", 1))
    os.mkfifo(pipe)
    huge.write_text('{"a": [' + "{}," * 3_300_000 + "{}]}")  # 10 MB
    words = [sys.executable, "-m", "trocar", "check", str(stiff), str(huge), str(pipe)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert f"{stiff}:6: error: pid[0].p_gain = 1e+308: out of range; allowed: a number from 0" in done.stdout
    assert f"{pipe}: error: not a regular file but a named pipe" in done.stdout
    assert f"{huge}: error: too large: 9900011 bytes" in done.stdout


@pytest.mark.parametrize(("key", "name", "verb"), [
    ("IO_file", "io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json", ("check",)),
    ("kinematic", "kinematic/stock.json", ("up", "--boards", "emulated", "--system", "nothing-starts"))])
@pytest.mark.slow
def test_what_lies_in_the_share_of_the_dvrk_is_told_with_path_and_the_folders_looked_in(
    tmp_path: Path, verb: tuple[str, ...], key: str, name: str
) -> None:
    """A lab's own files, beside which the stock files are missing that they name."""
    other = tmp_path / "other"
    other.mkdir()
    if key == "IO_file":
        content = DEMO.read_text() + f"ISI_focus_controller: {{IO: IO1, IO_file: {name}}}\n"
    else:
        arm = (PROJECT_CONFIGS / "arms/PSM1-demo.yaml").read_text().replace("kinematic/PSM.yaml", name)
        (tmp_path / "arm.yaml").write_text(arm)
        content = DEMO.read_text().replace("arms/PSM1-demo.yaml", "arm.yaml")
    (tmp_path / "system.yaml").write_text(content)
    done = subprocess.run([sys.executable, "-m", "trocar", *verb, "system.yaml", "--path", "other"], cwd=tmp_path,
                          text=True, capture_output=True, timeout=300, check=False,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 1
    line = next(line for line in (done.stdout + done.stderr).splitlines() if name in line)
    assert "--path FOLDER" in line and "sawIntuitiveResearchKit/share" in line
    assert all(str(folder) in line for folder in (tmp_path, "other", PROJECT_CONFIGS))
